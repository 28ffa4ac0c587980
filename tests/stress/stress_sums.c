/* Sums: of the fit, of energies, of errors, against exact ones. */
#include "fit/fitter.h"
#include "stress.h"
#include "tiny_camera.h"

/* Float additions on the device keep what rounding loses: n of them are as good as 47 bits (S2). The numbers range over
 * 12 decades and both signs, so that large ones come and go. */
static void fit_sums(void)
{
    const int many = stress_form_now == STRESS_TINY ? 8 : stress_form_now == STRESS_FULL ? 20000 : 500;
    static const double distance[] = {100.0};
    hada_fitter *fitter;
    stress_device device = stress_open();
    DEFAULTS(hada_fit_options, options);
    options.depths = options.channels = 1;
    options.distances_mm = distance;
    options.raw_rows = options.window_rows = options.raw_cols = options.window_cols = 8;
    options.form = HADA_FORM_SPLIT;
    ASSERT_OK(hada_fitter_create(&fitter, device.context, &options, err));
    const size_t count = fitter->grid.layout.count, stride = fitter->grid.stride;
    float *x = stress_memory(2 * count, sizeof *x), *b = stress_memory(2 * count, sizeof *b);
    float *sums = stress_memory(12 * stride, sizeof *sums);
    long double *exact = stress_memory(6 * count, sizeof *exact), *sizes = stress_memory(6 * count, sizeof *sizes);
    hada_random random;
    hada_random_seed(&random, 5, 5);
    ASSERT_OK(hada_fit_sums_select(&fitter->sums, 0, err));
    for (int n = 0; n < many; n++) {
        for (size_t i = 0; i < 2 * count; i++) {
            x[i] = (float)(hada_random_normal(&random) * pow(10.0, hada_random_range(&random, -3.0, 3.0)));
            b[i] = (float)(hada_random_normal(&random) * pow(10.0, hada_random_range(&random, -3.0, 3.0)));
        }
        ASSERT_OK(hada_buffer_write(&fitter->pair.scene_spectrum, device.slot, 0, x, 8 * count, err));
        ASSERT_OK(hada_buffer_write(&fitter->pair.raw_spectrum, device.slot, 0, b, 8 * count, err));
        ASSERT_OK(hada_fit_sums_accumulate(&fitter->sums, &fitter->pair, 1.0, err));
        ASSERT_OK(hada_slot_finish(fitter->grid.slot, err));
        for (size_t i = 0; i < count; i++) {
            /* the products are rounded to float, as on the device */
            const float xr = x[2 * i], xi = x[2 * i + 1], br = b[2 * i], bi = b[2 * i + 1];
            const float rr = xr * br, ii = xi * bi, ir = xi * br, ri = xr * bi, bb = br * br, bj = bi * bi;
            const float xx = xr * xr, xj = xi * xi;
            const float term[6] = {rr + ii, ir - ri, bb + bj, xx + xj, rr, bb};
            for (size_t k = 0; k < 6; k++) {
                exact[k * count + i] += term[k];
                sizes[k * count + i] += fabsf(term[k]);
            }
        }
    }
    ASSERT_OK(hada_buffer_read(&fitter->sums.sums[0], fitter->grid.slot, 0, sums, 12 * stride * 4, err));
    double worst = 0.0;
    for (size_t k = 0; k < 6; k++)
        for (size_t i = 0; i < count; i++) {
            const long double got = (long double)sums[2 * k * stride + i] + sums[(2 * k + 1) * stride + i];
            worst = fmax(worst, (double)(fabsl(got - exact[k * count + i]) / sizes[k * count + i]));
        }
    stress_row("S2", worst, many * 0x1p-47, "sums of a fit, %d additions over 12 decades", many);
    HADA_FREE(x, b, sums, exact, sizes);
    hada_fitter_destroy(&fitter);
    stress_close(&device);
}

/* Energies of the refinement: Parseval's theorem carries them from the spectrum to the pixels (S3). */
static void energies(int side, int padded, int range)
{
    tiny_camera camera = tiny_make(side, side, side / 2, side / 2, 1, 1, padded);
    tiny_device device;
    hada_refiner *refiner;
    static const int list[] = {0};
    const size_t n = camera.pixels;
    SCOPED_MEMORY float *pixels = stress_memory(n, sizeof *pixels);
    double *image = stress_memory(n, sizeof *image), exact = 0.0;
    tiny_upload(&device, &camera);
    device.shape.max_steps = 2;
    ASSERT_OK(hada_refiner_create(&refiner, device.slot, &device.shape, err));
    if (range)
        stress_fill_range(pixels, n, 1);
    else
        stress_fill_uniform(pixels, n, 1);
    for (int row = 0; row < camera.frame.rows; row++)
        for (int col = 0; col < camera.frame.cols; col++) {
            const size_t at =
                (size_t)(camera.frame.row0 + row) * (size_t)camera.cols + (size_t)(camera.frame.col0 + col);
            image[at] = pixels[at];
            exact += image[at] * image[at];
        }
    tiny_expose(&device, &camera, image, 1.0);
    DEFAULTS(hada_refine_rule, rule);
    rule.steps = 1;
    ASSERT_OK(hada_refiner_run(refiner, &device.data, &rule, 1, 1, list, NULL, err));
    const double transform =
        range ? stress_fft_worst(camera.rows, camera.cols) : stress_fft_bound(camera.rows, camera.cols);
    /* 2048 frequencies to a partial sum, eight side by side or 64 items, or columns, where passes are fused; partial
     * sums are added in double precision */
    const double longest = fmax(2048.0 / 8, camera.rows);
    stress_row("S3", fabs(hada_refiner_energy(refiner, 0, 0) / exact - 1.0),
               2.0 * transform + stress_sum_bound(longest), "energy of a frame of %d x %d%s%s", side, side,
               padded ? ", on a larger grid" : "", range ? ", pixels from 1 to 1e12" : "");
    hada_refiner_destroy(&refiner);
    tiny_release(&device);
    tiny_free(&camera);
    free(image);
}

/* Mean squared errors are sums in double precision (S4). */
static void metrics(void)
{
    const int side = stress_form_now == STRESS_FULL ? 8192 : 512;
    SCOPED(hada_image) a, b;
    double mse;
    long double exact = 0.0L;
    ASSERT_OK(hada_image_create(&a, 1, side, side, err));
    ASSERT_OK(hada_image_create(&b, 1, side, side, err));
    const size_t n = hada_image_count(&a);
    stress_fill_range(a.data, n, 1);
    stress_fill_range(b.data, n, 2);
    for (size_t i = 0; i < n; i++)
        exact += ((long double)a.data[i] - b.data[i]) * ((long double)a.data[i] - b.data[i]);
    ASSERT_OK(hada_metric_compare(HADA_METRIC_MSE, &a, &b, 1.0, NULL, &mse, err));
    stress_row("S4", fabs(mse / (double)(exact / (long double)n) - 1.0), (double)n * 0x1p-53,
               "mean squared error of %d x %d, pixels from 1 to 1e12", side, side);
}

void stress_sums(void **state)
{
    (void)state;
    const int side = stress_form_now == STRESS_TINY ? 8 : 64;
    fit_sums();
    for (int padded = 0; padded < 2; padded++)
        for (int range = 0; range < 2; range++)
            energies(side, padded, range);
    if (stress_form_now == STRESS_FULL)
        energies(2048, 0, 0);
    metrics();
    stress_end_group();
}
