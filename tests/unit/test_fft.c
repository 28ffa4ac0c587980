/* The library's own transforms against the double-precision reference, in both shapes of kernels: sizes at the edges,
 * rectangles, bands, filter products, guard zones round every output, the same bits whatever the batch. */
#include "fft_fixture.h"

/* 1, 2, 3, squares, primes with a stage of their own and with a chirp, odd by even, multiples of 43, tall and wide. */
TEST(test_sizes)
{
    static const int sizes[][2] = {{1, 1},   {1, 2},   {2, 1},    {2, 2},    {3, 3},    {1, 7},    {5, 1},    {4, 4},
                                   {8, 8},   {1, 16},  {16, 1},   {9, 10},   {15, 14},  {17, 16},  {16, 17},  {33, 31},
                                   {7, 49},  {43, 8},  {24, 43},  {86, 43},  {64, 96},  {100, 60}, {127, 9},  {9, 127},
                                   {131, 5}, {6, 137}, {262, 30}, {1, 257},  {257, 1},  {121, 26}, {2, 1024}, {1024, 3},
                                   {35, 1},  {1, 343}, {256, 48}, {128, 32}, {172, 258}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        const int rows = sizes[i][0], cols = sizes[i][1], batch = 1 + (int)(i % 3);
        check_forward(whole(HADA_FFT_FORWARD, rows, cols, batch));
        check_inverse(whole(HADA_FFT_INVERSE, rows, cols, batch), HADA_FFT_PLAIN, 0, batch);
    }
}

/* Scratch that does not fit local memory. */
TEST(test_long)
{
    check_forward(whole(HADA_FFT_FORWARD, 2, 16384, 1));
    check_inverse(whole(HADA_FFT_INVERSE, 2, 16384, 1), HADA_FFT_PLAIN, 0, 1);
    check_forward(whole(HADA_FFT_FORWARD, 12000, 2, 1));
    check_inverse(whole(HADA_FFT_INVERSE, 12000, 2, 1), HADA_FFT_PLAIN, 0, 1);
}

TEST(test_rectangles)
{
    static const int cases[][6] = {{48, 64, 0, 0, 20, 24},    {48, 64, 28, 40, 20, 24},  {48, 64, 14, 20, 19, 23},
                                   {48, 64, 47, 63, 1, 1},    {48, 64, 0, 63, 48, 1},    {48, 64, 47, 0, 1, 64},
                                   {86, 129, 20, 31, 41, 57}, {86, 129, 43, 86, 43, 43}, {131, 137, 50, 60, 33, 17},
                                   {1, 40, 0, 5, 1, 9},       {40, 1, 7, 0, 20, 1},      {172, 86, 60, 30, 50, 20},
                                   {9, 11, 4, 3, 3, 5}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const int *c = cases[i], batch = 1 + (int)(i % 2), gap = (int)(i % 4);
        check_forward(rectangle(whole(HADA_FFT_FORWARD, c[0], c[1], batch), c[2], c[3], c[4], c[5], gap));
        check_inverse(rectangle(whole(HADA_FFT_INVERSE, c[0], c[1], batch), c[2], c[3], c[4], c[5], gap),
                      HADA_FFT_PLAIN, 0, batch);
    }
}

TEST(test_bands)
{
    static const int cases[][4] = {{48, 64, 5, 7},   {48, 64, 24, 8},  {48, 64, 1, 32}, {43, 86, 10, 12},
                                   {131, 66, 9, 20}, {131, 137, 3, 5}, {9, 16, 100, 3}, {48, 64, 0, 9}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        hada_fft_desc desc = whole(HADA_FFT_INVERSE, cases[i][0], cases[i][1], 2);
        desc.band_rows = cases[i][2];
        desc.band_cols = cases[i][3];
        check_inverse(desc, HADA_FFT_PLAIN, 0, 2);
        desc = rectangle(desc, 1, 2, cases[i][0] / 2, cases[i][1] / 2, 1);
        check_inverse(desc, HADA_FFT_COMPLEX, 0, 1);
    }
}

TEST(test_products)
{
    for (int product = HADA_FFT_COMPLEX; product <= HADA_FFT_SPLIT; product++)
        for (int half = 0; half < 2; half++) {
            if (context->shape == HADA_SHAPE_GROUPS && half != (product == HADA_FFT_COMPLEX))
                continue; /* the others differ as they do in lanes, and every program costs seconds to compile */
            check_inverse(whole(HADA_FFT_INVERSE, 32, 40, 6), (hada_fft_product)product, half, 3);
            if (context->shape == HADA_SHAPE_GROUPS) /* a length that has programs of its own */
                check_inverse(whole(HADA_FFT_INVERSE, 128, 128, 6), (hada_fft_product)product, half, 3);
            check_inverse(rectangle(whole(HADA_FFT_INVERSE, 86, 131, 4), 20, 33, 40, 50, 3), (hada_fft_product)product,
                          half, 2);
        }
}

/* A member's bits do not depend on the batch it stands in, nor on the run. */
TEST(test_batch_invariance)
{
    enum { BATCH = 7, ROWS = 430, COLS = 344, AT = 5 };
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
    unsigned seed = 3;
    for (size_t k = 0; k < one * BATCH; k++)
        a[k] = value(&seed);
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
TEST(test_bytes)
{
    static const int sizes[][2] = {{64, 96}, {131, 43}, {1, 1}, {2, 16384}};
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

TEST(test_errors)
{
    const hada_fft_desc good = whole(HADA_FFT_FORWARD, 16, 24, 2);
    hada_fft_desc bad;
    hada_fft *plan;
    hada_buffer a;
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
    REFUSE(band_rows, -3, HADA_ERROR_ARGUMENT);
#undef REFUSE
    ok(hada_fft_create(&plan, slot, &good, &err));
    ok(hada_buffer_create(&a, context, 1 << 16, "a test", &err));
    assert_int_equal(hada_fft_forward(plan, 3, a.mem, 0, a.mem, 0, &err), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_fft_forward(plan, 0, a.mem, 0, a.mem, 0, &err), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_fft_inverse(plan, 1, a.mem, 0, a.mem, 0, NULL, &err), HADA_ERROR_STATE);
    assert_int_equal(hada_fft_forward(plan, 1, a.mem, 0, a.mem, 1, &err), HADA_ERROR_ARGUMENT);
    hada_fft_destroy(&plan);
    hada_fft_destroy(&plan);
    bad = whole(HADA_FFT_INVERSE, 16, 24, 2);
    ok(hada_fft_create(&plan, slot, &bad, &err));
    const hada_fft_filter none = {.product = HADA_FFT_COMPLEX, .spectrum_count = 1};
    assert_int_equal(hada_fft_inverse(plan, 1, a.mem, 0, a.mem, 0, &none, &err), HADA_ERROR_ARGUMENT);
    hada_fft_destroy(&plan);
    hada_buffer_destroy(&a);
}

TEST(test_good_sizes)
{
    assert_int_equal(hada_fft_good_size(0), 2);
    assert_int_equal(hada_fft_good_size(3), 4);
    assert_int_equal(hada_fft_good_size(11), 12);
    assert_int_equal(hada_fft_good_size(1376), 1400);
    assert_int_equal(hada_fft_good_size(1024), 1024);
}

static int open_groups(void **user)
{
    if (open_device(user))
        return 1;
    context->shape = HADA_SHAPE_GROUPS;
    return 0;
}

FIXTURE(open_device, close_device)
AGAIN(open_groups, close_device, test_sizes, test_long, test_rectangles, test_bands, test_products,
      test_batch_invariance, test_bytes, test_errors, test_good_sizes)
