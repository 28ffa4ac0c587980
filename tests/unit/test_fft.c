/* The library's own transforms against the double-precision reference, in both shapes of kernels: sizes at the edges,
 * rectangles, bands, filter products, guard zones round every output, the same bits whatever the batch. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

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

static void check_forward(hada_fft_desc desc)
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
static void check_inverse(hada_fft_desc desc, hada_fft_product product, int half_filter, int spectra)
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

/* 1, 2, 3, squares, primes with a stage of their own and with a chirp, odd by even, multiples of 43, tall and wide. */
static void test_sizes(void **user)
{
    static const int sizes[][2] = {{1, 1},   {1, 2},   {2, 1},    {2, 2},    {3, 3},    {1, 7},    {5, 1},    {4, 4},
                                   {8, 8},   {1, 16},  {16, 1},   {9, 10},   {15, 14},  {17, 16},  {16, 17},  {33, 31},
                                   {7, 49},  {43, 8},  {24, 43},  {86, 43},  {64, 96},  {100, 60}, {127, 9},  {9, 127},
                                   {131, 5}, {6, 137}, {262, 30}, {1, 257},  {257, 1},  {121, 26}, {2, 1024}, {1024, 3},
                                   {35, 1},  {1, 343}, {256, 48}, {128, 32}, {172, 258}};
    (void)user;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        const int rows = sizes[i][0], cols = sizes[i][1], batch = 1 + (int)(i % 3);
        check_forward(whole(HADA_FFT_FORWARD, rows, cols, batch));
        check_inverse(whole(HADA_FFT_INVERSE, rows, cols, batch), HADA_FFT_PLAIN, 0, batch);
    }
}

/* Scratch that does not fit local memory. */
static void test_long(void **user)
{
    (void)user;
    check_forward(whole(HADA_FFT_FORWARD, 2, 16384, 1));
    check_inverse(whole(HADA_FFT_INVERSE, 2, 16384, 1), HADA_FFT_PLAIN, 0, 1);
    check_forward(whole(HADA_FFT_FORWARD, 12000, 2, 1));
    check_inverse(whole(HADA_FFT_INVERSE, 12000, 2, 1), HADA_FFT_PLAIN, 0, 1);
}

static void test_rectangles(void **user)
{
    static const int cases[][6] = {{48, 64, 0, 0, 20, 24},    {48, 64, 28, 40, 20, 24},  {48, 64, 14, 20, 19, 23},
                                   {48, 64, 47, 63, 1, 1},    {48, 64, 0, 63, 48, 1},    {48, 64, 47, 0, 1, 64},
                                   {86, 129, 20, 31, 41, 57}, {86, 129, 43, 86, 43, 43}, {131, 137, 50, 60, 33, 17},
                                   {1, 40, 0, 5, 1, 9},       {40, 1, 7, 0, 20, 1},      {172, 86, 60, 30, 50, 20},
                                   {9, 11, 4, 3, 3, 5}};
    (void)user;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const int *c = cases[i], batch = 1 + (int)(i % 2), gap = (int)(i % 4);
        check_forward(rectangle(whole(HADA_FFT_FORWARD, c[0], c[1], batch), c[2], c[3], c[4], c[5], gap));
        check_inverse(rectangle(whole(HADA_FFT_INVERSE, c[0], c[1], batch), c[2], c[3], c[4], c[5], gap),
                      HADA_FFT_PLAIN, 0, batch);
    }
}

static void test_bands(void **user)
{
    static const int cases[][4] = {{48, 64, 5, 7},   {48, 64, 24, 8},  {48, 64, 1, 32}, {43, 86, 10, 12},
                                   {131, 66, 9, 20}, {131, 137, 3, 5}, {9, 16, 100, 3}, {48, 64, 0, 9}};
    (void)user;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        hada_fft_desc desc = whole(HADA_FFT_INVERSE, cases[i][0], cases[i][1], 2);
        desc.band_rows = cases[i][2];
        desc.band_cols = cases[i][3];
        check_inverse(desc, HADA_FFT_PLAIN, 0, 2);
        desc = rectangle(desc, 1, 2, cases[i][0] / 2, cases[i][1] / 2, 1);
        check_inverse(desc, HADA_FFT_COMPLEX, 0, 1);
    }
}

static void test_products(void **user)
{
    (void)user;
    for (int product = HADA_FFT_COMPLEX; product <= HADA_FFT_SPLIT; product++)
        for (int half = 0; half < 2; half++) {
            if (context->shape == HADA_SHAPE_GROUPS && half != (product == HADA_FFT_COMPLEX))
                continue; /* the others differ as they do in lanes, and every program costs seconds to compile */
            check_inverse(whole(HADA_FFT_INVERSE, 32, 40, 6), (hada_fft_product)product, half, 3);
            check_inverse(rectangle(whole(HADA_FFT_INVERSE, 86, 131, 4), 20, 33, 40, 50, 3), (hada_fft_product)product,
                          half, 2);
        }
}

/* A member's bits do not depend on the batch it stands in, nor on the run. */
static void test_batch_invariance(void **user)
{
    enum { BATCH = 7, ROWS = 430, COLS = 344, AT = 5 };
    (void)user;
    hada_fft_desc forward = whole(HADA_FFT_FORWARD, ROWS, COLS, BATCH);
    hada_fft_desc inverse = rectangle(whole(HADA_FFT_INVERSE, ROWS, COLS, BATCH), 100, 90, 201, 150, 0);
    const size_t one = (size_t)ROWS * COLS, out = inverse.real_distance;
    hada_fft *f, *i, *f1, *i1;
    hada_buffer real, spectrum, single, result;
    ok(hada_fft_create(&f, slot, &forward, &err));
    ok(hada_fft_create(&i, slot, &inverse, &err));
    forward.batch = inverse.batch = 1;
    ok(hada_fft_create(&f1, slot, &forward, &err));
    ok(hada_fft_create(&i1, slot, &inverse, &err));
    const size_t count = hada_fft_plan_layout(f)->count;
    float *a = memory(one * BATCH, sizeof *a), *b = memory(2 * count, sizeof *b), *c = memory(2 * count, sizeof *c);
    unsigned state = 3;
    for (size_t k = 0; k < one * BATCH; k++)
        a[k] = value(&state);
    ok(hada_buffer_create_from(&real, slot, a, one * BATCH * sizeof *a, "images", &err));
    ok(hada_buffer_create(&spectrum, context, count * BATCH * 8, "spectra", &err));
    ok(hada_buffer_create(&single, context, count * 8, "a spectrum", &err));
    ok(hada_buffer_create(&result, context, out * BATCH * sizeof *a, "images", &err));
    ok(hada_fft_forward(f, BATCH, real.mem, 0, spectrum.mem, 0, &err));
    ok(hada_fft_forward(f1, 1, real.mem, AT * one, single.mem, 0, &err));
    ok(hada_buffer_read(&spectrum, slot, AT * count * 8, b, count * 8, &err));
    ok(hada_buffer_read(&single, slot, 0, c, count * 8, &err));
    assert_memory_equal(b, c, count * 8);
    ok(hada_fft_inverse(i, BATCH, spectrum.mem, 0, result.mem, 0, NULL, &err));
    ok(hada_buffer_read(&result, slot, AT * out * sizeof *a, b, out * sizeof *a, &err));
    ok(hada_fft_inverse(i1, 1, single.mem, 0, result.mem, 0, NULL, &err));
    ok(hada_buffer_read(&result, slot, 0, c, out * sizeof *a, &err));
    assert_memory_equal(b, c, out * sizeof *a);
    /* a part of a batch, from elsewhere in the buffers */
    ok(hada_fft_inverse(i, 2, spectrum.mem, (AT - 1) * count, result.mem, 3 * out, NULL, &err));
    ok(hada_buffer_read(&result, slot, 4 * out * sizeof *a, c, out * sizeof *a, &err));
    assert_memory_equal(b, c, out * sizeof *a);
    hada_fft_destroy(&f);
    hada_fft_destroy(&i);
    hada_fft_destroy(&f1);
    hada_fft_destroy(&i1);
    hada_buffer_destroy(&real);
    hada_buffer_destroy(&spectrum);
    hada_buffer_destroy(&single);
    hada_buffer_destroy(&result);
    free(a);
    free(b);
    free(c);
}

/* What a plan holds is what hada_fft_bytes() said, and nothing stays behind. */
static void test_bytes(void **user)
{
    static const int sizes[][2] = {{64, 96}, {131, 43}, {1, 1}, {2, 16384}};
    (void)user;
    const uint64_t before = hada_context_bytes(context);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (int direction = HADA_FFT_FORWARD; direction <= HADA_FFT_INVERSE; direction++) {
            hada_fft *plan;
            hada_fft_desc desc = whole((hada_fft_direction)direction, sizes[i][0], sizes[i][1], 3);
            ok(hada_fft_create(&plan, slot, &desc, &err));
            assert_int_equal(hada_context_bytes(context) - before, hada_fft_bytes(context, &desc));
            hada_fft_destroy(&plan);
            assert_int_equal(hada_context_bytes(context), before);
        }
}

static void refuse(hada_fft_desc desc, hada_status status)
{
    hada_fft *plan = (hada_fft *)&desc;
    assert_int_equal(hada_fft_create(&plan, slot, &desc, &err), status);
    assert_null(plan);
    assert_true(strlen(err.message) > 20);
    assert_int_equal(hada_fft_bytes(context, &desc), 0);
}

static void test_errors(void **user)
{
    const hada_fft_desc good = whole(HADA_FFT_FORWARD, 16, 24, 2);
    hada_fft_desc bad;
    hada_fft *plan;
    hada_buffer a;
    (void)user;
#define REFUSE(FIELD, VALUE, STATUS) (bad = good, bad.FIELD = (VALUE), refuse(bad, STATUS))
    REFUSE(direction, (hada_fft_direction)0, HADA_ERROR_ARGUMENT);
    REFUSE(rows, 0, HADA_ERROR_SIZE);
    REFUSE(cols, -4, HADA_ERROR_SIZE);
    REFUSE(batch, 0, HADA_ERROR_ARGUMENT);
    REFUSE(row0, 1, HADA_ERROR_SIZE);
    REFUSE(col0, -1, HADA_ERROR_SIZE);
    REFUSE(real_rows, 0, HADA_ERROR_SIZE);
    REFUSE(real_cols, 25, HADA_ERROR_SIZE);
    REFUSE(real_pitch, 23, HADA_ERROR_SIZE);
    REFUSE(real_distance, 100, HADA_ERROR_SIZE);
    REFUSE(band_rows, 3, HADA_ERROR_ARGUMENT);
#undef REFUSE
    ok(hada_fft_create(&plan, slot, &good, &err));
    ok(hada_buffer_create(&a, context, 1 << 16, "a test", &err));
    assert_int_equal(hada_fft_forward(plan, 3, a.mem, 0, a.mem, 0, &err), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_fft_forward(plan, 0, a.mem, 0, a.mem, 0, &err), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_fft_inverse(plan, 1, a.mem, 0, a.mem, 0, NULL, &err), HADA_ERROR_STATE);
    hada_fft_destroy(&plan);
    hada_fft_destroy(&plan);
    bad = whole(HADA_FFT_INVERSE, 16, 24, 2);
    ok(hada_fft_create(&plan, slot, &bad, &err));
    const hada_fft_filter none = {.product = HADA_FFT_COMPLEX, .spectrum_count = 1};
    assert_int_equal(hada_fft_inverse(plan, 1, a.mem, 0, a.mem, 0, &none, &err), HADA_ERROR_ARGUMENT);
    hada_fft_destroy(&plan);
    hada_buffer_destroy(&a);
}

static void test_good_sizes(void **user)
{
    (void)user;
    assert_int_equal(hada_fft_good_size(0), 2);
    assert_int_equal(hada_fft_good_size(3), 4);
    assert_int_equal(hada_fft_good_size(11), 12);
    assert_int_equal(hada_fft_good_size(1376), 1400);
    assert_int_equal(hada_fft_good_size(1024), 1024);
}

static int open_device(void **user)
{
    (void)user;
    hada_context_options options;
    hada_context_options_init(&options);
    options.device = "cpu";
    return hada_context_create(&context, &options, &err) || hada_slot_create(&slot, context, &err);
}

static int open_groups(void **user)
{
    if (open_device(user))
        return 1;
    context->shape = HADA_SHAPE_GROUPS;
    return 0;
}

static int close_device(void **user)
{
    (void)user;
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sizes), cmocka_unit_test(test_long),     cmocka_unit_test(test_rectangles),
        cmocka_unit_test(test_bands), cmocka_unit_test(test_products), cmocka_unit_test(test_batch_invariance),
        cmocka_unit_test(test_bytes), cmocka_unit_test(test_errors),   cmocka_unit_test(test_good_sizes),
    };
    return cmocka_run_group_tests_name("lanes", tests, open_device, close_device) |
           cmocka_run_group_tests_name("groups", tests, open_groups, close_device);
}
