/* Devices that fail while jobs are in flight: the others take over, with the same bits; a job fails only when none is
 * left. */
#include "fault.h"
#include "job_fixture.h"

enum { LOST = CL_DEVICE_NOT_AVAILABLE, SHORT = CL_MEM_OBJECT_ALLOCATION_FAILURE };

static void lose(const hada_context *context, long n, long count, int code)
{
    fault_lose(&(fault_device_loss){context->cl, n, count, code});
}

/* Runs all frames as jobs. Returns how many gave the expected result; the others must have failed with `status`. */
static int run_all(const job_fixture *f, hada_plan *plan, int kind, hada_status status)
{
    hada_job *jobs[JOB_FRAMES];
    hada_result results[JOB_FRAMES] = {{0}};
    int good = 0;
    for (int i = 0; i < JOB_FRAMES; i++)
        ASSERT_OK(hada_job_submit(&jobs[i], plan, &f->frames[i], &results[i], err));
    for (int i = 0; i < JOB_FRAMES; i++) {
        hada_error error = {0};
        const hada_status ended = hada_job_wait(jobs[i], &error);
        if (!ended) {
            assert_true(job_same(&results[i], &f->expected[kind][i]));
            good++;
        } else {
            assert_int_equal(ended, status);
            assert_int_equal(hada_job_poll(jobs[i]), HADA_JOB_FAILED);
            assert_true(error.message[0]);
            assert_null(results[i].planes);
        }
        hada_job_destroy(&jobs[i]);
        hada_result_destroy(&results[i]);
    }
    return good;
}

static void make_plan(const job_fixture *f, int kind, int parts, int batch, hada_plan **plan)
{
    hada_plan_options options = f->options[kind];
    options.batch = batch;
    ASSERT_OK(hada_plan_create_on(plan, parts ? f->part : &f->whole, parts ? parts : 1, f->model, &options, err));
}

TEST(the_other_device_takes_over)
{
    const job_fixture *f = *state;
    static const long when[] = {1, 2, 5, 9, 17, 40, 100, 250};
    for (int kind = 0; kind < JOB_KINDS; kind++)
        for (size_t i = 0; i < sizeof when / sizeof *when; i++) {
            SCOPED(hada_plan) * plan;
            hada_queue_info queues[2];
            make_plan(f, kind, 2, 3, &plan);
            job_warnings = 0;
            job_asked = plan;
            lose(f->part[i % 2], when[i], 0, LOST);
            assert_int_equal(run_all(f, plan, kind, HADA_OK), JOB_FRAMES);
            fault_lose(NULL);
            job_asked = NULL;
            hada_plan_queues(plan, queues, 2);
            assert_false(queues[1 - i % 2].lost);
            assert_int_equal(queues[i % 2].lost, job_warnings);
        }
}

/* One frame at a time, so that the device that fails is often one that only helps. On a busy machine its lane may not
 * get a turn in a frame: until one was lost. */
TEST(helpers_fail)
{
    const job_fixture *f = *state;
    enum { COMMANDS = 39, MOST = 5000 };
    int lost = 0;
    for (long i = 0; i < COMMANDS || (!lost && i < MOST); i++) {
        const long n = 1 + i % COMMANDS;
        SCOPED(hada_plan) * plan;
        hada_queue_info queues[2];
        SCOPED(hada_result) result = {0};
        make_plan(f, JOB_LINEAR, 2, 2, &plan);
        lose(f->part[1], n, 0, LOST);
        for (int k = 0; k < 2; k++) {
            ASSERT_OK(hada_plan_run(plan, &f->frames[k], &result, err));
            assert_true(job_same(&result, &f->expected[JOB_LINEAR][k]));
        }
        fault_lose(NULL);
        hada_plan_queues(plan, queues, 2);
        assert_false(queues[0].lost);
        lost += queues[1].lost;
    }
    assert_true(lost >= 1);
}

/* The frames of the shortest kind are 190 commands and more: whoever does most of them, both devices fail. */
TEST(jobs_fail_when_no_device_is_left)
{
    const job_fixture *f = *state;
    for (int kind = 0; kind < JOB_KINDS; kind++)
        for (long n = 1; n < 50; n += 11) {
            SCOPED(hada_plan) * plan;
            hada_queue_info queues[2];
            make_plan(f, kind, 2, 3, &plan);
            lose(f->part[0], n, 0, LOST);
            lose(f->part[1], 2 * n, 0, LOST);
            assert_true(run_all(f, plan, kind, HADA_ERROR_DEVICE) < JOB_FRAMES);
            fault_lose(NULL);
            /* the devices are back */
            assert_int_equal(run_all(f, plan, kind, HADA_ERROR_DEVICE), JOB_FRAMES);
            hada_plan_queues(plan, queues, 2);
            assert_false(queues[0].lost && queues[1].lost);
        }
}

/* Short of memory once: half the batch, and on. */
TEST(smaller_batches_where_memory_is_short)
{
    const job_fixture *f = *state;
    for (int kind = JOB_LINEAR; kind <= JOB_LISTED; kind++)
        for (long n = 1; n < 30; n += 3) {
            hada_plan *plan;
            hada_queue_info queue;
            hada_result result = {0};
            make_plan(f, kind, 0, 8, &plan);
            job_warnings = 0;
            lose(f->whole, n, 1, SHORT);
            for (int i = 0; i < JOB_FRAMES; i++) {
                ASSERT_OK(hada_plan_run(plan, &f->frames[i], &result, err));
                assert_true(job_same(&result, &f->expected[kind][i]));
            }
            assert_int_equal(job_warnings, 1);
            /* never enough: one depth is tried in the end, and then the frame fails */
            fault_lose(NULL);
            lose(f->whole, 1, 0, SHORT);
            hada_error error = {0};
            assert_int_equal(hada_plan_run(plan, &f->frames[0], &result, &error), HADA_ERROR_DEVICE_MEMORY);
            assert_null(result.planes);
            fault_lose(NULL);
            ASSERT_OK(hada_plan_run(plan, &f->frames[1], &result, err));
            assert_true(job_same(&result, &f->expected[kind][1]));
            assert_int_equal(run_all(f, plan, kind, HADA_OK), JOB_FRAMES);
            hada_plan_queues(plan, &queue, 1);
            assert_false(queue.lost);
            hada_result_destroy(&result);
            hada_plan_destroy(&plan);
            assert_int_equal(hada_context_bytes(f->whole), 0);
        }
}

/* A device that stays short of memory gives up; the other one does its work. */
TEST(a_device_short_of_memory_is_left_out)
{
    const job_fixture *f = *state;
    for (int kind = 0; kind < JOB_KINDS; kind++) {
        SCOPED(hada_plan) * plan;
        hada_queue_info queues[2];
        make_plan(f, kind, 2, 8, &plan);
        lose(f->part[0], 30, 0, SHORT);
        assert_int_equal(run_all(f, plan, kind, HADA_OK), JOB_FRAMES);
        fault_lose(NULL);
        hada_plan_queues(plan, queues, 2);
        assert_false(queues[1].lost);
    }
}

FIXTURE(job_setup, job_teardown)
