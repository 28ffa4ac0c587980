/* Filters: stored as half, from transfer functions with zeros, at extreme lambda. */
#include "camera_small.h"
#include "fft/fft.h"
#include "filter/bank.h"
#include "filter/hadamard.h"
#include "model/model.h"
#include "stress.h"
#include "stress_camera.h"

/* The window of the first depth by the given model (half or not) on the device. */
static void run(const stress_device *device, const hada_model *model, const hada_image *frame, float *window)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_spectrum_layout layout = hada_hadamard_layout(device->context, info);
    const size_t area = (size_t)info->window_rows * (size_t)info->window_cols;
    SCOPED(hada_hadamard) * stage;
    SCOPED(hada_bank) * bank;
    SCOPED(hada_buffer) planes;
    ASSERT_OK(hada_hadamard_create(&stage, device->slot, info, 1, err));
    ASSERT_OK(hada_bank_create(&bank, device->slot, model, &layout, NULL, 0, HADA_BANK_FILTERS, 0, err));
    ASSERT_OK(hada_buffer_create(&planes, device->context, area * sizeof(float) * (size_t)info->depths, "planes", err));
    hada_pixels pixels;
    hada_pixels_of_image(&pixels, frame);
    ASSERT_OK(hada_hadamard_frame(stage, &pixels, NULL, err));
    ASSERT_OK(hada_hadamard_run(stage, bank, 0, 1, planes.mem, 0, err));
    ASSERT_OK(hada_buffer_read(&planes, device->slot, 0, window, area * sizeof *window, err));
}

/* Half filters (H1): each value is off by at most 2^-11 of itself, so by Parseval's theorem the image on the whole grid
 * is off by at most 2^-11 of its norm. `scale` is what the filters are multiplied by: small ones leave the normal half
 * numbers, and then the conversion must refuse. */
static void half_row(const stress_device *device, stress_camera *camera, const hada_image *frame, double scale)
{
    const hada_model_info *info = hada_model_get_info(camera->model);
    const size_t area = (size_t)info->window_rows * (size_t)info->window_cols, plane = hada_model_plane(camera->model);
    const size_t values = 2 * plane * (size_t)info->depths;
    SCOPED_MEMORY float *kept = stress_memory(values, sizeof *kept), *got = stress_memory(area, sizeof *got);
    double *want = stress_memory(area, sizeof *want), whole;
    hada_model *half;
    hada_error error;
    memcpy(kept, camera->model->filter, values * sizeof *kept);
    for (size_t i = 0; i < values; i++)
        camera->model->filter[i] = (float)(kept[i] * scale);
    const hada_status status = hada_model_to_half(&half, camera->model, &error);
    if (status) {
        stress_none("H1", status != HADA_ERROR_NUMERIC, "half filters, |W| times %.0e (refused)", scale);
    } else {
        run(device, half, frame, got);
        const double largest = stress_camera_plane(camera, frame, 0, want, &whole);
        const double once = stress_fft_bound(info->grid_rows, info->grid_cols) + 4.0 * STRESS_U;
        const double bound =
            STRESS_HALF * whole + 2.0 * once * largest * stress_norm(frame->data, hada_image_count(frame));
        stress_row("H1", stress_distance(got, want, area) / stress_norm_double(want, area),
                   bound / stress_norm_double(want, area), "half filters, |W| times %.0e", scale);
    }
    hada_model_destroy(&half);
    memcpy(camera->model->filter, kept, values * sizeof *kept);
    free(want);
}

/* Wiener filters of a PSF whose transfer function has zeros: those of a box are exact, on the device they are rounding
 * errors. Every value is compared with the formula in double precision on the model's own H (W1). */
static void zeros(const stress_device *device, double lambda)
{
    static const double distance[] = {100.0};
    const int rows = 24, cols = 32;
    SCOPED(hada_image) psf;
    SCOPED(hada_model) * model, *again;
    ASSERT_OK(hada_image_create(&psf, 1, rows, cols, err));
    for (int row = 0; row < 6; row++)
        for (int col = 0; col < 8; col++)
            psf.data[(rows / 2 - 3 + row) * cols + cols / 2 - 4 + col] = 1.0f;
    DEFAULTS(hada_psf_options, options);
    options.boundary = HADA_BOUNDARY_CIRCULAR;
    options.psf_dark = 0.0;
    options.lambda = lambda;
    ASSERT_OK(hada_model_from_psf(&model, device->context, &psf, 1, distance, &options, err));
    ASSERT_OK(hada_model_with_form(&again, model, HADA_FORM_WIENER, lambda, err));
    const size_t plane = hada_model_plane(model), half = (size_t)cols / 2 + 1;
    double mean = 0.0, worst = 0.0;
    size_t near = 0;
    for (size_t i = 0; i < plane; i++) {
        const float *h = model->otf + 2 * i;
        mean += (i % half == 0 || 2 * (i % half) == (size_t)cols ? 1.0 : 2.0) *
                ((double)h[0] * h[0] + (double)h[1] * h[1]) / (rows * cols);
    }
    for (size_t i = 0; i < plane; i++) {
        const double re = model->otf[2 * i], im = model->otf[2 * i + 1], square = re * re + im * im;
        const double under = square + lambda * mean, size = sqrt(square) / under;
        near += square < 1e-12;
        /* from_psf takes the mean of |H|^2 from the pixels, with_form from the spectrum */
        const hada_model *models[] = {model, again};
        for (int k = 0; k < 2; k++) {
            const float *w = models[k]->filter + 2 * i;
            const double off = hypot(w[0] - re / under, w[1] + im / under);
            worst = fmax(worst, isfinite(w[0]) && isfinite(w[1]) ? off / (size > 0.0 ? size : 1.0) : INFINITY);
        }
    }
    stress_none("W1", near < 20, "Wiener filter of a box: its transfer function has fewer zeros than it should");
    stress_row("W1", worst, STRESS_U + 2.0 * stress_fft_bound(rows, cols), "Wiener filter of a box, lambda %.0e",
               lambda);
}

void stress_filters(void **state)
{
    (void)state;
    static const double scales[] = {1.0, 1e4, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-9};
    static const double lambdas[] = {1e-30, 1e-12, 1e-3, 1e6, 1e30};
    const int small = stress_form_now == STRESS_TINY;
    stress_device device = stress_open();
    stress_camera camera = stress_camera_make(&device, small ? 8 : 40, small ? 12 : 48, 1, 0.2);
    hada_image frame;
    ASSERT_OK(hada_image_create(&frame, 1, camera.rows, camera.cols, err));
    stress_camera_expose(&camera, &frame, 4);
    for (size_t i = 0; i < HADA_COUNT(scales); i++)
        half_row(&device, &camera, &frame, scales[i]);
    for (size_t i = 0; i < HADA_COUNT(lambdas); i++)
        zeros(&device, lambdas[i]);
    hada_image_destroy(&frame);
    stress_camera_free(&camera);
    stress_close(&device);
    stress_end_group();
}
