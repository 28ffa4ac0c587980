/* The error of the own transforms against FFTW in double precision: relative L2 of forward and inverse transforms of
 * uniform random images in [-1, 1], as a table in Markdown.
 *
 *     perf_fft_accuracy
 */
#include <fftw3.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fft/fft.h"

static hada_error err;

static void must(hada_status status)
{
    if (status) {
        fprintf(stderr, "perf_fft_accuracy: %s\n%s\n", err.message, err.detail);
        exit(1);
    }
}

static void *memory(size_t count, size_t size)
{
    void *p = fftw_malloc(count * size);
    if (!p)
        exit(1);
    return p;
}

static hada_fft_desc whole(hada_fft_direction direction, int rows, int cols)
{
    hada_fft_desc desc = hada_fft_whole(direction, rows, cols, 1);
    desc.backend = HADA_FFT_OWN;
    return desc;
}

static void measure(hada_context *context, hada_slot *slot, int rows, int cols, const char *kind)
{
    const size_t n = (size_t)rows * (size_t)cols, half = (size_t)cols / 2 + 1;
    const hada_fft_desc forward = whole(HADA_FFT_FORWARD, rows, cols), inverse = whole(HADA_FFT_INVERSE, rows, cols);
    hada_fft *f, *i;
    hada_buffer real, spectrum;
    must(hada_fft_create(&f, slot, &forward, &err));
    must(hada_fft_create(&i, slot, &inverse, &err));
    const hada_spectrum_layout *layout = hada_fft_plan_layout(f);
    float *a = memory(n, sizeof *a), *b = memory(2 * layout->count, sizeof *b);
    double *image = memory(n, sizeof *image);
    fftw_complex *exact = memory((size_t)rows * half, sizeof *exact);
    fftw_plan to = fftw_plan_dft_r2c_2d(rows, cols, image, exact, FFTW_ESTIMATE);
    fftw_plan back = fftw_plan_dft_c2r_2d(rows, cols, exact, image, FFTW_ESTIMATE);
    unsigned state = 1;
    for (size_t k = 0; k < n; k++) {
        state = state * 1664525u + 1013904223u;
        image[k] = a[k] = (float)(state >> 8) / 8388608.0f - 1.0f;
    }
    must(hada_buffer_create_from(&real, slot, a, n * sizeof *a, "an image", &err));
    must(hada_buffer_create(&spectrum, context, layout->count * 8, "a spectrum", &err));
    must(hada_fft_forward(f, 1, real.mem, 0, spectrum.mem, 0, &err));
    must(hada_buffer_read(&spectrum, slot, 0, b, layout->count * 8, &err));
    fftw_execute(to);
    double error = 0.0, size = 0.0, inverse_error = 0.0, inverse_size = 0.0;
    for (int y = 0; y < rows; y++)
        for (size_t x = 0; x < half; x++)
            for (int c = 0; c < 2; c++) {
                double *want = &exact[(size_t)y * half + x][c];
                const float got = b[2 * hada_spectrum_index(layout, y, (int)x) + (size_t)c];
                error += (got - *want) * (got - *want);
                size += *want * *want;
                *want = got; /* the inverse starts from the same float numbers */
            }
    must(hada_fft_inverse(i, 1, spectrum.mem, 0, real.mem, 0, NULL, &err));
    must(hada_buffer_read(&real, slot, 0, a, n * sizeof *a, &err));
    fftw_execute(back);
    for (size_t k = 0; k < n; k++) {
        const double want = image[k] / (double)n;
        inverse_error += (a[k] - want) * (a[k] - want);
        inverse_size += want * want;
    }
    printf("| %d x %d | %s | %.2e | %.2e |\n", rows, cols, kind, sqrt(error / size),
           sqrt(inverse_error / inverse_size));
    fflush(stdout);
    fftw_destroy_plan(to);
    fftw_destroy_plan(back);
    hada_fft_destroy(&f);
    hada_fft_destroy(&i);
    hada_buffer_destroy(&real);
    hada_buffer_destroy(&spectrum);
    fftw_free(a);
    fftw_free(b);
    fftw_free(image);
    fftw_free(exact);
}

int main(void)
{
    static const struct {
        int rows, cols;
        const char *kind;
    } sizes[] = {
        {1, 64, "power of two, one row"},
        {64, 64, "power of two"},
        {256, 256, "power of two"},
        {512, 512, "power of two"},
        {1024, 1024, "power of two"},
        {2048, 2048, "power of two, 2^22 points"},
        {1, 8192, "power of two"},
        {8192, 512, "power of two"},
        {16, 16384, "scratch in global memory"},
        {81, 243, "powers of three"},
        {125, 625, "powers of five"},
        {343, 49, "powers of seven"},
        {300, 400, "2, 3, 5"},
        {480, 270, "2, 3, 5"},
        {1000, 750, "2, 3, 5"},
        {1200, 1600, "2, 3, 5"},
        {1050, 840, "2, 3, 5, 7"},
        {1080, 1920, "2, 3, 5"},
        {121, 169, "11, 13"},
        {43, 43, "prime, own stage"},
        {86, 129, "43"},
        {1376, 2064, "43: paper2022"},
        {127, 113, "primes, own stage"},
        {1016, 1016, "127"},
        {131, 137, "primes, chirp"},
        {263, 257, "primes, chirp"},
        {509, 521, "primes, chirp"},
        {1009, 1013, "primes, chirp"},
        {2003, 1999, "primes, chirp"},
        {1, 65537, "prime, chirp, one row"},
        {262, 1024, "2 times 131, chirp"},
        {1, 1048576, "2^20 in one row"},
    };
    hada_context *context;
    hada_slot *slot;
    must(hada_context_create(&context, NULL, &err));
    must(hada_slot_create(&slot, context, &err));
    printf("Relative L2 error against FFTW in double precision, on %s.\n\n", hada_context_device(context)->name);
    printf("| Size | Kind | Forward | Inverse |\n|---|---|---|---|\n");
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        measure(context, slot, sizes[i].rows, sizes[i].cols, sizes[i].kind);
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    return 0;
}
