/* Whole frames through a plan: linear filters against double precision, refinement against itself at other scales. */
#include "camera_small.h"
#include "fit/fitter.h"
#include "model/model.h"
#include "stress.h"
#include "stress_camera.h"

static hada_image image_of(int rows, int cols)
{
    hada_image image;
    ASSERT_OK(hada_image_create(&image, 1, rows, cols, err));
    return image;
}

/* The planes of a linear plan against those in double precision, clipped at 0 as a plan does. The bound (L1) is that of
 * two transforms and a product, amplified by the largest filter value. */
static void linear_row(const stress_device *device, const stress_camera *camera, hada_plan *plan,
                       const hada_image *frame, const char *what)
{
    const hada_model_info *info = hada_model_get_info(camera->model);
    const size_t area = (size_t)info->window_rows * (size_t)info->window_cols, raw = hada_image_count(frame);
    SCOPED(hada_result) result = {0};
    ASSERT_OK(hada_plan_run(plan, frame, &result, err));
    double error = 0.0, size = 0.0, whole = 0.0, largest = 0.0, *want = stress_memory(area, sizeof *want);
    size_t bad = stress_not_finite(result.all_in_focus.data, hada_image_count(&result.all_in_focus));
    for (int z = 0; z < info->depths; z++) {
        largest = fmax(largest, stress_camera_plane(camera, frame, z, want, &whole));
        for (size_t i = 0; i < area; i++)
            want[i] = fmax(want[i], 0.0);
        error += pow(stress_distance(result.planes[z].data, want, area), 2.0);
        size += pow(stress_norm_double(want, area), 2.0);
        bad += stress_not_finite(result.planes[z].data, area);
    }
    const double frame_norm = stress_norm(frame->data, raw),
                 amplified = sqrt((double)info->depths) * largest * frame_norm;
    const double once = stress_fft_bound(info->grid_rows, info->grid_cols) + 4.0 * STRESS_U;
    const double lost = stress_fft_underflow(device, info->grid_rows, info->grid_cols);
    const double bound =
        size > 0.0 ? (2.0 * once * amplified + 2.0 * sqrt((double)info->depths) * lost * (1.0 + largest)) / sqrt(size)
                   : 0.0;
    stress_row("L1", bad ? INFINITY : size > 0.0 ? sqrt(error / size) : sqrt(error), bound, "linear planes, %s", what);
    free(want);
}

static hada_plan *plan_of(const stress_device *device, const stress_camera *camera, int refine)
{
    hada_plan *plan;
    DEFAULTS(hada_plan_options, options);
    options.refine = refine;
    options.occupied = HADA_OCCUPIED_ALL;
    options.dark = HADA_DARK_NONE;
    ASSERT_OK(hada_plan_create(&plan, device->context, camera->model, &options, err));
    return plan;
}

static void linear(const stress_device *device, const stress_camera *camera)
{
    SCOPED(hada_plan) *plan = plan_of(device, camera, 0);
    SCOPED(hada_image) frame = image_of(camera->rows, camera->cols);
    const size_t n = hada_image_count(&frame);
    hada_random random;
    stress_fill_uniform(frame.data, n, 1);
    linear_row(device, camera, plan, &frame, "random pixels");
    for (size_t i = 0; i < n; i++)
        frame.data[i] = ldexpf(frame.data[i], 45);
    linear_row(device, camera, plan, &frame, "pixels up to 2^45");
    stress_fill_uniform(frame.data, n, 1);
    for (size_t i = 0; i < n; i++)
        frame.data[i] = i % 2 ? frame.data[i] : ldexpf(frame.data[i], -130);
    linear_row(device, camera, plan, &frame, "every other pixel denormal");
    stress_fill_range(frame.data, n, 2);
    linear_row(device, camera, plan, &frame, "pixels from 1 to 1e12");
    stress_fill_uniform(frame.data, n, 3);
    hada_random_seed(&random, 1, 1);
    for (size_t i = 0; i < n / 20; i++) {
        frame.data[hada_random_below(&random, (uint32_t)n)] = 1.0f;
        frame.data[hada_random_below(&random, (uint32_t)n)] = 0.0f;
    }
    linear_row(device, camera, plan, &frame, "5 % saturated and 5 % dead pixels");
    memset(frame.data, 0, n * sizeof *frame.data);
    frame.data[n / 2 + (size_t)camera->cols / 2] = 1e12f;
    linear_row(device, camera, plan, &frame, "black but for one pixel of 1e12");
    for (size_t i = 0; i < n; i++)
        frame.data[i] = 0.5f;
    linear_row(device, camera, plan, &frame, "constant");
    memset(frame.data, 0, n * sizeof *frame.data);
    linear_row(device, camera, plan, &frame, "black");
}

/* Powers of two change no mantissa, so the pictures of a frame scaled by one must be those of the frame, scaled: a
 * difference betrays a constant that does not scale, or numbers that leave the range of single precision. */
static void scales(const stress_device *device, const stress_camera *camera, int refine, int power)
{
    SCOPED(hada_plan) *plan = plan_of(device, camera, refine);
    SCOPED(hada_image) frame = image_of(camera->rows, camera->cols);
    SCOPED(hada_result) plain = {0}, scaled = {0};
    hada_error error;
    stress_camera_expose(camera, &frame, 5);
    ASSERT_OK(hada_plan_run(plan, &frame, &plain, err));
    for (size_t i = 0; i < hada_image_count(&frame); i++)
        frame.data[i] = ldexpf(frame.data[i], power);
    const hada_status status = hada_plan_run(plan, &frame, &scaled, &error);
    size_t differ = 0, count = hada_image_count(&plain.all_in_focus);
    for (size_t i = 0; !status && i < count; i++)
        differ += ldexpf(plain.all_in_focus.data[i], power) != scaled.all_in_focus.data[i];
    for (int z = 0; !status && z < plain.depths; z++)
        for (size_t i = 0; i < count; i++)
            differ += ldexpf(plain.planes[z].data[i], power) != scaled.planes[z].data[i];
    for (size_t i = 0; !status && i < hada_image_count(&plain.distance_map); i++) {
        const float a = plain.distance_map.data[i], b = scaled.distance_map.data[i];
        differ += !(a == b || (isnan(a) && isnan(b)));
    }
    stress_none("L2", status ? status != HADA_ERROR_NUMERIC : differ,
                "%s, frame times 2^%d: pixels that do not scale%s", refine ? "refined planes" : "linear planes", power,
                status ? " (refused)" : "");
}

enum { FIT_DEPTHS = 2, FIT_PAIRS = 3, FIT_ROWS = 24, FIT_COLS = 32, FIT_WINDOW = 12 };

/* The refined planes of a camera that was fitted with frames times 2^power, of a frame times 2^power. */
static void fit_and_run(const stress_device *device, int power, hada_result *result)
{
    static const double distances[] = {100.0, 200.0};
    SCOPED(hada_fitter) * fitter;
    SCOPED(hada_model) * model;
    SCOPED(hada_plan) * plan;
    SCOPED(hada_image) last = {0};
    hada_fit_options options = helpers_fit(FIT_DEPTHS, 1, distances, FIT_ROWS, FIT_COLS, FIT_WINDOW);
    options.lambda = 1e-4;
    options.refine_steps = 6;
    ASSERT_OK(hada_fitter_create(&fitter, device->context, &options, err));
    for (int z = 0; z < FIT_DEPTHS; z++) {
        SCOPED(hada_image) psf = small_psf(1, FIT_ROWS, FIT_COLS, 6, (uint64_t)z + 1);
        for (int i = 0; i < FIT_PAIRS; i++) {
            const uint64_t seed = (uint64_t)(10 * z + i);
            hada_image scene = small_scene(1, FIT_WINDOW, FIT_WINDOW, seed);
            /* no light at all outside the window, and with a scene of one column at many frequencies neither */
            for (int k = 0; z == 0 && k < FIT_WINDOW * FIT_WINDOW; k++)
                scene.data[k] = k % FIT_WINDOW == FIT_WINDOW / 2 ? scene.data[k] : 0.0f;
            hada_image frame = small_frame(&psf, &scene, 0, 0.01, seed);
            for (size_t k = 0; k < hada_image_count(&frame); k++)
                frame.data[k] = ldexpf(frame.data[k], power);
            ASSERT_OK(hada_fitter_add_pair(fitter, z, &frame, &scene, err));
            hada_image_destroy(&scene);
            hada_image_destroy(&last);
            last = frame;
        }
    }
    ASSERT_OK(hada_fitter_finish(fitter, NULL, &model, err));
    DEFAULTS(hada_plan_options, plan_options);
    plan_options.refine = 6;
    plan_options.occupied = HADA_OCCUPIED_ALL;
    ASSERT_OK(hada_plan_create(&plan, device->context, model, &plan_options, err));
    ASSERT_OK(hada_plan_run(plan, &last, result, err));
}

/* A camera learned and used in other units of light gives the same pictures. */
static void units(const stress_device *device, int power)
{
    SCOPED(hada_result) plain = {0}, scaled = {0};
    size_t differ = 0;
    fit_and_run(device, 0, &plain);
    fit_and_run(device, power, &scaled);
    for (int z = 0; z < plain.depths; z++)
        for (size_t i = 0; i < hada_image_count(&plain.planes[z]); i++)
            differ += plain.planes[z].data[i] != scaled.planes[z].data[i];
    stress_none("L2", differ, "fit and refined planes, all frames times 2^%d: pixels that differ", power);
}

void stress_frames(void **state)
{
    (void)state;
    static const int powers[] = {-110, -60, -38, -20, 10, 40, 50, 100, 126};
    stress_device device = stress_open();
    stress_camera camera = stress_camera_make(&device, stress_form_now == STRESS_TINY ? 8 : 40,
                                              stress_form_now == STRESS_TINY ? 12 : 48, 2, 0.2);
    linear(&device, &camera);
    for (size_t i = 0; i < HADA_COUNT(powers); i++) {
        scales(&device, &camera, 0, powers[i]);
        if (stress_form_now != STRESS_TINY)
            scales(&device, &camera, 6, powers[i]);
    }
    for (int power = -30; power <= 30 && stress_form_now != STRESS_TINY; power += 15)
        if (power)
            units(&device, power);
    stress_camera_free(&camera);
    stress_close(&device);
    stress_end_group();
}

/* Every size from one pixel on, and primes, which transforms do differently. */
void stress_sizes(void **state)
{
    (void)state;
    static const struct {
        int rows, cols;
        stress_form form;
    } sizes[] = {{1, 1, STRESS_TINY},     {1, 2, STRESS_TINY},       {2, 1, STRESS_TINY},
                 {2, 2, STRESS_TINY},     {3, 5, STRESS_TINY},       {1, 17, STRESS_BRIEF},
                 {17, 1, STRESS_BRIEF},   {31, 37, STRESS_BRIEF},    {127, 131, STRESS_BRIEF},
                 {521, 509, STRESS_FULL}, {1024, 1024, STRESS_FULL}, {4096, 4096, STRESS_FULL}};
    stress_device device = stress_open();
    for (size_t i = 0; i < HADA_COUNT(sizes); i++) {
        char what[64];
        if (sizes[i].form > stress_form_now)
            continue;
        stress_camera camera = stress_camera_make(&device, sizes[i].rows, sizes[i].cols, 1, 0.2);
        hada_plan *plan = plan_of(&device, &camera, 0);
        hada_image frame = image_of(camera.rows, camera.cols);
        stress_fill_uniform(frame.data, hada_image_count(&frame), i + 1);
        snprintf(what, sizeof what, "%d x %d", camera.rows, camera.cols);
        linear_row(&device, &camera, plan, &frame, what);
        hada_image_destroy(&frame);
        hada_plan_destroy(&plan);
        stress_camera_free(&camera);
    }
    stress_close(&device);
    stress_end_group();
}
