/* Classic methods in plans: what they converge to, their stopping rules, settings, memory, and jobs that end early. */
#include <sched.h>

#include "camera_small.h"
#include "model/model.h"

enum { ROWS = 40, COLS = 48, WINDOW = 16, DEPTHS = 3, CHANNELS = 3 };

typedef struct fixture {
    hada_context *context;
    hada_model *model[2]; /* circular, padded */
    hada_image scene[2];  /* at the first and the last depth */
    hada_image frame;     /* of both, without noise: no light leaves it */
} fixture;

/* Blocks of light on black: what total variation is made for. */
static hada_image blocks(uint64_t seed)
{
    hada_image scene = small_scene(CHANNELS, WINDOW, WINDOW, seed);
    for (int c = 0; c < CHANNELS; c++)
        for (int i = 0; i < WINDOW; i++)
            for (int j = 0; j < WINDOW; j++) {
                const int inside = (int)seed == 1 ? i >= 2 && i < 8 && j >= 3 && j < 10 : i >= 8 && i < 14 && j >= 5;
                scene.data[(c * WINDOW + i) * WINDOW + j] = inside ? 0.4f + 0.2f * (float)c : 0.0f;
            }
    return scene;
}

static int setup(void **state)
{
    fixture *f = calloc(1, sizeof *f);
    hada_image psf[DEPTHS];
    double distances[DEPTHS];
    ASSERT_OK(hada_context_create(&f->context, NULL, err));
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = WINDOW;
    options.psf_dark = options.dark = 0;
    for (int z = 0; z < DEPTHS; z++) {
        distances[z] = 100.0 * (z + 1);
        psf[z] = small_psf(CHANNELS, ROWS, COLS, 8, (uint64_t)z + 1);
    }
    for (int padded = 0; padded < 2; padded++) {
        options.boundary = padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
        ASSERT_OK(hada_model_from_psf(&f->model[padded], f->context, psf, DEPTHS, distances, &options, err));
    }
    f->scene[0] = blocks(1);
    f->scene[1] = blocks(2);
    f->frame = small_frame(&psf[0], &f->scene[0], 0, 0, 1);
    hada_image other = small_frame(&psf[DEPTHS - 1], &f->scene[1], 0, 0, 1);
    for (size_t i = 0; i < hada_image_count(&f->frame); i++)
        f->frame.data[i] += other.data[i];
    hada_image_destroy(&other);
    destroy_images(psf, DEPTHS);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    fixture *f = *state;
    hada_model_destroy(&f->model[0]);
    hada_model_destroy(&f->model[1]);
    hada_image_destroy(&f->scene[0]);
    hada_image_destroy(&f->scene[1]);
    hada_image_destroy(&f->frame);
    hada_context_destroy(&f->context);
    free(f);
    return 0;
}

/* Of the options that were made last. */
static hada_classic_options classic;

static hada_plan_options options_of(hada_method method, int iterations)
{
    static const int both[] = {0, DEPTHS - 1};
    DEFAULTS(hada_plan_options, options);
    hada_classic_options_init(&classic);
    classic.method = method;
    classic.iterations = iterations;
    options.classic = &classic;
    options.occupied = HADA_OCCUPIED_LIST;
    options.occupied_list = both;
    options.occupied_count = 2;
    options.skip = 0;
    return options;
}

static void run(const fixture *f, int padded, const hada_plan_options *options, hada_result *result)
{
    plan_once(f->context, f->model[padded], options, &f->frame, result);
}

static double error_of(const fixture *f, const hada_result *result)
{
    const size_t count = hada_image_count(&f->scene[0]);
    return fmax(relative_change(result->planes[0].data, f->scene[0].data, count),
                relative_change(result->planes[DEPTHS - 1].data, f->scene[1].data, count));
}

/* All methods come near the scene at both depths, better with iterations; the depth between them stays dark. */
TEST(finds_both_depths)
{
    static const struct {
        hada_method method;
        hada_prior prior;
        double weight, allowed; /* error of the worse plane */
    } cases[] = {{HADA_METHOD_RL, HADA_PRIOR_NONE, 0, 0.10},          {HADA_METHOD_RL, HADA_PRIOR_TV, 2e-3, 0.10},
                 {HADA_METHOD_FISTA, HADA_PRIOR_NONE, 0, 0.10},       {HADA_METHOD_FISTA, HADA_PRIOR_TV, 1e-5, 0.10},
                 {HADA_METHOD_FISTA, HADA_PRIOR_WAVELET, 1e-5, 0.10}, {HADA_METHOD_FISTA, HADA_PRIOR_HAAR, 1e-5, 0.10},
                 {HADA_METHOD_ADMM, HADA_PRIOR_NONE, 0, 0.10},        {HADA_METHOD_ADMM, HADA_PRIOR_TV, 1e-5, 0.10}};
    const fixture *f = *state;
    for (int padded = 0; padded < 2; padded++)
        for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
            hada_plan_options options = options_of(cases[i].method, 20);
            SCOPED(hada_result) few = {0}, many = {0};
            classic.prior = cases[i].prior;
            classic.weight = cases[i].weight;
            classic.support = HADA_SUPPORT_WINDOW;
            run(f, padded, &options, &few);
            classic.iterations = 300;
            run(f, padded, &options, &many);
            if (error_of(f, &many) > cases[i].allowed)
                fail_msg("method %d, prior %d, boundary %d: error %.3g", cases[i].method, cases[i].prior, padded,
                         error_of(f, &many));
            assert_true(error_of(f, &many) < error_of(f, &few));
            assert_true(many.report->residual < few.report->residual && many.report->residual < 0.02);
            assert_int_equal(few.report->refine_steps, 20);
            assert_int_equal(many.report->method, cases[i].method);
            assert_int_equal(many.report->occupied_count, 2);
            for (size_t k = 0; k < hada_image_count(&many.planes[1]); k++)
                assert_true(many.planes[1].data[k] == 0);
        }
}

/* Transfer functions that were learned have noise, which gives point spread functions negative values: Richardson-Lucy
 * takes them for noise instead of dividing by them. */
TEST(lucy_tolerates_noisy_optics)
{
    const fixture *f = *state;
    hada_model *const model = f->model[0];
    const size_t values = hada_model_plane(model) * (size_t)(DEPTHS * CHANNELS) * 2;
    const hada_plan_options options = options_of(HADA_METHOD_RL, 60);
    SCOPED(hada_result) clean = {0}, noisy = {0};
    hada_random random;
    SCOPED_MEMORY float *kept = malloc(values * sizeof *kept);
    memcpy(kept, model->otf, values * sizeof *kept);
    hada_random_seed(&random, 5, 0);
    run(f, 0, &options, &clean);
    for (size_t i = 0; i < values; i++)
        model->otf[i] += i % hada_model_plane(model) ? 0.03f * (float)hada_random_normal(&random) : 0.0f;
    run(f, 0, &options, &noisy);
    memcpy(model->otf, kept, values * sizeof *kept);
    assert_true(clean.report->residual < 0.01 && noisy.report->residual < 0.1);
    assert_true(error_of(f, &noisy) < 0.4);
}

/* Without other depths and without iterations: the Wiener filter of the model itself, clipped. */
TEST(wiener_of_one_depth_is_the_models)
{
    const fixture *f = *state;
    static const int one = 1;
    for (int padded = 0; padded < 2; padded++) {
        hada_plan_options options = options_of(HADA_METHOD_WIENER, 1), linear;
        SCOPED(hada_result) joint = {0}, single = {0};
        SCOPED(hada_model) * wiener;
        options.depths = &one;
        options.depth_count = 1;
        options.occupied = HADA_OCCUPIED_ALL;
        options.occupied_list = NULL;
        options.occupied_count = 0;
        classic.lambda = 0.05;
        run(f, padded, &options, &joint);
        ASSERT_OK(hada_model_with_form(&wiener, f->model[padded], HADA_FORM_WIENER, 0.05, err));
        linear = options;
        linear.classic = NULL;
        linear.refine = 0;
        plan_once(f->context, wiener, &linear, &f->frame, &single);
        /* the model reckons with each channel's mean |H|^2, the joint filter with that of all: here nearly the same */
        assert_true(relative_change(joint.planes[0].data, single.planes[0].data, hada_image_count(&single.planes[0])) <
                    0.01);
        assert_int_equal(joint.report->refine_steps, 0);
    }
}

/* A frame a thousand times as bright gives planes a thousand times as bright; two runs give the same bits. */
TEST(scales_and_repeats)
{
    const fixture *f = *state;
    const size_t count = hada_image_count(&f->scene[0]);
    SCOPED(hada_image) bright;
    ASSERT_OK(hada_image_create(&bright, CHANNELS, ROWS, COLS, err));
    for (size_t i = 0; i < hada_image_count(&bright); i++)
        bright.data[i] = 1024 * f->frame.data[i];
    for (int method = HADA_METHOD_WIENER; method <= HADA_METHOD_ADMM; method++) {
        const hada_plan_options options = options_of((hada_method)method, 12);
        SCOPED(hada_plan) * plan;
        SCOPED(hada_result) first = {0}, again = {0}, scaled = {0};
        uint64_t device, host, held;
        ASSERT_OK(hada_plan_estimate(f->context, f->model[1], &options, &device, &host, err));
        ASSERT_OK(hada_plan_create(&plan, f->context, f->model[1], &options, err));
        hada_plan_memory(plan, &held, NULL);
        assert_true(held > 0 && held <= device);
        ASSERT_OK(hada_plan_run(plan, &f->frame, &first, err));
        ASSERT_OK(hada_plan_run(plan, &bright, &scaled, err));
        ASSERT_OK(hada_plan_run(plan, &f->frame, &again, err));
        for (int z = 0; z < DEPTHS; z++)
            assert_memory_equal(first.planes[z].data, again.planes[z].data, count * sizeof(float));
        for (size_t i = 0; i < count; i++)
            scaled.planes[0].data[i] /= 1024;
        assert_true(relative_change(scaled.planes[0].data, first.planes[0].data, count) < 1e-5);
    }
}

TEST(stops_by_rule)
{
    const fixture *f = *state;
    for (int method = HADA_METHOD_RL; method <= HADA_METHOD_ADMM; method++) {
        hada_plan_options options = options_of((hada_method)method, 400);
        SCOPED(hada_result) loose = {0}, tight = {0}, timed = {0};
        classic.stop = 3e-2;
        run(f, 1, &options, &loose);
        classic.stop = 3e-3;
        run(f, 1, &options, &tight);
        assert_in_range(loose.report->refine_steps, 3, 200);
        assert_in_range(tight.report->refine_steps, loose.report->refine_steps, 399);
        classic.stop = 0;
        classic.seconds = 1e-9; /* one iteration and no more */
        run(f, 1, &options, &timed);
        assert_int_equal(timed.report->refine_steps, 1);
    }
}

TEST(darkness_stays_dark)
{
    const fixture *f = *state;
    SCOPED(hada_image) black;
    ASSERT_OK(hada_image_create(&black, CHANNELS, ROWS, COLS, err));
    for (int method = HADA_METHOD_WIENER; method <= HADA_METHOD_ADMM; method++) {
        const hada_plan_options options = options_of((hada_method)method, 5);
        SCOPED(hada_result) result = {0};
        plan_once(f->context, f->model[1], &options, &black, &result);
        for (size_t i = 0; i < hada_image_count(&result.planes[0]); i++)
            assert_true(fabsf(result.planes[0].data[i]) <= 1e-30f);
    }
}

static void refuse(const fixture *f, const hada_plan_options *options, hada_status expected, const char *words)
{
    hada_plan *plan;
    hada_error error = {0};
    assert_int_equal(hada_plan_create(&plan, f->context, f->model[0], options, &error), expected);
    assert_null(plan);
    if (!strstr(error.message, words))
        fail_msg("no '%s' in: %s", words, error.message);
}

TEST(refuses_what_makes_no_sense)
{
    const fixture *f = *state;
    hada_plan_options options = options_of(HADA_METHOD_RL, 10);
    classic.prior = HADA_PRIOR_WAVELET;
    refuse(f, &options, HADA_ERROR_ARGUMENT, "no such prior");
    options = options_of(HADA_METHOD_FISTA, 0);
    refuse(f, &options, HADA_ERROR_ARGUMENT, "iterations is 0");
    options = options_of(HADA_METHOD_FISTA, 10);
    classic.step = 2;
    refuse(f, &options, HADA_ERROR_ARGUMENT, "step");
    options = options_of(HADA_METHOD_ADMM, 10);
    classic.mu3 = 0;
    refuse(f, &options, HADA_ERROR_ARGUMENT, "mu3");
    options = options_of((hada_method)9, 10);
    refuse(f, &options, HADA_ERROR_ARGUMENT, "method");
    options = options_of(HADA_METHOD_ADMM, 10);
    options.band = 0.5;
    refuse(f, &options, HADA_ERROR_ARGUMENT, "band");
    options = options_of(HADA_METHOD_ADMM, 10);
    hada_model *const model = f->model[0];
    model->info.has_otf = 0;
    refuse(f, &options, HADA_ERROR_MODEL, "no transfer functions");
    model->info.has_otf = 1;
}

/* A run that would take minutes ends when it is asked to, and the plan works on. */
TEST(can_be_cancelled)
{
    const fixture *f = *state;
    hada_plan_options options = options_of(HADA_METHOD_ADMM, 10000000);
    SCOPED(hada_plan) * plan;
    hada_job *job;
    hada_result result = {0};
    ASSERT_OK(hada_plan_create(&plan, f->context, f->model[1], &options, err));
    for (int i = 0; i < 2; i++) {
        ASSERT_OK(hada_job_submit(&job, plan, &f->frame, &result, err));
        while (!(hada_job_progress(job) > 0))
            sched_yield();
        hada_job_cancel(job);
        assert_int_equal(hada_job_wait(job, NULL), HADA_ERROR_CANCELLED);
        assert_null(result.planes);
        hada_job_destroy(&job);
    }
}

FIXTURE(setup, teardown)
