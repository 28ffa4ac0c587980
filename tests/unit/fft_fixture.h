/* What the tests of the library's own transforms share: plans compared with the double-precision reference, guard zones
 * round every output. */
#ifndef FFT_FIXTURE_H
#define FFT_FIXTURE_H

#include "testing.h"

#include "fft/fft.h"
#include "ref/ref_fft.h"

#define GUARD     64
#define MARK      12345.0f
#define TOLERANCE 4e-7 /* relative L2 */

static hada_context *context;
static hada_slot *slot;
static hada_error err;

static void ok(hada_status status)
{
    if (status)
        fprintf(stderr, "%s\n%s\n", err.message, err.detail);
    assert_int_equal(status, HADA_OK);
}

static float value(unsigned *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) / 8388608.0f - 1.0f;
}

static void *memory(size_t count, size_t size)
{
    void *p = calloc(count ? count : 1, size);
    assert_non_null(p);
    return p;
}

static hada_fft_desc whole(hada_fft_direction direction, int rows, int cols, int batch)
{
    return (hada_fft_desc){.direction = direction,
                           .backend = HADA_FFT_OWN,
                           .rows = rows,
                           .cols = cols,
                           .batch = batch,
                           .real_rows = rows,
                           .real_cols = cols,
                           .real_pitch = (size_t)cols,
                           .real_distance = (size_t)rows * (size_t)cols};
}

static hada_fft_desc rectangle(hada_fft_desc desc, int row0, int col0, int rows, int cols, int gap)
{
    desc.row0 = row0;
    desc.col0 = col0;
    desc.real_rows = rows;
    desc.real_cols = cols;
    desc.real_pitch = (size_t)(cols + gap);
    desc.real_distance = (size_t)rows * desc.real_pitch + (size_t)(3 * gap);
    return desc;
}

static int inside(const hada_fft_desc *d, size_t at)
{
    const size_t within = at % d->real_distance;
    return at / d->real_distance < (size_t)d->batch && within / d->real_pitch < (size_t)d->real_rows &&
           within % d->real_pitch < (size_t)d->real_cols;
}

static void report(const char *what, const hada_fft_desc *d, double error)
{
    if (!(error <= TOLERANCE))
        fprintf(stderr, "%s %dx%d, rectangle %dx%d at (%d, %d), band %d, %d: error %.2e\n", what, d->rows, d->cols,
                d->real_rows, d->real_cols, d->row0, d->col0, d->band_rows, d->band_cols, error);
    assert_true(error <= TOLERANCE);
}

static inline void check_forward(hada_fft_desc desc)
{
    hada_fft *plan;
    hada_buffer real, spectrum;
    unsigned state = 5;
    ok(hada_fft_create(&plan, slot, &desc, &err));
    const hada_spectrum_layout *layout = hada_fft_plan_layout(plan);
    const size_t floats = desc.real_distance * (size_t)desc.batch + GUARD;
    const size_t out = 2 * (layout->count * (size_t)desc.batch + 2 * GUARD), half = (size_t)desc.cols / 2 + 1;
    float *a = memory(floats, sizeof *a), *b = memory(out, sizeof *b);
    double *image = memory((size_t)desc.rows * (size_t)desc.cols, sizeof *image);
    double *want = memory((size_t)desc.rows * half * 2, sizeof *want);
    for (size_t i = 0; i < floats; i++)
        a[i] = value(&state);
    for (size_t i = 0; i < out; i++)
        b[i] = MARK;
    ok(hada_buffer_create_from(&real, slot, a, floats * sizeof *a, "images", &err));
    ok(hada_buffer_create_from(&spectrum, slot, b, out * sizeof *b, "spectra", &err));
    ok(hada_fft_forward(plan, desc.batch, real.mem, GUARD, spectrum.mem, GUARD, &err));
    ok(hada_buffer_read(&spectrum, slot, 0, b, out * sizeof *b, &err));
    for (int m = 0; m < desc.batch; m++) {
        memset(image, 0, (size_t)desc.rows * (size_t)desc.cols * sizeof *image);
        for (int y = 0; y < desc.real_rows; y++)
            for (int x = 0; x < desc.real_cols; x++)
                image[(size_t)(desc.row0 + y) * (size_t)desc.cols + (size_t)(desc.col0 + x)] =
                    a[GUARD + (size_t)m * desc.real_distance + (size_t)y * desc.real_pitch + (size_t)x];
        ok(hada_ref_fft_forward(image, desc.rows, desc.cols, want, &err));
        const float *got = b + 2 * (GUARD + (size_t)m * layout->count);
        double error = 0.0, size = 1e-30;
        for (int y = 0; y < desc.rows; y++)
            for (int x = 0; x <= desc.cols / 2; x++)
                for (int c = 0; c < 2; c++) {
                    const double w = want[2 * ((size_t)y * half + (size_t)x) + (size_t)c];
                    error += pow(got[2 * hada_spectrum_index(layout, y, x) + (size_t)c] - w, 2);
                    size += w * w;
                }
        report("forward", &desc, sqrt(error / size));
        for (size_t i = 0; i < 2 * layout->count; i++)
            assert_true(isfinite(got[i])); /* the padding too */
    }
    for (size_t i = 0; i < 2 * GUARD; i++) {
        assert_true(b[i] == MARK);
        assert_true(b[out - 1 - i] == MARK);
    }
    hada_fft_destroy(&plan);
    assert_null(plan);
    hada_buffer_destroy(&real);
    hada_buffer_destroy(&spectrum);
    free(a);
    free(b);
    free(image);
    free(want);
}

static uint16_t to_half(float x)
{
    union {
        float f;
        uint32_t u;
    } v = {x};
    const uint32_t exponent = (v.u >> 23) & 0xff;
    if (exponent < 113) /* below the normal halves; the tests keep away from there but for zero */
        return (uint16_t)(v.u >> 16 & 0x8000);
    return (uint16_t)((v.u >> 16 & 0x8000) | (exponent - 112) << 10 | (v.u >> 13 & 0x3ff));
}

static float from_half(uint16_t h)
{
    union {
        uint32_t u;
        float f;
    } v = {(uint32_t)(h & 0x7fff) << 13};
    v.f *= 0x1p112f;
    return h & 0x8000 ? -v.f : v.f;
}

/* product 0: none; spectra: how many there are, cycled through by the batch. */
static inline void check_inverse(hada_fft_desc desc, hada_fft_product product, int half_filter, int spectra)
{
    hada_fft *plan;
    hada_buffer real, spectrum, filter = {0};
    unsigned state = 9;
    ok(hada_fft_create(&plan, slot, &desc, &err));
    const hada_spectrum_layout *layout = hada_fft_plan_layout(plan);
    const size_t in = 2 * (layout->count * (size_t)spectra + GUARD), half = (size_t)desc.cols / 2 + 1;
    const size_t floats = desc.real_distance * (size_t)desc.batch + 2 * GUARD, first = 2;
    const size_t filter_count = 2 * layout->count * ((size_t)desc.batch + first);
    float *a = memory(in, sizeof *a), *b = memory(floats, sizeof *b), *w = memory(filter_count, sizeof *w);
    float *kept = memory(in, sizeof *kept);
    uint16_t *h = memory(filter_count, sizeof *h);
    double *image = memory((size_t)desc.rows * (size_t)desc.cols, sizeof *image);
    double *given = memory((size_t)desc.rows * half * 2, sizeof *given);
    for (size_t i = 0; i < in; i++)
        a[i] = value(&state);
    for (size_t i = 0; i < floats; i++)
        b[i] = MARK;
    for (size_t i = 0; i < filter_count; i++) {
        h[i] = to_half(value(&state));
        w[i] = half_filter ? from_half(h[i]) : value(&state);
    }
    ok(hada_buffer_create_from(&spectrum, slot, a, in * sizeof *a, "spectra", &err));
    ok(hada_buffer_create_from(&real, slot, b, floats * sizeof *b, "images", &err));
    ok(half_filter ? hada_buffer_create_from(&filter, slot, h, filter_count * sizeof *h, "filters", &err)
                   : hada_buffer_create_from(&filter, slot, w, filter_count * sizeof *w, "filters", &err));
    const hada_fft_filter use = {.product = product,
                                 .filter = filter.mem,
                                 .half = half_filter,
                                 .spectrum_count = spectra,
                                 .filter_first = (int)first};
    ok(hada_fft_inverse(plan, desc.batch, spectrum.mem, GUARD, real.mem, GUARD, product ? &use : NULL, &err));
    ok(hada_buffer_read(&real, slot, 0, b, floats * sizeof *b, &err));
    ok(hada_buffer_read(&spectrum, slot, 0, kept, in * sizeof *a, &err));
    assert_memory_equal(a, kept, in * sizeof *a);
    const int limited = desc.band_rows || desc.band_cols;
    for (int m = 0; m < desc.batch; m++) {
        const float *s = a + 2 * (GUARD + (size_t)(m % spectra) * layout->count);
        const float *f = w + 2 * ((size_t)m + first) * layout->count;
        for (int y = 0; y < desc.rows; y++)
            for (int x = 0; x <= desc.cols / 2; x++) {
                const size_t at = 2 * hada_spectrum_index(layout, y, x), to = 2 * ((size_t)y * half + (size_t)x);
                const int away = y < desc.rows - y ? y : desc.rows - y;
                const double re = s[at], im = s[at + 1], wr = f[at], wi = f[at + 1];
                given[to] = product == HADA_FFT_PLAIN ? re : re * wr - (product == HADA_FFT_COMPLEX ? im * wi : 0.0);
                given[to + 1] = product == HADA_FFT_PLAIN     ? im
                                : product == HADA_FFT_COMPLEX ? re * wi + im * wr
                                                              : im * wi;
                if (limited && (x > desc.band_cols || away > desc.band_rows))
                    given[to] = given[to + 1] = 0.0;
            }
        ok(hada_ref_fft_inverse(given, desc.rows, desc.cols, image, &err));
        double error = 0.0, size = 1e-30, all = 1e-30;
        for (int y = 0; y < desc.real_rows; y++)
            for (int x = 0; x < desc.real_cols; x++) {
                const double want = image[(size_t)(desc.row0 + y) * (size_t)desc.cols + (size_t)(desc.col0 + x)];
                error +=
                    pow(b[GUARD + (size_t)m * desc.real_distance + (size_t)y * desc.real_pitch + (size_t)x] - want, 2);
                size += want * want;
            }
        for (size_t i = 0; i < (size_t)desc.rows * (size_t)desc.cols; i++)
            all += image[i] * image[i] * desc.real_rows * desc.real_cols / ((double)desc.rows * desc.cols);
        report("inverse", &desc, sqrt(error / (size > all ? size : all)));
    }
    for (size_t i = 0; i < floats; i++)
        if (i < GUARD || i >= floats - GUARD || !inside(&desc, i - GUARD))
            assert_true(b[i] == MARK);
    hada_fft_destroy(&plan);
    hada_buffer_destroy(&real);
    hada_buffer_destroy(&spectrum);
    hada_buffer_destroy(&filter);
    free(a);
    free(b);
    free(w);
    free(kept);
    free(h);
    free(image);
    free(given);
}

static int open_device(void **user)
{
    (void)user;
    DEFAULTS(hada_context_options, options);
    options.device = "cpu";
    return hada_context_create(&context, &options, &err) || hada_slot_create(&slot, context, &err);
}

static int close_device(void **user)
{
    (void)user;
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    return 0;
}

#endif
