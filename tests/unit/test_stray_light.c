/* Light that frames hold beside the scene's: found, taken off, and left alone where there is none. */
#include "camera_small.h"
#include "device_fixture.h"
#include "image/correct.h"
#include "planes/maker.h"

enum { ROWS = 96, COLS = 112, WINDOW = 44, CHANNELS = 3, PIXELS = ROWS * COLS, VALUES = CHANNELS * PIXELS };
#define NOISE 0.002

static const double distance = 100.0;
/* Of each channel: a surface that is never negative, and a constant. */
static const double surface[CHANNELS][HADA_SMOOTH_TERMS] = {
    {0.10, 0.02, -0.03, 0.01, 0.02, 0.01}, {0.06, -0.01, 0.02, 0.0, -0.02, 0.0}, {0.08, 0.03, 0.0, -0.02, 0.0, 0.02}};
static const double constant[CHANNELS][HADA_SMOOTH_TERMS] = {{0.05}, {0.08}, {0.02}};

/* Dark and bright fields of random colours. */
static hada_image fields(int channels, uint64_t seed)
{
    enum { SIDE = 4 };
    SCOPED(hada_image) colours = small_scene(channels, WINDOW / SIDE, WINDOW / SIDE, seed);
    hada_image scene;
    ASSERT_OK(hada_image_create(&scene, channels, WINDOW, WINDOW, err));
    for (int i = 0; i < channels * WINDOW * WINDOW; i++) {
        const int c = i / WINDOW / WINDOW, row = i / WINDOW % WINDOW / SIDE, col = i % WINDOW / SIDE;
        const float value = colours.data[(c * (WINDOW / SIDE) + row) * (WINDOW / SIDE) + col];
        scene.data[i] = value < 0.4f ? 0.0f : value;
    }
    return scene;
}

typedef struct camera {
    hada_image psf;
    hada_model *model;
    hada_image frame; /* without stray light */
} camera;

static camera camera_of(hada_boundary boundary, int channels, uint64_t seed)
{
    camera of = {.psf = small_psf(channels, ROWS, COLS, 20, seed)};
    SCOPED(hada_image) scene = fields(channels, seed + 1);
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = WINDOW;
    options.boundary = boundary;
    options.psf_dark = 0.0;
    ASSERT_OK(hada_model_from_psf(&of.model, context, &of.psf, 1, &distance, &options, err));
    of.frame = small_frame(&of.psf, &scene, boundary == HADA_BOUNDARY_PADDED, NOISE, seed + 2);
    return of;
}

static void forget(camera *of)
{
    hada_model_destroy(&of->model);
    hada_image_destroy(&of->psf);
    hada_image_destroy(&of->frame);
}

static hada_image lit(const hada_image *frame, const double *weight)
{
    hada_image out;
    ASSERT_OK(hada_image_create(&out, frame->channels, frame->rows, frame->cols, err));
    memcpy(out.data, frame->data, hada_image_count(frame) * sizeof *frame->data);
    hada_smooth_add(weight, 1.0, &out);
    return out;
}

/* Of a frame with this light: how far what is found is off, root of the mean square over the mean of the light. */
static double error_of(const camera *of, const hada_image *frame, const double *weight, const hada_frame_kind *kind,
                       const float *pixel_weights)
{
    const hada_exposure_rule rule = {.energy = 1, .weights = 1, .pixel_weights = pixel_weights};
    const int channels = of->psf.channels, depth = 0;
    double found[CHANNELS * HADA_SMOOTH_TERMS], off = 0.0, light = 0.0;
    hada_frame_exposure exposure;
    hada_pixels pixels;
    int is_found;
    hada_pixels_init(&pixels);
    hada_pixels_of_image(&pixels, frame);
    ASSERT_OK(hada_exposure_begin(&exposure, hada_model_get_info(of->model), kind, &pixels, err));
    ASSERT_OK(hada_exposure_examine(&exposure, &rule, err));
    ASSERT_OK(hada_stray_light_find(&exposure, of->model, &depth, 1, 0, found, &is_found, err));
    if (is_found) { /* the energy is that of the frame without it */
        const double before = exposure.energy;
        ASSERT_OK(hada_exposure_subtract(&exposure, found, err));
        assert_true(exposure.energy < before && exposure.own.data);
    }
    hada_exposure_end(&exposure);
    if (!is_found)
        return NAN;
    for (int c = 0; c < channels; c++)
        for (int i = 0; i < PIXELS; i++) {
            const double here = hada_smooth_at(weight + c * HADA_SMOOTH_TERMS, i / COLS, i % COLS, ROWS, COLS);
            const double there = hada_smooth_at(found + c * HADA_SMOOTH_TERMS, i / COLS, i % COLS, ROWS, COLS);
            off += (here - there) * (here - there) / channels / PIXELS;
            light += here / channels / PIXELS;
        }
    return sqrt(off) / light;
}

TEST(light_is_found)
{
    static const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    for (int b = 0; b < 2; b++)
        for (uint64_t seed = 1; seed < 4; seed++) {
            camera of = camera_of(boundaries[b], seed == 3 ? 1 : CHANNELS, seed);
            SCOPED(hada_image) curved = lit(&of.frame, surface[0]), flat = lit(&of.frame, constant[0]);
            const double off = error_of(&of, &curved, surface[0], &hada_frame_plain, NULL);
            const double off_flat = error_of(&of, &flat, constant[0], &hada_frame_plain, NULL);
            print_message("%s, seed %d: off by %.4f, constant %.4f\n", b ? "padded" : "circular", (int)seed, off,
                          off_flat);
            assert_true(off < 0.05 && off_flat < 0.05);
            assert_true(isnan(error_of(&of, &of.frame, surface[0], &hada_frame_plain, NULL)));
            forget(&of);
        }
}

/* Saturated values, those of weight 0 and the colours that a mosaic lacks take no part. */
TEST(values_without_weight_take_no_part)
{
    static const hada_frame_kind mosaic = {HADA_MOSAIC_RGGB, 1, HADA_MOSAIC_NONE};
    camera of = camera_of(HADA_BOUNDARY_PADDED, CHANNELS, 6);
    SCOPED(hada_image) bright = lit(&of.frame, surface[0]), one;
    SCOPED_MEMORY float *weights = malloc(VALUES * sizeof *weights);
    float most = 0.0f;
    ASSERT_OK(hada_image_create(&one, 1, ROWS, COLS, err));
    for (int i = 0; i < PIXELS; i++)
        one.data[i] = bright.data[hada_mosaic_channel(HADA_MOSAIC_RGGB, i / COLS, i % COLS) * PIXELS + i];
    assert_true(error_of(&of, &one, surface[0], &mosaic, NULL) < 0.05);
    for (int i = 0; i < VALUES; i++) {
        weights[i] = i % 7 ? 1.0f : 0.0f;
        most = fmaxf(most, bright.data[i]);
        if (!(i % 7))
            bright.data[i] = 1e3f;
    }
    assert_true(error_of(&of, &bright, surface[0], &hada_frame_plain, weights) < 0.05);
    for (int i = 0; i < VALUES; i++)
        bright.data[i] = i % 7 ? fminf(bright.data[i], 0.8f * most) : 0.1f;
    assert_true(error_of(&of, &bright, surface[0], &hada_frame_plain, weights) < 0.1);
    forget(&of);
}

static hada_image image_of(hada_plan *plan, const hada_image *frame, hada_report *report)
{
    hada_image image;
    hada_result result = {0};
    ASSERT_OK(hada_plan_run(plan, frame, &result, err));
    *report = *result.report;
    ASSERT_OK(hada_image_create(&image, result.all_in_focus.channels, WINDOW, WINDOW, err));
    memcpy(image.data, result.all_in_focus.data, hada_image_count(&image) * sizeof *image.data);
    hada_result_destroy(&result);
    return image;
}

static double mean_of(const double weight[CHANNELS][HADA_SMOOTH_TERMS])
{
    double mean = 0.0;
    for (int c = 0; c < CHANNELS; c++)
        mean += hada_smooth_mean(weight[c]) / CHANNELS;
    return mean;
}

static hada_plan *plan_of(const camera *of, hada_dark dark, int warm)
{
    hada_plan *plan;
    DEFAULTS(hada_plan_options, options);
    options.dark = dark;
    options.warm_start = warm;
    options.refine_tv = 1e-3;
    options.skip &= ~(unsigned)HADA_SKIP_FRAMES;
    ASSERT_OK(hada_plan_create(&plan, context, of->model, &options, err));
    return plan;
}

/* A frame with stray light gives what it gives without; one that has none is not touched, nor one whose dark level the
 * caller knows. */
TEST(frames_are_reconstructed_without_it)
{
    static const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    for (int b = 0; b < 2; b++) {
        camera of = camera_of(boundaries[b], CHANNELS, 8);
        SCOPED(hada_image) bright = lit(&of.frame, surface[0]);
        SCOPED(hada_plan) *plan = plan_of(&of, HADA_DARK_MODEL, 0), *none = plan_of(&of, HADA_DARK_NONE, 0);
        hada_report clean, told, kept, spoilt;
        SCOPED(hada_image)
        image = image_of(plan, &of.frame, &clean), same = image_of(none, &of.frame, &kept),
        without = image_of(plan, &bright, &told), with = image_of(none, &bright, &spoilt);
        const size_t count = hada_image_count(&image);
        const double off = relative_change(without.data, image.data, count),
                     before = relative_change(with.data, image.data, count);
        print_message("light %.4f of %.4f; off by %.4f, with it %.4f; unexplained %.4f, %.4f, %.4f\n", told.stray_light,
                      mean_of(surface), off, before, clean.residual, told.residual, spoilt.residual);
        assert_true(clean.stray_light == 0.0 && kept.stray_light == 0.0 && spoilt.stray_light == 0.0);
        assert_memory_equal(image.data, same.data, count * sizeof(float));
        assert_true(fabs(told.stray_light / mean_of(surface) - 1.0) < 0.05);
        assert_true(off < 0.1 && before > 4 * off);
        assert_true(told.residual < 2 * clean.residual && spoilt.residual > 4 * clean.residual);
        forget(&of);
    }
}

/* In a sequence it is taken off before a frame is reconstructed, until it is another one. */
TEST(sequences_keep_it)
{
    camera of = camera_of(HADA_BOUNDARY_PADDED, CHANNELS, 9);
    SCOPED(hada_image) bright = lit(&of.frame, surface[0]), other = lit(&of.frame, constant[0]);
    const hada_image *frames[] = {&of.frame, &bright, &bright, &other, &other, &of.frame, &of.frame};
    static const int warm[] = {0, 0, 1, 0, 1, 0, 1};
    const double light[] = {0.0, mean_of(surface), mean_of(surface), mean_of(constant), mean_of(constant), 0.0, 0.0};
    SCOPED(hada_plan) *plan = plan_of(&of, HADA_DARK_MODEL, 1);
    for (size_t i = 0; i < HADA_COUNT(frames); i++) {
        hada_report report;
        SCOPED(hada_image) image = image_of(plan, frames[i], &report);
        print_message("frame %d: warm %d, light %.4f of %.4f, unexplained %.4f\n", (int)i, report.warm_started,
                      report.stray_light, light[i], report.residual);
        assert_int_equal(report.warm_started, warm[i]);
        assert_true(fabs(report.stray_light - light[i]) <= 0.05 * light[i]);
    }
    forget(&of);
}

/* Frames that are too small for cells say nothing. */
TEST(small_frames_are_left_alone)
{
    hada_image psf = small_psf(1, 40, 48, 8, 3), scene = small_scene(1, 20, 20, 4);
    camera of = {.psf = psf, .frame = small_frame(&psf, &scene, 0, NOISE, 5)};
    hada_report report;
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = 20;
    options.psf_dark = 0.0;
    options.boundary = HADA_BOUNDARY_CIRCULAR;
    ASSERT_OK(hada_model_from_psf(&of.model, context, &psf, 1, &distance, &options, err));
    SCOPED(hada_image) bright = lit(&of.frame, constant[0]);
    SCOPED(hada_plan) *plan = plan_of(&of, HADA_DARK_MODEL, 0);
    hada_result result = {0};
    ASSERT_OK(hada_plan_run(plan, &bright, &result, err));
    report = *result.report;
    assert_true(report.stray_light == 0.0);
    hada_result_destroy(&result);
    hada_image_destroy(&scene);
    forget(&of);
}

FIXTURE(open_device, close_device)
