/* Jobs that end otherwise: cancelled at any time, refused, or with their plan. */
#include "job_fixture.h"

#include <pthread.h>
#include <time.h>

/* Others have the core meanwhile. */
static void pause_shortly(void)
{
    nanosleep(&(struct timespec){.tv_nsec = 50000}, NULL);
}

static void make_plan(const job_fixture *f, int kind, int parts, int queues, hada_plan **plan)
{
    hada_plan_options options = f->options[kind];
    options.queues = queues;
    options.batch = 2; /* many batches */
    ASSERT_OK(hada_plan_create_on(plan, parts ? f->part : &f->whole, parts ? parts : 1, f->model, &options, err));
}

/* Either it was in time, or the result is whole. */
static int was_cancelled(const job_fixture *f, int kind, int frame, hada_job *job, const hada_result *result)
{
    hada_error error = {0};
    const hada_status status = hada_job_wait(job, &error);
    const hada_job_state state = hada_job_poll(job);
    if (status == HADA_ERROR_CANCELLED) {
        assert_int_equal(state, HADA_JOB_CANCELLED);
        assert_int_equal(error.status, HADA_ERROR_CANCELLED);
        assert_true(error.message[0]);
        assert_int_equal(result->depths, 0);
        assert_null(result->planes);
        assert_int_equal(hada_job_wait(job, NULL), HADA_ERROR_CANCELLED);
        return 1;
    }
    assert_int_equal(status, HADA_OK);
    assert_int_equal(state, HADA_JOB_DONE);
    assert_true(job_same(result, &f->expected[kind][frame]));
    return 0;
}

/* Asks a running job to end at each part of its progress: in time or too late, as whoever asks gets a turn. */
TEST(ends_at_every_stage)
{
    const job_fixture *f = *state;
    for (int kind = 0; kind < JOB_KINDS; kind++)
        for (int parts = 0; parts <= 2; parts += 2) {
            SCOPED(hada_plan) * plan;
            SCOPED(hada_result) result = {0};
            make_plan(f, kind, parts, 1, &plan);
            for (int i = 0; i < 60; i++) {
                const double when = (double)(i % 12) / 12;
                SCOPED(hada_job) * job;
                ASSERT_OK(hada_job_submit(&job, plan, &f->frames[i % JOB_FRAMES], &result, err));
                while (hada_job_poll(job) == HADA_JOB_WAITING)
                    pause_shortly();
                while (hada_job_progress(job) < when)
                    pause_shortly();
                hada_job_cancel(job);
                hada_job_cancel(job);
                was_cancelled(f, kind, i % JOB_FRAMES, job, &result);
                hada_job_cancel(job); /* too late to change anything */
                assert_true(hada_job_poll(job) >= HADA_JOB_DONE);
            }
            /* and the plan works on */
            ASSERT_OK(hada_plan_run(plan, &f->frames[0], &result, err));
            assert_true(job_same(&result, &f->expected[kind][0]));
        }
}

/* In the midst of its frame, for certain. */
TEST(a_running_job_ends_when_asked)
{
    const job_fixture *f = *state;
    for (int kind = 0; kind < JOB_KINDS; kind++)
        for (int parts = 0; parts <= 2; parts += 2) {
            SCOPED(hada_plan) * plan;
            hada_job *job;
            SCOPED(hada_result) result = {0};
            make_plan(f, kind, parts, 1, &plan);
            const job_gate gate = job_hold(plan, 0, parts ? parts : 1);
            ASSERT_OK(hada_job_submit(&job, plan, &f->frames[kind], &result, err));
            while (hada_job_poll(job) == HADA_JOB_WAITING)
                pause_shortly();
            hada_job_cancel(job);
            assert_int_equal(hada_job_poll(job), HADA_JOB_RUNNING);
            job_let_go(&gate);
            const int cancelled = was_cancelled(f, kind, kind, job, &result);
            /* a device with memory of its own may have all of a short frame in its queue by then */
            assert_true(cancelled || !hada_context_device(f->whole)->unified_memory);
            hada_job_destroy(&job);
            ASSERT_OK(hada_plan_run(plan, &f->frames[0], &result, err));
            assert_true(job_same(&result, &f->expected[kind][0]));
        }
}

TEST(ends_while_it_waits)
{
    const job_fixture *f = *state;
    enum { JOBS = 60, QUEUES = 2, LEFT = 3 };
    SCOPED(hada_plan) * plan;
    hada_job *jobs[JOBS];
    hada_result results[JOBS] = {{0}};
    make_plan(f, JOB_PURSUED, 0, QUEUES, &plan);
    const job_gate gate = job_hold(plan, 0, QUEUES); /* all but two wait */
    for (int i = 0; i < JOBS; i++)
        ASSERT_OK(hada_job_submit(&jobs[i], plan, &f->frames[i % JOB_FRAMES], &results[i], err));
    for (int i = JOBS - 1; i >= LEFT; i--) {
        hada_job_cancel(jobs[i]);
        assert_int_equal(hada_job_poll(jobs[i]), HADA_JOB_CANCELLED);
    }
    job_let_go(&gate);
    for (int i = 0; i < JOBS; i++)
        assert_int_equal(was_cancelled(f, JOB_PURSUED, i % JOB_FRAMES, jobs[i], &results[i]), i >= LEFT);
    for (int i = 0; i < JOBS; i++) {
        hada_job_destroy(&jobs[i]);
        hada_result_destroy(&results[i]);
    }
}

typedef struct watch {
    const hada_job *job;
    int fell;
    atomic_int steps;
} watch;

static void *watch_progress(void *argument)
{
    watch *w = argument;
    double before = 0;
    while (hada_job_poll(w->job) < HADA_JOB_DONE) {
        const double now = hada_job_progress(w->job);
        w->fell += now < before || now > 1;
        w->steps += now > before;
        before = now;
        pause_shortly();
    }
    return NULL;
}

TEST(progress_never_falls)
{
    const job_fixture *f = *state;
    for (int kind = 0; kind < JOB_KINDS; kind++) {
        SCOPED(hada_plan) * plan;
        make_plan(f, kind, 2, 1, &plan);
        for (int i = 0; i < JOB_FRAMES; i++) {
            SCOPED(hada_job) * job;
            SCOPED(hada_result) result = {0};
            pthread_t thread;
            const job_gate gate = job_hold(plan, 0, 2);
            ASSERT_OK(hada_job_submit(&job, plan, &f->frames[i], &result, err));
            watch w = {.job = job};
            assert_int_equal(pthread_create(&thread, NULL, watch_progress, &w), 0);
            while (!w.steps) /* the frame is handed to the device, and that is seen */
                pause_shortly();
            job_let_go(&gate);
            ASSERT_OK(hada_job_wait(job, err));
            pthread_join(thread, NULL);
            assert_int_equal(w.fell, 0);
            assert_true(hada_job_progress(job) == 1.0);
        }
    }
}

/* A plan goes while its jobs wait, run, and are done; they are asked afterwards. */
TEST(outlives_its_plan)
{
    const job_fixture *f = *state;
    enum { JOBS = 8 };
    for (int round = 0; round < 24; round++) {
        const int kind = round % JOB_KINDS, parts = round % 3 ? 2 : 0;
        hada_plan *plan;
        hada_job *jobs[JOBS];
        hada_result results[JOBS] = {{0}};
        make_plan(f, kind, parts, 1 + round % 2, &plan);
        for (int i = 0; i < JOBS; i++)
            ASSERT_OK(hada_job_submit(&jobs[i], plan, &f->frames[i % JOB_FRAMES], &results[i], err));
        if (round % 4)
            while (hada_job_progress(jobs[0]) < 0.25 * (round % 4))
                pause_shortly();
        hada_plan_destroy(&plan);
        for (int i = 0; i < JOBS; i++) {
            assert_true(hada_job_poll(jobs[i]) >= HADA_JOB_DONE);
            was_cancelled(f, kind, i % JOB_FRAMES, jobs[i], &results[i]);
            hada_job_destroy(&jobs[i]);
            hada_result_destroy(&results[i]);
        }
        assert_int_equal(hada_context_bytes(parts ? f->part[0] : f->whole), 0);
    }
}

/* However far its jobs are when it goes: of these the first takes seconds. */
TEST(endless_jobs_end_with_their_plan)
{
    const job_fixture *f = *state;
    enum { JOBS = 4, STEPS = 100000 };
    for (int kind = JOB_REFINED; kind <= JOB_PURSUED; kind++)
        for (int parts = 0; parts <= 2; parts += 2) {
            hada_plan *plan;
            hada_job *jobs[JOBS];
            hada_result results[JOBS] = {{0}};
            hada_plan_options options = f->options[kind];
            options.refine = STEPS;
            ASSERT_OK(
                hada_plan_create_on(&plan, parts ? f->part : &f->whole, parts ? parts : 1, f->model, &options, err));
            for (int i = 0; i < JOBS; i++)
                ASSERT_OK(hada_job_submit(&jobs[i], plan, &f->frames[i], &results[i], err));
            while (hada_job_poll(jobs[0]) == HADA_JOB_WAITING)
                pause_shortly();
            hada_plan_destroy(&plan);
            for (int i = 0; i < JOBS; i++) {
                assert_int_equal(was_cancelled(f, kind, i, jobs[i], &results[i]), 1);
                hada_job_destroy(&jobs[i]);
            }
            assert_int_equal(hada_context_bytes(parts ? f->part[0] : f->whole), 0);
        }
}

/* What cannot be done is refused at once, or fails alone. */
TEST(refuses_what_cannot_be_done)
{
    const job_fixture *f = *state;
    SCOPED(hada_plan) * plan;
    SCOPED(hada_job) * job, *good;
    hada_error error = {0};
    hada_result result = {0}, other = {0};
    SCOPED(hada_image) small, broken;
    hada_context *const twice[] = {f->whole, f->whole};
    ASSERT_FAILS(hada_plan_create_on(&plan, twice, 2, f->model, NULL, err), HADA_ERROR_ARGUMENT, "");
    assert_null(plan);
    ASSERT_FAILS(hada_plan_create_on(&plan, twice, 0, f->model, NULL, err), HADA_ERROR_ARGUMENT, "");
    for (int queues = -2; queues <= 1000; queues += 1002) /* -1 is HADA_AUTO */ {
        hada_plan_options options = f->options[0];
        options.queues = queues;
        ASSERT_FAILS(hada_plan_create(&plan, f->whole, f->model, &options, err), HADA_ERROR_ARGUMENT, "queues");
    }
    make_plan(f, JOB_LINEAR, 0, 2, &plan);
    ASSERT_OK(hada_image_create(&small, JOB_CHANNELS, JOB_ROWS, JOB_COLS - 1, err));
    ASSERT_FAILS(hada_job_submit(&job, plan, &small, &result, err), HADA_ERROR_MODEL, "");
    assert_null(job);
    hada_job_cancel(NULL);
    hada_job_destroy(NULL);
    {
        const job_gate gate = job_hold(plan, 0, 2); /* a result has one job at a time */
        ASSERT_OK(hada_job_submit(&good, plan, &f->frames[1], &other, err));
        ASSERT_FAILS(hada_job_submit(&job, plan, &f->frames[0], &other, err), HADA_ERROR_STATE, "fills this result");
        job_let_go(&gate);
        ASSERT_OK(hada_job_wait(good, err));
        hada_job_destroy(&good);
    }
    ASSERT_OK(hada_image_create(&broken, JOB_CHANNELS, JOB_ROWS, JOB_COLS, err));
    memcpy(broken.data, f->frames[0].data, hada_image_count(&broken) * sizeof(float));
    broken.data[7] = NAN;
    ASSERT_OK(hada_job_submit(&job, plan, &broken, &result, err));
    ASSERT_OK(hada_job_submit(&good, plan, &f->frames[1], &other, err));
    assert_int_equal(hada_job_wait(job, &error), HADA_ERROR_NOT_FINITE);
    assert_int_equal(hada_job_poll(job), HADA_JOB_FAILED);
    assert_non_null(strstr(error.message, "1 pixel"));
    assert_null(result.planes);
    ASSERT_OK(hada_job_wait(good, err));
    assert_true(job_same(&other, &f->expected[JOB_LINEAR][1]));
    hada_result_destroy(&other);
}

FIXTURE(job_setup, job_teardown)
