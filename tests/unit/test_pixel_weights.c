/* A camera known by its point spread function alone: the weight of total variation that a frame chooses, saturated
 * pixels, pixels that are not finite. */
#include "camera_small.h"
#include "device_fixture.h"
#include "planes/weight_search.h"

enum { ROWS = 60, COLS = 72, WINDOW = 24, CHANNELS = 3 };

typedef struct bench {
    hada_image psf, scene;
    hada_model *model;
    const hada_classic_options *classic; /* NULL: refinement */
} bench;

static hada_classic_options classic_of(hada_method method, double weight)
{
    DEFAULTS(hada_classic_options, options);
    options.method = method;
    options.iterations = 60;
    options.prior = HADA_PRIOR_TV;
    options.weight = weight;
    options.support = HADA_SUPPORT_WINDOW;
    return options;
}

/* A fainter spot on the axis, so that light which saturates a pixel reaches others. */
static void dim_axis(hada_image *psf)
{
    const int area = psf->rows * psf->cols;
    for (int c = 0; c < CHANNELS; c++) {
        float *to = psf->data + c * area, *axis = to + (psf->rows / 2) * psf->cols + psf->cols / 2;
        const float rest = 1.0f - 0.8f * *axis;
        *axis *= 0.2f;
        for (int i = 0; i < area; i++)
            to[i] /= rest;
    }
}

/* Blocks of light: what total variation is made for. */
static bench make(hada_boundary boundary)
{
    const double distance = 100.0;
    bench b = {.psf = small_psf(CHANNELS, ROWS, COLS, 8, 3), .scene = small_scene(CHANNELS, WINDOW, WINDOW, 1)};
    for (int c = 0; c < CHANNELS; c++)
        for (int i = 0; i < WINDOW; i++)
            for (int j = 0; j < WINDOW; j++) {
                const int inside = i >= 3 && i < 15 && j >= 5 && j < 18;
                b.scene.data[(c * WINDOW + i) * WINDOW + j] = inside ? 0.4f + 0.2f * (float)c : 0.15f;
            }
    dim_axis(&b.psf);
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = WINDOW;
    options.psf_dark = options.dark = 0;
    options.boundary = boundary;
    ASSERT_OK(hada_model_from_psf(&b.model, context, &b.psf, 1, &distance, &options, err));
    assert_true(hada_model_get_info(b.model)->refine_tv == HADA_AUTO);
    return b;
}

static void unmake(bench *b)
{
    hada_image_destroy(&b->psf);
    hada_image_destroy(&b->scene);
    hada_model_destroy(&b->model);
}

/* A scene that goes on beyond the frame: blocks of light in one of `rows` x `cols`, of which the window has the middle,
 * as a sensor of ROWS x COLS sees it. The window is the whole frame. */
enum { WIDE_ROWS = ROWS + 40, WIDE_COLS = COLS + 44 };

static hada_image part_of(const hada_image *from, int rows, int cols)
{
    hada_image part;
    const int row0 = (from->rows - rows) / 2, col0 = (from->cols - cols) / 2;
    ASSERT_OK(hada_image_create(&part, from->channels, rows, cols, err));
    for (int c = 0; c < from->channels; c++)
        for (int i = 0; i < rows; i++)
            memcpy(part.data + ((size_t)c * (size_t)rows + (size_t)i) * (size_t)cols,
                   from->data + ((size_t)c * (size_t)from->rows + (size_t)(row0 + i)) * (size_t)from->cols + col0,
                   (size_t)cols * sizeof *part.data);
    return part;
}

static bench make_wide(hada_image *frame)
{
    const double distance = 100.0;
    SCOPED(hada_image) wide = small_psf(CHANNELS, WIDE_ROWS, WIDE_COLS, 8, 3);
    dim_axis(&wide);
    SCOPED(hada_image) scene = small_scene(CHANNELS, WIDE_ROWS, WIDE_COLS, 1);
    for (int c = 0; c < CHANNELS; c++)
        for (int i = 0; i < WIDE_ROWS; i++)
            for (int j = 0; j < WIDE_COLS; j++) {
                const int beside = i < (WIDE_ROWS - ROWS) / 2; /* a lamp above the window */
                scene.data[(c * WIDE_ROWS + i) * WIDE_COLS + j] = beside                  ? 1.5f
                                                                  : (i / 11 + j / 13) % 2 ? 0.4f + 0.2f * (float)c
                                                                                          : 0.15f;
            }
    SCOPED(hada_image) seen = small_frame(&wide, &scene, 1, 0.003, 5);
    bench b = {.psf = part_of(&wide, ROWS, COLS), .scene = part_of(&scene, ROWS, COLS)};
    *frame = part_of(&seen, ROWS, COLS);
    DEFAULTS(hada_psf_options, options);
    options.psf_dark = options.dark = 0;
    ASSERT_OK(hada_model_from_psf(&b.model, context, &b.psf, 1, &distance, &options, err));
    return b;
}

/* Error of the plane, and the report. weights: of pixels; NULL: none. */
static double solve_weighed(const bench *b, const hada_image *frame, const hada_image *weights, double tv, int repair,
                            hada_report *report)
{
    DEFAULTS(hada_plan_options, options);
    options.pixel_weights = weights;
    options.classic = b->classic;
    SCOPED(hada_result) result = {0};
    hada_plan *plan;
    options.refine_tv = tv;
    options.repair_not_finite = repair;
    ASSERT_OK(hada_plan_create(&plan, context, b->model, &options, err));
    ASSERT_OK(hada_plan_run(plan, frame, &result, err));
    const double error = relative_change(result.planes[0].data, b->scene.data, hada_image_count(&b->scene));
    *report = *result.report;
    hada_plan_destroy(&plan);
    return error;
}

static double solve(const bench *b, const hada_image *frame, double tv, int repair, hada_report *report)
{
    return solve_weighed(b, frame, NULL, tv, repair, report);
}

/* The weight goes by the noise; planes are better than without any, and with little noise than with a large one. */
TEST(frames_choose_their_weight)
{
    static const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    for (size_t k = 0; k < HADA_COUNT(boundaries); k++) {
        bench b = make(boundaries[k]);
        hada_report chosen[2], given;
        for (int strong = 0; strong < 2; strong++) {
            hada_image frame =
                small_frame(&b.psf, &b.scene, boundaries[k] == HADA_BOUNDARY_PADDED, strong ? 0.03 : 0.01, 5);
            const double own = solve(&b, &frame, HADA_REFINE_TV_FRAME, 0, &chosen[strong]);
            const double none = solve(&b, &frame, 0, 0, &given);
            const double much = solve(&b, &frame, 0.3, 0, &given);
            assert_true(given.refine_tv == 0.3 && given.refine_tv_factor == 0);
            if (own > 0.95 * none || own > (strong ? 1.5 : 0.9) * much)
                fail_msg("boundary %zu, noise %d: error %.3g, without total variation %.3g, with much %.3g", k, strong,
                         own, none, much);
            hada_image_destroy(&frame);
        }
        assert_true(chosen[0].refine_tv > 0.0 && chosen[1].refine_tv > chosen[0].refine_tv);
        unmake(&b);
    }
}

/* What a weight leaves of held-out values: a parabola over its logarithm, `least` at `best`, and more by the share
 * `bend` a decade beside it. */
typedef struct curve {
    double best, least, bend;
    int tried;
} curve;

static hada_status predict(void *user, double weight, int *steps, double *left, hada_error *error)
{
    curve *c = user;
    const double decades = log10(weight / c->best);
    (void)error;
    *left = c->least * (1.0 + c->bend * decades * decades);
    ++*steps;
    c->tried++;
    return HADA_OK;
}

/* The weight is the one that predicts best, times the factor, or its mean with the usual one. Where more is left than
 * noise, a larger one that predicts nearly as well is taken. */
TEST(weights_are_found_by_predictions)
{
    SCOPED(hada_image) frame = small_scene(1, 64, 64, 3);
    const hada_model_info info = {.channels = 1};
    hada_frame_exposure exposure = {.info = &info, .mosaic = HADA_MOSAIC_NONE};
    hada_maker_choice choice;
    hada_image_add_noise(&frame, 0.01, 4);
    hada_pixels_init(&exposure.pixels);
    hada_pixels_of_image(&exposure.pixels, &frame);
    exposure.came = exposure.pixels;
    for (size_t i = 0; i < hada_image_count(&frame); i++)
        exposure.energy += (double)frame.data[i] * frame.data[i];
    const double noise = pow(hada_exposure_noise(&exposure) / hada_exposure_light(&exposure), 2.0);
    const double held_out = 0.05 * exposure.energy; /* of all values */
    for (double best = 1e-4; best < 2e-2; best *= 1.7) {
        curve c = {.best = best, .least = 0.9 * noise * held_out, .bend = 0.5};
        hada_weight_search search = {.solve = predict, .user = &c, .factor = 0.6, .doubt = 0.01, .trust = 0.5};
        ASSERT_OK(hada_weight_find(&search, &exposure, &choice, err));
        assert_float_equal(choice.tv, 0.6 * best, 1e-6 * best);
        assert_int_equal(choice.steps, c.tried);
        search.factor = 1.0;
        search.usual = 2.0 * best / pow(0.9 * noise, 2.0 / 3.0); /* the best of the trials leaves a little more */
        ASSERT_OK(hada_weight_find(&search, &exposure, &choice, err));
        assert_float_equal(choice.tv, sqrt(2.0) * best, 0.02 * best);
        search.usual *= 10.0; /* no less than a third of it, found sooner */
        const int tried = c.tried;
        ASSERT_OK(hada_weight_find(&search, &exposure, &choice, err));
        assert_float_equal(choice.tv, 20.0 / sqrt(3.0) * best, 0.5 * best);
        assert_true(2 * (c.tried - tried) <= tried);
        /* nearly all are errors: no mean, and what is left counts as four times the noise */
        c.least = 100.0 * noise * held_out;
        search.usual = 30.0 * best / pow(4.0 * noise, 2.0 / 3.0);
        ASSERT_OK(hada_weight_find(&search, &exposure, &choice, err));
        assert_float_equal(choice.tv, 30.0 * pow(1.0 / 3.0, 0.99) * best, 0.02 * best);
    }
    curve c = {.best = 3e-4, .least = 8.0 * noise * held_out, .bend = 0.1};
    const hada_weight_search search = {.solve = predict, .user = &c, .factor = 1.0, .doubt = 0.01};
    ASSERT_OK(hada_weight_find(&search, &exposure, &choice, err)); /* three quarters are errors of the optics */
    assert_float_equal(choice.tv, 3e-4 * pow(10.0, sqrt(0.0075 / 0.1)), 1e-7);
    c.bend = 0.002; /* the largest one that was tried */
    ASSERT_OK(hada_weight_find(&search, &exposure, &choice, err));
    assert_true(choice.tv > 9e-4);
}

/* Light from outside the window is explained there, and not by what the window shows at its borders. */
TEST(light_comes_from_outside_the_window)
{
    static const hada_support supports[] = {HADA_SUPPORT_AUTO, HADA_SUPPORT_WINDOW};
    SCOPED(hada_image) frame;
    bench b = make_wide(&frame);
    double error[HADA_COUNT(supports)], left[HADA_COUNT(supports)];
    for (size_t k = 0; k < HADA_COUNT(supports); k++) {
        DEFAULTS(hada_plan_options, options);
        SCOPED(hada_result) result = {0};
        SCOPED(hada_plan) * plan;
        options.support = supports[k];
        ASSERT_OK(hada_plan_create(&plan, context, b.model, &options, err));
        ASSERT_OK(hada_plan_run(plan, &frame, &result, err));
        error[k] = relative_change(result.planes[0].data, b.scene.data, hada_image_count(&b.scene));
        left[k] = result.report->residual;
    }
    if (error[0] > 0.8 * error[1] || left[0] > 0.8 * left[1])
        fail_msg("errors with the grid and the window: %.3g, %.3g; unexplained %.3g, %.3g", error[0], error[1], left[0],
                 left[1]);
    unmake(&b);
}

/* With a weight that was found, refinement ends where a hundred steps end, or nearly. */
TEST(found_weights_settle)
{
    bench b = make(HADA_BOUNDARY_PADDED);
    SCOPED(hada_image) frame = small_frame(&b.psf, &b.scene, 1, 0.01, 5);
    hada_result results[2] = {{0}};
    for (int k = 0; k < 2; k++) {
        DEFAULTS(hada_plan_options, options);
        SCOPED(hada_plan) * plan;
        options.refine = k ? 100 : -1;
        ASSERT_OK(hada_plan_create(&plan, context, b.model, &options, err));
        ASSERT_OK(hada_plan_run(plan, &frame, &results[k], err));
    }
    const double apart =
        relative_change(results[0].planes[0].data, results[1].planes[0].data, hada_image_count(&results[0].planes[0]));
    assert_true(results[0].report->refine_tv == results[1].report->refine_tv);
    assert_int_equal(results[1].report->refine_steps, 100);
    if (apart > 0.03 || results[0].report->refine_steps > 40)
        fail_msg("%d steps end %.3g away from 100", results[0].report->refine_steps, apart);
    for (int k = 0; k < 2; k++)
        hada_result_destroy(&results[k]);
    unmake(&b);
}

/* Saturated pixels say "at least this", and pixels that are not finite nothing: the planes are nearly as good. */
TEST(spoiled_pixels_have_weights)
{
    bench b = make(HADA_BOUNDARY_PADDED);
    SCOPED(hada_image) frame = small_frame(&b.psf, &b.scene, 1, 0.002, 5);
    hada_report report;
    const size_t count = hada_image_count(&frame);
    const double good = solve(&b, &frame, 1e-3, 0, &report);
    float largest = 0.0f;
    size_t cut = 0;
    assert_int_equal(report.saturated_pixels, 0);
    for (size_t i = 0; i < count; i++)
        largest = fmaxf(largest, frame.data[i]);
    /* coarse steps are no saturation: the brightest of 40 occurs often, and so does the next one */
    hada_image coarse;
    ASSERT_OK(hada_image_create(&coarse, frame.channels, frame.rows, frame.cols, err));
    for (int white = 0; white < 2; white++) {
        size_t brightest = 0;
        for (size_t i = 0; i < count; i++) {
            const float number = roundf(40.0f * frame.data[i] / largest);
            coarse.data[i] = fminf(number, white ? 24.0f : 34.0f) / 255.0f;
            if (!white && number > 34.0f) /* light that is not cut off thins out */
                coarse.data[i] = (20.0f + (float)(i % 15)) / 255.0f;
            brightest += coarse.data[i] == (white ? 24.0f : 34.0f) / 255.0f;
        }
        solve(&b, &coarse, 1e-3, 0, &report);
        assert_true(brightest >= 16);
        assert_int_equal(report.saturated_pixels, white ? brightest : 0);
    }
    hada_image_destroy(&coarse);
    for (size_t i = 0; i < count; i++)
        if (frame.data[i] > 0.8f * largest) {
            frame.data[i] = 0.8f * largest;
            cut++;
        }
    const double clipped = solve(&b, &frame, 1e-3, 0, &report);
    assert_int_equal(report.saturated_pixels, cut);
    assert_true(cut >= 64);
    for (size_t i = 7; i < count; i += 97)
        frame.data[i] = NAN;
    const double holes = solve(&b, &frame, 1e-3, 1, &report);
    assert_int_equal(report.repaired_pixels, (count - 7 + 96) / 97);
    if (clipped > 1.5 * good || holes > 1.6 * good)
        fail_msg("error %.3g, with %zu saturated pixels %.3g, with holes besides %.3g", good, cut, clipped, holes);
    unmake(&b);
}

/* Pixels that the caller knows to be bad do no harm, with both boundaries; a frame that is half a weight everywhere is
 * as one without weights. */
TEST(bad_pixels_have_no_part)
{
    static const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    for (size_t k = 0; k < HADA_COUNT(boundaries); k++) {
        bench b = make(boundaries[k]);
        SCOPED(hada_image)
        frame = small_frame(&b.psf, &b.scene, boundaries[k] == HADA_BOUNDARY_PADDED, 0.002, 5), weights = {0};
        hada_report report;
        const size_t plane = (size_t)ROWS * COLS;
        ASSERT_OK(hada_image_create(&weights, k ? 1 : CHANNELS, ROWS, COLS, err));
        for (size_t i = 0; i < hada_image_count(&weights); i++)
            weights.data[i] = 0.5f;
        const double good = solve_weighed(&b, &frame, &weights, 1e-3, 0, &report);
        assert_true(k == 0 || fabs(good / solve(&b, &frame, 1e-3, 0, &report) - 1.0) < 1e-3);
        for (size_t i = 5; i < plane; i += 61)
            for (int c = 0; c < CHANNELS; c++) {
                frame.data[(size_t)c * plane + i] = i % 2 ? 3.0f : NAN;
                weights.data[k ? i : (size_t)c * plane + i] = 0.0f;
            }
        const double left_out = solve_weighed(&b, &frame, &weights, 1e-3, 0, &report);
        assert_int_equal(report.repaired_pixels, 0);
        const double taken = solve(&b, &frame, 1e-3, 1, &report);
        if (left_out > 1.3 * good || taken < 5 * good)
            fail_msg("boundary %zu: error %.3g, with bad pixels left out %.3g, taken %.3g", k, good, left_out, taken);
        unmake(&b);
    }
}

/* The classic methods find their weight by the noise as well, with both boundaries; a given one stays. */
TEST(classic_methods_choose_their_weight)
{
    static const hada_method methods[] = {HADA_METHOD_FISTA, HADA_METHOD_ADMM};
    for (int k = 0; k < 4; k++) {
        bench b = make(k % 2 ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR);
        const hada_classic_options own = classic_of(methods[k / 2], HADA_AUTO), given = classic_of(methods[k / 2], 0.3);
        hada_report chosen[2], report;
        for (int strong = 0; strong < 2; strong++) {
            SCOPED(hada_image) frame = small_frame(&b.psf, &b.scene, k % 2, strong ? 0.03 : 0.005, 5);
            b.classic = &own;
            const double error = solve(&b, &frame, HADA_AUTO, 0, &chosen[strong]);
            b.classic = &given;
            const double much = solve(&b, &frame, HADA_AUTO, 0, &report);
            assert_true(report.refine_tv == 0.3 && report.refine_tv_factor == 0);
            assert_int_equal(chosen[strong].refine_steps, own.iterations);
            if (error > (strong ? 1.2 : 0.8) * much)
                fail_msg("case %d, noise %d: error %.3g, with much total variation %.3g", k, strong, error, much);
        }
        if (!(chosen[0].refine_tv > 0.0 && chosen[1].refine_tv > chosen[0].refine_tv))
            fail_msg("case %d: weights %.3g and %.3g", k, chosen[0].refine_tv, chosen[1].refine_tv);
        unmake(&b);
    }
}

/* Saturated and bad pixels do little harm to classic methods (ADMM converges more slowly with them); equal weights are
 * as none, bit for bit. */
TEST(classic_methods_weigh_pixels)
{
    static const hada_method methods[] = {HADA_METHOD_RL, HADA_METHOD_FISTA, HADA_METHOD_ADMM};
    const size_t plane = (size_t)ROWS * COLS;
    for (int k = 0; k < 6; k++) {
        const int padded = k % 2;
        bench b = make(padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR);
        const hada_classic_options given = classic_of(methods[k / 2], 1e-3);
        SCOPED(hada_image) frame = small_frame(&b.psf, &b.scene, padded, 0.002, 5), weights = {0};
        hada_report report;
        float largest = 0.0f;
        b.classic = &given;
        ASSERT_OK(hada_image_create(&weights, 1, ROWS, COLS, err));
        for (size_t i = 0; i < plane; i++)
            weights.data[i] = 0.5f;
        const double good = solve(&b, &frame, HADA_AUTO, 0, &report);
        const double equal = solve_weighed(&b, &frame, &weights, HADA_AUTO, 0, &report);
        assert_true(equal == good);
        for (size_t i = 0; i < hada_image_count(&frame); i++)
            largest = fmaxf(largest, frame.data[i]);
        for (size_t i = 0; i < hada_image_count(&frame); i++)
            frame.data[i] = fminf(frame.data[i], 0.8f * largest);
        for (size_t i = 5; i < plane; i += 61)
            for (int c = 0; c < CHANNELS; c++) {
                frame.data[(size_t)c * plane + i] = i % 2 ? 0.0f : NAN;
                weights.data[i] = 0.0f;
            }
        const double left_out = solve_weighed(&b, &frame, &weights, HADA_AUTO, 0, &report);
        assert_true(report.saturated_pixels >= 64);
        const double taken = solve(&b, &frame, HADA_AUTO, 1, &report);
        if (left_out > 3 * good || left_out > 0.5 * taken)
            fail_msg("case %d: error %.3g, with bad pixels left out %.3g, taken %.3g", k, good, left_out, taken);
        unmake(&b);
    }
}

TEST(supports_that_cannot_be)
{
    bench b = make(HADA_BOUNDARY_CIRCULAR);
    hada_plan *plan;
    hada_error error = {0};
    DEFAULTS(hada_plan_options, options);
    options.support = HADA_SUPPORT_GRID;
    assert_int_equal(hada_plan_create(&plan, context, b.model, &options, &error), HADA_ERROR_ARGUMENT);
    assert_true(strstr(error.message, "padded") != NULL);
    options.support = (hada_support)7;
    assert_int_equal(hada_plan_create(&plan, context, b.model, &options, &error), HADA_ERROR_ARGUMENT);
    unmake(&b);
}

TEST(weights_that_cannot_be)
{
    bench b = make(HADA_BOUNDARY_PADDED);
    DEFAULTS(hada_plan_options, options);
    SCOPED(hada_image) weights = {0}, small = {0};
    hada_plan *plan;
    ASSERT_OK(hada_image_create(&weights, 1, ROWS, COLS, err));
    ASSERT_OK(hada_image_create(&small, 1, ROWS, COLS - 1, err));
    options.pixel_weights = &small;
    ASSERT_FAILS(hada_plan_create(&plan, context, b.model, &options, err), HADA_ERROR_SIZE, "60 x 72");
    options.pixel_weights = &weights;
    ASSERT_FAILS(hada_plan_create(&plan, context, b.model, &options, err), HADA_ERROR_ARGUMENT, "all weights");
    weights.data[7] = 1.0f;
    weights.data[8] = -1.0f;
    ASSERT_FAILS(hada_plan_create(&plan, context, b.model, &options, err), HADA_ERROR_ARGUMENT, "negative");
    weights.data[8] = NAN;
    ASSERT_FAILS(hada_plan_create(&plan, context, b.model, &options, err), HADA_ERROR_ARGUMENT, "finite");
    weights.data[8] = 1.0f;
    options.refine = 0;
    ASSERT_FAILS(hada_plan_create(&plan, context, b.model, &options, err), HADA_ERROR_ARGUMENT, "refine");
    DEFAULTS(hada_classic_options, wiener);
    wiener.method = HADA_METHOD_WIENER;
    options.classic = &wiener;
    ASSERT_FAILS(hada_plan_create(&plan, context, b.model, &options, err), HADA_ERROR_ARGUMENT, "linear filters");
    unmake(&b);
}

/* Twice the same bits, and no weight that is none. */
TEST(repeats_and_refuses)
{
    bench b = make(HADA_BOUNDARY_PADDED);
    SCOPED(hada_image) frame = small_frame(&b.psf, &b.scene, 1, 0.02, 5);
    hada_report first, second;
    DEFAULTS(hada_plan_options, options);
    hada_plan *plan;
    hada_error error;
    assert_true(solve(&b, &frame, HADA_REFINE_TV_FRAME, 0, &first) ==
                solve(&b, &frame, HADA_REFINE_TV_FRAME, 0, &second));
    assert_true(first.refine_tv == second.refine_tv);
    options.refine_tv = -0.5;
    assert_int_equal(hada_plan_create(&plan, context, b.model, &options, &error), HADA_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "-0.5"));
    unmake(&b);
}

FIXTURE(open_device, close_device)
