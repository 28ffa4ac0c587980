/* NaN and infinity in one place must not spread unnoticed: refused with a status, or repaired where asked for. */
#include "fit/fitter.h"
#include "model/model.h"
#include "planes/maker.h"
#include "stress.h"
#include "stress_camera.h"

typedef struct scene {
    stress_device device;
    stress_camera camera;
    hada_image frame, window; /* whole and finite */
} scene;

static hada_image copy_of(const hada_image *image)
{
    hada_image copy;
    ASSERT_OK(hada_image_create(&copy, image->channels, image->rows, image->cols, err));
    memcpy(copy.data, image->data, hada_image_count(image) * sizeof *copy.data);
    return copy;
}

static hada_plan *plan_of(const scene *s, int refine, int repair, const hada_image *dark, hada_status *status)
{
    hada_plan *plan = NULL;
    hada_error error;
    DEFAULTS(hada_plan_options, options);
    options.refine = refine;
    options.repair_not_finite = repair;
    options.dark = dark ? HADA_DARK_FRAME : HADA_DARK_NONE;
    options.dark_frame = dark;
    *status = hada_plan_create(&plan, s->device.context, s->camera.model, &options, &error);
    return plan;
}

/* Pixels that differ between the pictures of a repaired frame and those of the frame mended by hand: none, since the
 * repair touches nothing but the broken pixels. */
static void repaired(const scene *s, const hada_image *broken, int refine, const char *what)
{
    hada_status status;
    SCOPED(hada_plan) *plan = plan_of(s, refine, 1, NULL, &status);
    SCOPED(hada_image) mended = copy_of(broken);
    SCOPED(hada_result) by_plan = {0}, by_hand = {0};
    size_t count, differ = 0;
    assert_int_equal(status, HADA_OK);
    ASSERT_OK(hada_frame_repair(&mended, HADA_MOSAIC_NONE, &count, err));
    ASSERT_OK(hada_plan_run(plan, broken, &by_plan, err));
    ASSERT_OK(hada_plan_run(plan, &mended, &by_hand, err));
    for (size_t i = 0; i < hada_image_count(&mended); i++) /* what was whole is as it was */
        differ += isfinite(broken->data[i]) && broken->data[i] != mended.data[i];
    for (int z = 0; z < by_plan.depths; z++)
        for (size_t i = 0; i < hada_image_count(&by_plan.planes[z]); i++)
            differ += by_plan.planes[z].data[i] != by_hand.planes[z].data[i];
    differ += stress_not_finite(by_plan.all_in_focus.data, hada_image_count(&by_plan.all_in_focus));
    stress_none("B1", differ + (by_plan.report->repaired_pixels != count),
                "%s, repaired: pixels that are not as by hand", what);
}

static void broken_frames(const scene *s)
{
    static const struct {
        const char *what;
        float value;
        int pixels;
    } kinds[] = {{"one NaN pixel", NAN, 1},
                 {"one infinite pixel", INFINITY, 1},
                 {"a block of 64 NaN pixels", NAN, 64},
                 {"one pixel of minus infinity", -INFINITY, 1}};
    for (size_t k = 0; k < HADA_COUNT(kinds); k++) {
        SCOPED(hada_image) frame = copy_of(&s->frame);
        hada_status status;
        hada_error error;
        hada_result result = {0};
        const int side = kinds[k].pixels > 1 ? 8 : 1;
        for (int row = 0; row < side && row < frame.rows; row++)
            for (int col = 0; col < side && col < frame.cols; col++)
                frame.data[(frame.rows / 4 + row) % frame.rows * frame.cols + col] = kinds[k].value;
        hada_plan *plan = plan_of(s, 0, 0, NULL, &status);
        assert_int_equal(status, HADA_OK);
        stress_none("B1", hada_plan_run(plan, &frame, &result, &error) != HADA_ERROR_NOT_FINITE, "%s: not refused",
                    kinds[k].what);
        hada_plan_destroy(&plan);
        hada_result_destroy(&result);
        repaired(s, &frame, 0, kinds[k].what);
    }
}

static void broken_pairs(const scene *s)
{
    static const double distance[] = {100.0};
    SCOPED(hada_fitter) * fitter;
    hada_error error;
    DEFAULTS(hada_fit_options, options);
    options.depths = options.channels = 1;
    options.distances_mm = distance;
    options.raw_rows = s->frame.rows;
    options.raw_cols = s->frame.cols;
    options.window_rows = s->window.rows;
    options.window_cols = s->window.cols;
    ASSERT_OK(hada_fitter_create(&fitter, s->device.context, &options, err));
    SCOPED(hada_image) frame = copy_of(&s->frame), window = copy_of(&s->window);
    frame.data[1] = NAN;
    window.data[1] = INFINITY;
    stress_none("B1",
                (hada_fitter_add_pair(fitter, 0, &frame, &s->window, &error) != HADA_ERROR_NOT_FINITE) +
                    (hada_fitter_add_pair(fitter, 0, &s->frame, &window, &error) != HADA_ERROR_NOT_FINITE) +
                    (size_t)hada_fitter_get_info(fitter)->pairs[0],
                "a pair with NaN or infinity: not refused, or counted");
}

static void broken_elsewhere(const scene *s)
{
    static const double distances[] = {100.0, 200.0};
    hada_status status;
    hada_error error;
    hada_image aif, map;
    SCOPED(hada_image) dark = copy_of(&s->frame), psf = copy_of(&s->camera.psf[0]);
    hada_model *model = NULL;
    double value;
    dark.data[3] = NAN;
    hada_plan *plan = plan_of(s, 0, 1, &dark, &status);
    assert_null(plan);
    stress_none("B1", status != HADA_ERROR_NOT_FINITE, "a dark frame with a NaN pixel: not refused");
    psf.data[0] = NAN;
    status = hada_model_from_psf(&model, s->device.context, &psf, 1, distances, NULL, &error);
    stress_none("B1", status != HADA_ERROR_NOT_FINITE, "a point spread function with a NaN pixel: not refused");
    float *filter = s->camera.model->filter, kept = filter[4];
    filter[4] = INFINITY;
    plan = plan_of(s, 0, 1, NULL, &status);
    filter[4] = kept;
    stress_none("B1", status != HADA_ERROR_MODEL, "a model with an infinite filter value: not refused");
    hada_plan_destroy(&plan);
    hada_image planes[] = {copy_of(&s->window), copy_of(&s->window)};
    planes[1].data[2] = NAN;
    status = hada_focus_stack(s->device.context, planes, distances, 2, NULL, NULL, &aif, &map, NULL, &error);
    stress_none("B1", status != HADA_ERROR_NOT_FINITE, "a plane to be focused with a NaN pixel: not refused");
    stress_none("B1",
                hada_metric_compare(HADA_METRIC_MSE, &planes[0], &planes[1], 1.0, NULL, &value, &error) !=
                    HADA_ERROR_NOT_FINITE,
                "an image to be compared with a NaN pixel: not refused");
    hada_image_destroy(&planes[0]);
    hada_image_destroy(&planes[1]);
}

/* Finite pixels so large that spectra, or squares of them, leave single precision: the pictures are finite, or the
 * frame is refused. Finite pairs likewise. */
static void too_large(const scene *s)
{
    static const float scales[] = {1e19f, 1e25f, 1e30f, 1e37f, FLT_MAX};
    static const double distance[] = {100.0};
    for (size_t k = 0; k < HADA_COUNT(scales); k++) {
        SCOPED(hada_image) frame = copy_of(&s->frame);
        float top = 0.0f;
        for (size_t i = 0; i < hada_image_count(&frame); i++)
            top = fmaxf(top, fabsf(frame.data[i]));
        for (size_t i = 0; i < hada_image_count(&frame); i++)
            frame.data[i] = frame.data[i] / top * scales[k];
        for (int refine = 0; refine <= 6; refine += 6) {
            hada_status status;
            hada_error error;
            SCOPED(hada_result) result = {0};
            size_t bad = 0;
            SCOPED(hada_plan) *plan = plan_of(s, refine, 0, NULL, &status);
            assert_int_equal(status, HADA_OK);
            status = hada_plan_run(plan, &frame, &result, &error);
            for (int z = 0; !status && z < result.depths; z++)
                bad += stress_not_finite(result.planes[z].data, hada_image_count(&result.planes[z]));
            if (!status) {
                bad += stress_not_finite(result.all_in_focus.data, hada_image_count(&result.all_in_focus));
                bad += refine && !(result.report->residual <= 1.0); /* NaN too */
            }
            stress_none("B2", status ? status != HADA_ERROR_NUMERIC : bad, "%s planes, pixels up to %.0e: not finite%s",
                        refine ? "refined" : "linear", (double)scales[k], status ? " (refused)" : "");
        }
        SCOPED(hada_fitter) * fitter;
        SCOPED(hada_model) *model = NULL;
        hada_error error;
        DEFAULTS(hada_fit_options, options);
        options.depths = options.channels = 1;
        options.distances_mm = distance;
        options.raw_rows = options.window_rows = frame.rows;
        options.raw_cols = options.window_cols = frame.cols;
        options.lambda = 1e-3;
        options.refine_steps = 0;
        ASSERT_OK(hada_fitter_create(&fitter, s->device.context, &options, err));
        hada_status status = hada_fitter_add_pair(fitter, 0, &frame, &s->frame, &error);
        if (!status)
            status = hada_fitter_finish(fitter, NULL, &model, &error);
        /* a filter that is black passes for finite: of a scene it must leave something */
        stress_none("B2",
                    status ? status != HADA_ERROR_NUMERIC : !(model->filter[0] != 0.0f && isfinite(model->info.noise)),
                    "a pair with pixels up to %.0e: not noticed%s", (double)scales[k], status ? " (refused)" : "");
    }
}

void stress_broken(void **state)
{
    (void)state;
    const int small = stress_form_now == STRESS_TINY;
    scene s = {.device = stress_open()};
    s.camera = stress_camera_make(&s.device, small ? 8 : 40, small ? 12 : 48, 2, 0.2);
    const hada_model_info *info = hada_model_get_info(s.camera.model);
    ASSERT_OK(hada_image_create(&s.frame, 1, info->raw_rows, info->raw_cols, err));
    ASSERT_OK(hada_image_create(&s.window, 1, info->window_rows, info->window_cols, err));
    stress_camera_expose(&s.camera, &s.frame, 2);
    stress_fill_uniform(s.window.data, hada_image_count(&s.window), 3);
    broken_frames(&s);
    broken_pairs(&s);
    broken_elsewhere(&s);
    if (!small)
        too_large(&s);
    hada_image_destroy(&s.frame);
    hada_image_destroy(&s.window);
    stress_camera_free(&s.camera);
    stress_close(&s.device);
    stress_end_group();
}
