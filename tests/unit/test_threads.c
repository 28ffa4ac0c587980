/* Several threads on one context, each with a plan of its own on one model, and a context for each thread: the same
 * bits as one thread alone. Under the thread sanitizer (tests/run.sh tsan) it also finds races; drivers are not built
 * for the sanitizer, so it must leave them out: TSAN_OPTIONS=ignore_noninstrumented_modules=1. */
#include <pthread.h>

#include "camera_small.h"

enum { ROWS = 24, COLS = 32, WINDOW = 12, DEPTHS = 3, CHANNELS = 3, FRAMES = 3, THREADS = 4 };

typedef struct fixture {
    hada_context *context;
    hada_model *model;
    hada_image frames[FRAMES];
    hada_plan_options options[2]; /* linear, refined */
    hada_result expected[2][FRAMES];
} fixture;

/* What a thread does and finds; cmocka's assertions belong to the main thread. */
typedef struct job {
    const fixture *f;
    hada_context *context; /* NULL: one of its own */
    int first;             /* frame to begin with, so that threads do different things at a time */
    hada_status status;
    hada_error error;
    int different;
} job;

static int same(const hada_result *a, const hada_result *b)
{
    return same_result(a, b) && a->report->occupied_count == b->report->occupied_count &&
           a->report->refine_steps == b->report->refine_steps;
}

static hada_status work_with(job *j, hada_context *context, const hada_plan_options *options,
                             const hada_result *expected)
{
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) result = {0};
    hada_status status = hada_plan_create(&plan, context, j->f->model, options, &j->error);
    for (int i = 0; !status && i < 2 * FRAMES; i++) {
        const int frame = (i + j->first) % FRAMES;
        status = hada_plan_run(plan, &j->f->frames[frame], &result, &j->error);
        if (!status)
            j->different += !same(&result, &expected[frame]);
    }
    return status;
}

static void *work(void *argument)
{
    job *j = argument;
    SCOPED(hada_context) *own = NULL;
    if (!j->context)
        j->status = hada_context_create(&own, NULL, &j->error);
    for (int kind = 0; !j->status && kind < 2; kind++)
        j->status = work_with(j, own ? own : j->context, &j->f->options[kind], j->f->expected[kind]);
    return NULL;
}

static void run_threads(const fixture *f, hada_context *context, int count)
{
    pthread_t threads[THREADS];
    job jobs[THREADS];
    for (int i = 0; i < count; i++) {
        jobs[i] = (job){.f = f, .context = context, .first = i};
        assert_int_equal(pthread_create(&threads[i], NULL, work, &jobs[i]), 0);
    }
    for (int i = 0; i < count; i++)
        pthread_join(threads[i], NULL);
    for (int i = 0; i < count; i++) {
        if (jobs[i].status)
            fail_msg("thread %d: %s", i, jobs[i].error.message);
        assert_int_equal(jobs[i].different, 0);
    }
}

static void make_frames(fixture *f)
{
    const double distances[DEPTHS] = {100.0, 200.0, 400.0};
    hada_image psf[DEPTHS];
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = WINDOW;
    options.boundary = HADA_BOUNDARY_CIRCULAR;
    for (int z = 0; z < DEPTHS; z++)
        psf[z] = small_psf(CHANNELS, ROWS, COLS, 12, (uint64_t)z + 1);
    for (int i = 0; i < FRAMES; i++) {
        SCOPED(hada_image) scene = small_scene(CHANNELS, WINDOW, WINDOW, (uint64_t)i + 1);
        f->frames[i] = small_frame(&psf[i % DEPTHS], &scene, 0, 0.003, (uint64_t)i + 1);
    }
    ASSERT_OK(hada_model_from_psf(&f->model, f->context, psf, DEPTHS, distances, &options, err));
    destroy_images(psf, DEPTHS);
}

static int setup(void **state)
{
    static fixture f;
    ASSERT_OK(hada_context_create(&f.context, NULL, err));
    make_frames(&f);
    for (int kind = 0; kind < 2; kind++) {
        SCOPED(hada_plan) * plan;
        hada_plan_options_init(&f.options[kind]);
        f.options[kind].refine = kind ? 5 : 0;
        f.options[kind].refine_tv = HADA_REFINE_TV_FRAME; /* frames come in any order */
        f.options[kind].dark = HADA_DARK_NONE;
        ASSERT_OK(hada_plan_create(&plan, f.context, f.model, &f.options[kind], err));
        for (int i = 0; i < FRAMES; i++)
            ASSERT_OK(hada_plan_run(plan, &f.frames[i], &f.expected[kind][i], err));
    }
    *state = &f;
    return 0;
}

static int teardown(void **state)
{
    fixture *f = *state;
    for (int i = 0; i < FRAMES; i++) {
        hada_image_destroy(&f->frames[i]);
        hada_result_destroy(&f->expected[0][i]);
        hada_result_destroy(&f->expected[1][i]);
    }
    hada_model_destroy(&f->model);
    hada_context_destroy(&f->context);
    return 0;
}

/* The frames and the two kinds of work differ, or equal results would prove nothing. */
TEST(there_is_something_to_compare)
{
    const fixture *f = *state;
    assert_true(same(&f->expected[0][0], &f->expected[0][0]));
    assert_false(same(&f->expected[0][0], &f->expected[0][1]));
    assert_false(same(&f->expected[0][0], &f->expected[1][0]));
    assert_true(f->expected[1][0].report->refine_steps > 0);
}

TEST(threads_share_a_context)
{
    const fixture *f = *state;
    const uint64_t before = hada_context_bytes(f->context);
    run_threads(f, f->context, THREADS);
    assert_int_equal(hada_context_bytes(f->context), before);
}

/* Here the threads also meet where programs are made: nothing is compiled yet. */
TEST(threads_share_a_new_context)
{
    const fixture *f = *state;
    SCOPED(hada_context) * context;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    run_threads(f, context, THREADS);
    assert_int_equal(hada_context_bytes(context), 0);
}

TEST(contexts_are_independent)
{
    run_threads(*state, NULL, 2);
}

FIXTURE(setup, teardown)
