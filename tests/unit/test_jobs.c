/* Jobs on several queues and devices: the same bits as one lane, whoever did what. */
#include "job_fixture.h"

#include <pthread.h>

#include "image/pixels.h"

/* Ways to work: contexts and queues. */
static const struct way {
    const char *name;
    int parts, queues; /* parts 0: the whole device */
} ways[] = {{"one lane", 0, 1}, {"two queues", 0, 2}, {"two devices", 2, 1}, {"two devices, two queues", 2, 2}};
enum { WAYS = sizeof ways / sizeof *ways };

static void make_plan(const job_fixture *f, const struct way *way, const hada_plan_options *options, hada_plan **plan)
{
    hada_plan_options these = *options;
    these.queues = way->queues;
    hada_context *const *contexts = way->parts ? f->part : &f->whole;
    ASSERT_OK(hada_plan_create_on(plan, contexts, way->parts ? way->parts : 1, f->model, &these, err));
}

static void submit_all(const job_fixture *f, hada_plan *plan, hada_job **jobs, hada_result *results)
{
    for (int i = 0; i < JOB_FRAMES; i++)
        ASSERT_OK(hada_job_submit(&jobs[i], plan, &f->frames[i], &results[i], err));
}

static void check_all(const job_fixture *f, int kind, const char *name, int batch, hada_job **jobs,
                      hada_result *results)
{
    for (int i = 0; i < JOB_FRAMES; i++) {
        assert_int_equal(hada_job_wait_for(jobs[i], 600.0), HADA_JOB_DONE);
        ASSERT_OK(hada_job_wait(jobs[i], err));
        assert_int_equal(hada_job_poll(jobs[i]), HADA_JOB_DONE);
        assert_true(hada_job_progress(jobs[i]) == 1.0);
        if (!job_same(&results[i], &f->expected[kind][i]))
            fail_msg("kind %d, %s, batch %d: frame %d differs", kind, name, batch, i);
        ASSERT_OK(hada_job_wait(jobs[i], err));
        hada_job_destroy(&jobs[i]);
        assert_null(jobs[i]);
    }
}

TEST(gives_the_same_bits_everywhere)
{
    const job_fixture *f = *state;
    hada_result results[JOB_FRAMES] = {{0}};
    hada_job *jobs[JOB_FRAMES];
    for (int kind = 0; kind < JOB_KINDS; kind++)
        for (int w = 0; w < WAYS; w++)
            for (int batch = 0; batch <= (kind < JOB_REFINED ? JOB_DEPTHS : 1); batch++) {
                SCOPED(hada_plan) * plan;
                hada_plan_options options = f->options[kind];
                options.batch = batch;
                make_plan(f, &ways[w], &options, &plan);
                submit_all(f, plan, jobs, results);
                check_all(f, kind, ways[w].name, batch, jobs, results);
            }
    for (int i = 0; i < JOB_FRAMES; i++)
        hada_result_destroy(&results[i]);
}

/* The frames and kinds differ, or equal results would prove nothing. */
TEST(there_is_something_to_compare)
{
    const job_fixture *f = *state;
    for (int kind = 0; kind < JOB_KINDS; kind++) {
        assert_false(job_same(&f->expected[kind][0], &f->expected[kind][1]));
        for (int other = 0; other < kind; other++)
            assert_false(job_same(&f->expected[kind][0], &f->expected[other][0]));
    }
    assert_true(f->expected[JOB_PURSUED][0].report->occupied_count >= 1);
}

/* One frame alone: the other device takes batches of it, and the frame's own lane does the focus. On a busy machine a
 * frame may be done before the other lane gets a turn, so that it takes as many frames as it takes. */
TEST(another_device_helps)
{
    const job_fixture *f = *state;
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) result = {0};
    hada_queue_info queues[2];
    enum { BOTH = 10, MOST = 20000 };
    make_plan(f, &ways[2], &f->options[JOB_LINEAR], &plan);
    int both = 0, runs = 0;
    for (; runs < MOST && both < BOTH; runs++) {
        uint64_t before[2];
        assert_int_equal(hada_plan_queues(plan, queues, 2), 2);
        for (int q = 0; q < 2; q++)
            before[q] = queues[q].batches;
        ASSERT_OK(hada_plan_run(plan, &f->frames[runs % JOB_FRAMES], &result, err));
        assert_true(job_same(&result, &f->expected[JOB_LINEAR][runs % JOB_FRAMES]));
        hada_plan_queues(plan, queues, 2);
        both += queues[0].batches > before[0] && queues[1].batches > before[1];
    }
    assert_int_equal(both, BOTH);
    assert_int_equal(queues[0].frames + queues[1].frames, (uint64_t)runs);
    assert_int_equal(queues[0].device, 0);
    assert_int_equal(queues[1].device, 1);
    assert_true(queues[0].busy_seconds + queues[1].busy_seconds > 0);
    assert_false(queues[0].lost || queues[1].lost);
}

typedef struct submitter {
    const job_fixture *f;
    hada_plan *plan;
    int kind, first, different, run;
    hada_status status;
    hada_error error;
} submitter;

/* Several frames in flight from one thread, or one after the other with hada_plan_run(). */
static void *submit_many(void *argument)
{
    submitter *s = argument;
    enum { AHEAD = 3, ROUNDS = 5 };
    for (int round = 0; !s->status && round < ROUNDS; round++) {
        hada_result results[AHEAD] = {{0}};
        hada_job *jobs[AHEAD] = {NULL};
        for (int i = 0; i < AHEAD; i++) {
            const hada_image *frame = &s->f->frames[(s->first + i) % JOB_FRAMES];
            const hada_status status = s->run ? hada_plan_run(s->plan, frame, &results[i], &s->error)
                                              : hada_job_submit(&jobs[i], s->plan, frame, &results[i], &s->error);
            s->status = s->status ? s->status : status;
        }
        for (int i = 0; i < AHEAD; i++) {
            const hada_status status = jobs[i] ? hada_job_wait(jobs[i], &s->error) : s->status;
            s->status = s->status ? s->status : status;
            hada_job_destroy(&jobs[i]);
            s->different += status || !job_same(&results[i], &s->f->expected[s->kind][(s->first + i) % JOB_FRAMES]);
            hada_result_destroy(&results[i]);
        }
    }
    return NULL;
}

TEST(many_threads_submit)
{
    const job_fixture *f = *state;
    enum { THREADS = 6 };
    for (int w = 0; w < WAYS; w++)
        for (int kind = 0; kind < JOB_KINDS; kind += 2) {
            SCOPED(hada_plan) * plan;
            pthread_t threads[THREADS];
            submitter all[THREADS];
            make_plan(f, &ways[w], &f->options[kind], &plan);
            for (int i = 0; i < THREADS; i++) {
                all[i] = (submitter){.f = f, .plan = plan, .kind = kind, .first = i, .run = i % 2};
                assert_int_equal(pthread_create(&threads[i], NULL, submit_many, &all[i]), 0);
            }
            for (int i = 0; i < THREADS; i++)
                pthread_join(threads[i], NULL);
            for (int i = 0; i < THREADS; i++) {
                if (all[i].status)
                    fail_msg("%s, thread %d: %s", ways[w].name, i, all[i].error.message);
                assert_int_equal(all[i].different, 0);
            }
        }
}

TEST(holds_the_bytes_it_states)
{
    const job_fixture *f = *state;
    for (int kind = 0; kind < JOB_KINDS; kind++)
        for (int queues = 1; queues <= 3; queues++) {
            hada_plan_options options = f->options[kind];
            hada_plan *plan;
            hada_job *jobs[JOB_FRAMES];
            hada_result results[JOB_FRAMES] = {{0}};
            uint64_t device, host;
            options.queues = queues;
            ASSERT_OK(hada_plan_estimate(f->whole, f->model, &options, &device, &host, err));
            hada_context_reset_peak(f->whole);
            ASSERT_OK(hada_plan_create(&plan, f->whole, f->model, &options, err));
            uint64_t exact, apart;
            hada_plan_memory(plan, &exact, &apart);
            assert_true(exact <= apart);
            if (exact != hada_context_bytes(f->whole))
                fail_msg("kind %d, %d queues: %llu bytes told, %llu held", kind, queues, (unsigned long long)exact,
                         (unsigned long long)hada_context_bytes(f->whole));
            submit_all(f, plan, jobs, results);
            check_all(f, kind, "queues", queues, jobs, results);
            const double held = (double)hada_context_peak_bytes(f->whole);
            if (held > 1.1 * (double)device || held < 0.9 * (double)device)
                fail_msg("%d queues: %llu bytes stated, %.0f held", queues, (unsigned long long)device, held);
            hada_plan_destroy(&plan);
            assert_int_equal(hada_context_bytes(f->whole), 0);
            for (int i = 0; i < JOB_FRAMES; i++)
                hada_result_destroy(&results[i]);
        }
}

/* A weight is found by the first frame, by one of another brightness, and by the first one when its turn comes again;
 * the others take it, whoever does what. */
TEST(weights_are_kept_in_order)
{
    static const double light[JOB_FRAMES] = {1.0, 1.04, 2.0, 2.08, 2.05, 1.0};
    static const int chooser[JOB_FRAMES] = {0, 0, 2, 2, 2, 5};
    const job_fixture *f = *state;
    hada_image frames[JOB_FRAMES];
    for (int i = 0; i < JOB_FRAMES; i++) {
        ASSERT_OK(hada_image_copy(&frames[i], &f->frames[0], err));
        for (size_t k = 0; k < hada_image_count(&frames[i]); k++)
            frames[i].data[k] *= (float)light[i];
    }
    for (int kind = JOB_REFINED; kind < JOB_KINDS; kind++) {
        hada_result expected[JOB_FRAMES] = {{0}};
        for (int w = 0; w < WAYS; w++) {
            SCOPED(hada_plan) * plan;
            hada_plan_options options = f->options[kind];
            hada_result results[JOB_FRAMES] = {{0}};
            hada_job *jobs[JOB_FRAMES];
            options.refine_tv = HADA_AUTO;
            make_plan(f, &ways[w], &options, &plan);
            for (int i = 0; i < JOB_FRAMES; i++)
                ASSERT_OK(w ? hada_job_submit(&jobs[i], plan, &frames[i], &results[i], err)
                            : hada_plan_run(plan, &frames[i], &expected[i], err));
            for (int i = 0; w && i < JOB_FRAMES; i++) {
                ASSERT_OK(hada_job_wait(jobs[i], err));
                hada_job_destroy(&jobs[i]);
                assert_true(job_same(&results[i], &expected[i]));
                hada_result_destroy(&results[i]);
            }
        }
        for (int i = 0; i < JOB_FRAMES; i++) {
            const hada_report *report = expected[i].report;
            assert_int_equal(report->refine_tv_kept, chooser[i] != i);
            assert_true(report->refine_tv > 0 && report->refine_tv == expected[chooser[i]].report->refine_tv);
        }
        assert_false(f->expected[kind][1].report->refine_tv_kept);
        for (int i = 0; i < JOB_FRAMES; i++)
            hada_result_destroy(&expected[i]);
    }
    destroy_images(frames, JOB_FRAMES);
}

FIXTURE(job_setup, job_teardown)
