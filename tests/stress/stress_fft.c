/* Transforms: growth of the error with the size, and data that strain single precision. */
#include "fft/fft.h"
#include "ref/ref_fft.h"
#include "stress.h"

typedef struct errors {
    double forward, inverse, round_trip; /* relative L2 */
    double energy;                       /* |energy of the spectrum / (energy of the image x size) - 1|: Parseval */
    size_t not_finite;
} errors;

static hada_fft *plan_of(const stress_device *device, hada_fft_direction direction, int rows, int cols)
{
    hada_fft *plan;
    const hada_fft_desc desc = hada_fft_whole(direction, rows, cols, 1);
    ASSERT_OK(hada_fft_create(&plan, device->slot, &desc, err));
    return plan;
}

/* The error of a spectrum on the device's layout; each frequency counts as often as in the whole spectrum. The exact
 * spectrum is then replaced by the device's, from which the inverse starts. */
static void judge_spectrum(const hada_spectrum_layout *layout, const float *got, double *want, double image_norm,
                           errors *e)
{
    const size_t half = (size_t)layout->cols / 2 + 1;
    double error = 0.0, size = 0.0, energy = 0.0;
    for (int y = 0; y < layout->rows; y++)
        for (int x = 0; x < (int)half; x++) {
            const double weight = x == 0 || 2 * x == layout->cols ? 1.0 : 2.0;
            const float *g = got + 2 * hada_spectrum_index(layout, y, x);
            double *w = want + 2 * ((size_t)y * half + (size_t)x);
            for (int c = 0; c < 2; c++) {
                e->not_finite += !isfinite(g[c]);
                error += weight * (g[c] - w[c]) * (g[c] - w[c]);
                size += weight * w[c] * w[c];
                energy += weight * (double)g[c] * g[c];
                w[c] = g[c];
            }
        }
    e->forward = size > 0.0 ? sqrt(error / size) : sqrt(error);
    e->energy =
        image_norm > 0.0 ? fabs(sqrt(energy / ((double)layout->rows * layout->cols)) / image_norm - 1.0) : sqrt(energy);
}

/* Forward on the device against double precision; inverse of the device's spectrum against that in double precision. */
static errors transform(const stress_device *device, int rows, int cols, const float *image)
{
    const size_t n = (size_t)rows * (size_t)cols;
    errors e = {0};
    hada_buffer real, spectrum;
    hada_fft *forward = plan_of(device, HADA_FFT_FORWARD, rows, cols);
    const hada_spectrum_layout *layout = hada_fft_plan_layout(forward);
    SCOPED_MEMORY float *got = stress_memory(2 * layout->count, sizeof *got), *back = stress_memory(n, sizeof *back);
    SCOPED_MEMORY double *exact = stress_memory(n, sizeof *exact);
    SCOPED_MEMORY double *want = stress_memory(2 * (size_t)rows * (size_t)(cols / 2 + 1), sizeof *want);
    for (size_t i = 0; i < n; i++)
        exact[i] = image[i];
    ASSERT_OK(hada_buffer_create_from(&real, device->slot, image, n * sizeof *image, "an image", err));
    ASSERT_OK(hada_buffer_create(&spectrum, device->context, layout->count * 8, "a spectrum", err));
    ASSERT_OK(hada_fft_forward(forward, 1, real.mem, 0, spectrum.mem, 0, err));
    ASSERT_OK(hada_buffer_read(&spectrum, device->slot, 0, got, layout->count * 8, err));
    ASSERT_OK(hada_ref_fft_forward(exact, rows, cols, want, err));
    judge_spectrum(layout, got, want, stress_norm(image, n), &e);
    hada_fft_destroy(&forward);
    hada_fft *inverse = plan_of(device, HADA_FFT_INVERSE, rows, cols);
    ASSERT_OK(hada_fft_inverse(inverse, 1, spectrum.mem, 0, real.mem, 0, NULL, err));
    ASSERT_OK(hada_buffer_read(&real, device->slot, 0, back, n * sizeof *back, err));
    hada_fft_destroy(&inverse);
    HADA_DESTROY_BUFFERS(&real, &spectrum);
    ASSERT_OK(hada_ref_fft_inverse(want, rows, cols, exact, err));
    const double size = stress_norm_double(exact, n);
    e.inverse = stress_distance(back, exact, n) / (size > 0.0 ? size : 1.0);
    for (size_t i = 0; i < n; i++)
        exact[i] = image[i];
    e.round_trip = stress_distance(back, exact, n) / (size > 0.0 ? size : 1.0);
    e.not_finite += stress_not_finite(back, n);
    return e;
}

static void row_of(const char *rule, const errors *e, double bound, const char *what, int rows, int cols)
{
    const double worst = fmax(fmax(e->forward, e->inverse), e->round_trip / sqrt(2.0));
    stress_row(rule, e->not_finite ? INFINITY : worst, bound, "transform, %s, %d x %d", what, rows, cols);
}

static void growth(const stress_device *device)
{
    static const struct {
        int rows, cols;
        stress_form form;
    } sizes[] = {
        {1, 1, STRESS_TINY},       {1, 2, STRESS_TINY},       {3, 5, STRESS_TINY},       {16, 16, STRESS_TINY},
        {17, 19, STRESS_TINY},     {64, 64, STRESS_BRIEF},    {256, 256, STRESS_BRIEF},  {512, 512, STRESS_BRIEF},
        {43, 43, STRESS_BRIEF},    {127, 113, STRESS_BRIEF},  {131, 137, STRESS_BRIEF},  {243, 250, STRESS_BRIEF},
        {1, 8192, STRESS_BRIEF},   {8192, 1, STRESS_BRIEF},   {1024, 1024, STRESS_FULL}, {2048, 2048, STRESS_FULL},
        {4096, 4096, STRESS_FULL}, {8192, 8192, STRESS_FULL}, {1376, 2064, STRESS_FULL}, {509, 521, STRESS_FULL},
        {1009, 1013, STRESS_FULL}, {1, 1048576, STRESS_FULL},
    };
    for (size_t i = 0; i < HADA_COUNT(sizes); i++) {
        const int rows = sizes[i].rows, cols = sizes[i].cols;
        const size_t n = (size_t)rows * (size_t)cols;
        if (sizes[i].form > stress_form_now)
            continue;
        SCOPED_MEMORY float *image = stress_memory(n, sizeof *image);
        stress_fill_normal(image, n, i + 1);
        const errors e = transform(device, rows, cols, image);
        const double bound = stress_fft_bound(rows, cols);
        row_of("T1", &e, bound, "noise", rows, cols);
        if (n > 4096) /* the errors of single frequencies cancel in the sum */
            stress_row("T4", e.energy, bound, "transform, energy of the spectrum, %d x %d", rows, cols);
    }
}

static void fill_constant(float *to, size_t count, float value)
{
    for (size_t i = 0; i < count; i++)
        to[i] = value;
}

/* Data without the even spread that makes rounding errors average out: the bound is the worst case. */
static void strained(const stress_device *device)
{
    const int rows = stress_form_now == STRESS_TINY ? 8 : 60, cols = stress_form_now == STRESS_TINY ? 12 : 64;
    const size_t n = (size_t)rows * (size_t)cols;
    const double worst = stress_fft_worst(rows, cols);
    SCOPED_MEMORY float *image = stress_memory(n, sizeof *image);
    errors e = transform(device, rows, cols, image);
    stress_row("T2", e.forward + e.inverse, 0.0, "transform, black");
    fill_constant(image, n, 0.7f);
    e = transform(device, rows, cols, image);
    row_of("T2", &e, worst, "constant", rows, cols);
    stress_fill_range(image, n, 1);
    e = transform(device, rows, cols, image);
    row_of("T2", &e, worst, "pixels from 1 to 1e12", rows, cols);
    stress_fill_normal(image, n, 2);
    image[n / 3] = 1e12f;
    e = transform(device, rows, cols, image);
    row_of("T2", &e, worst, "one pixel of 1e12 in noise of 1", rows, cols);
    memset(image, 0, n * sizeof *image);
    image[n / 3] = FLT_MAX / (2.0f * (float)n);
    e = transform(device, rows, cols, image);
    row_of("T2", &e, worst, "one pixel of the largest number / (2 N)", rows, cols);
    fill_constant(image, n, FLT_MAX / (2.0f * (float)n));
    e = transform(device, rows, cols, image);
    row_of("T2", &e, worst, "all pixels of the largest number / (2 N)", rows, cols);
    /* below the normal numbers a number has an absolute error, not a relative one */
    const double lost = stress_fft_underflow(device, rows, cols);
    static const int powers[] = {-120, -130, -140, -145};
    for (size_t k = 0; k < HADA_COUNT(powers); k++) {
        char what[64];
        snprintf(what, sizeof what, "%spixels up to 2^%d", powers[k] < -126 ? "denormal " : "", powers[k]);
        stress_fill_uniform(image, n, 3);
        for (size_t i = 0; i < n; i++)
            image[i] = ldexpf(image[i], powers[k]);
        e = transform(device, rows, cols, image);
        row_of("T3", &e, worst + lost / stress_norm(image, n), what, rows, cols);
    }
}

void stress_transforms(void **state)
{
    (void)state;
    stress_device device = stress_open();
    growth(&device);
    strained(&device);
    stress_close(&device);
    stress_end_group();
}
