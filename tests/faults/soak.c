/* soak [FRAMES [SEED]]: so many frames (10,000) through one plan on two devices, with jobs that are cancelled and
 * devices that fail at random moments. Every job ends as it may: with the very result of an undisturbed run, cancelled,
 * or with the failure of a device while one fails. Memory is flat: once warm, the process holds 1 % more at most, and
 * after each round the context's books are what they were. */
#include <time.h>

#include "fault.h"
#include "job_fixture.h"

enum { LOST = CL_DEVICE_NOT_AVAILABLE, SHORT = CL_MEM_OBJECT_ALLOCATION_FAILURE };

/* Frames in flight at once, of which one in so many is cancelled; a round is followed by a look at memory. */
enum { FLIGHT = 6, CANCELLED_ONE_IN = 8, FAILING_ONE_IN = 4, LATEST_COMMAND = 400, ROUND = 10 * FLIGHT };

/* Shares: of the rounds before memory is taken to be warm, and of its growth from there on. */
#define WARM   0.25
#define GROWTH 0.01

static long frames = 10000;
static uint64_t seed = 1;

typedef struct counts {
    long done, cancelled, failed, losses;
} counts;

static size_t resident(void)
{
    long all, here = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    assert_non_null(file);
    assert_int_equal(fscanf(file, "%ld %ld", &all, &here), 2);
    fclose(file);
    return (size_t)here * (size_t)sysconf(_SC_PAGESIZE);
}

/* One flight: submitted, some cancelled at a moment, all waited for. */
static void fly(const job_fixture *f, hada_plan *plan, hada_random *random, counts *sum)
{
    hada_job *jobs[FLIGHT];
    hada_result results[FLIGHT] = {{0}};
    int which[FLIGHT];
    const int failing = hada_random_below(random, FAILING_ONE_IN) == 0;
    for (int i = 0; failing && i < 2; i++)
        if (hada_random_below(random, 2))
            fault_lose(&(fault_device_loss){f->part[i]->cl, 1 + (long)hada_random_below(random, LATEST_COMMAND),
                                            (long)hada_random_below(random, 3),
                                            hada_random_below(random, 2) ? LOST : SHORT});
    sum->losses += failing;
    for (int i = 0; i < FLIGHT; i++) {
        which[i] = (int)hada_random_below(random, JOB_FRAMES);
        ASSERT_OK(hada_job_submit(&jobs[i], plan, &f->frames[which[i]], &results[i], err));
    }
    for (int i = 0; i < FLIGHT; i++)
        if (hada_random_below(random, CANCELLED_ONE_IN) == 0) {
            const struct timespec moment = {0, 1000 * (long)hada_random_below(random, 600)};
            nanosleep(&moment, NULL);
            hada_job_cancel(jobs[i]);
        }
    for (int i = 0; i < FLIGHT; i++) {
        hada_error error = {0};
        const hada_status status = hada_job_wait(jobs[i], &error);
        if (status == HADA_OK)
            assert_true(job_same(&results[i], &f->expected[JOB_LISTED][which[i]]));
        else if (status != HADA_ERROR_CANCELLED && (!failing || !*error.message))
            fail_msg("without a failing device: %s", error.message);
        sum->done += status == HADA_OK;
        sum->cancelled += status == HADA_ERROR_CANCELLED;
        sum->failed += status && status != HADA_ERROR_CANCELLED;
        hada_job_destroy(&jobs[i]);
        hada_result_destroy(&results[i]);
    }
    fault_lose(NULL);
}

static void frames_go_on_and_memory_is_flat(void **state)
{
    const job_fixture *f = *state;
    hada_plan_options options = f->options[JOB_LISTED];
    hada_plan *plan;
    hada_random random;
    counts sum = {0};
    uint64_t most = 0;
    size_t warm = 0, last = 0;
    options.batch = 3;
    hada_random_seed(&random, seed, 11);
    ASSERT_OK(hada_plan_create_on(&plan, f->part, 2, f->model, &options, err));
    for (long n = 0; n < frames; n += ROUND) {
        for (int i = 0; i < ROUND; i += FLIGHT)
            fly(f, plan, &random, &sum);
        const uint64_t held = hada_context_bytes(f->part[0]) + hada_context_bytes(f->part[1]);
        last = resident();
        if ((double)n < WARM * (double)frames) {
            warm = last > warm ? last : warm;
            most = held > most ? held : most;
        } else if (held > most)
            fail_msg("frame %ld: %llu bytes on the devices, %llu before", n, (unsigned long long)held,
                     (unsigned long long)most);
    }
    hada_plan_destroy(&plan);
    print_message("%ld done, %ld cancelled, %ld failed, devices failed in %ld flights; %.1f MiB, %.1f MiB when warm\n",
                  sum.done, sum.cancelled, sum.failed, sum.losses, (double)last / (1 << 20), (double)warm / (1 << 20));
    assert_true(sum.done > sum.cancelled && sum.cancelled >= 1 && sum.losses >= 1);
    assert_true((double)last <= (1.0 + GROWTH) * (double)warm);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(frames_go_on_and_memory_is_flat)};
    frames = argc > 1 ? atol(argv[1]) : frames;
    seed = argc > 2 ? (uint64_t)atol(argv[2]) : seed;
    return cmocka_run_group_tests(tests, job_setup, job_teardown);
}
