/* The library's own transforms beyond what the check tool compares (fft_forward, fft_inverse): rows and images with
 * gaps between them, bytes, refusals. */
#include "fft_fixture.h"

TEST(test_rectangles)
{
    static const int cases[][6] = {
        {48, 64, 14, 20, 19, 23}, {48, 64, 47, 0, 1, 64}, {86, 129, 20, 31, 41, 57}, {9, 11, 4, 3, 3, 5}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const int *c = cases[i], batch = 1 + (int)(i % 2), gap = 1 + (int)(i % 3);
        check_forward(rectangle(whole(HADA_FFT_FORWARD, c[0], c[1], batch), c[2], c[3], c[4], c[5], gap));
        check_inverse(rectangle(whole(HADA_FFT_INVERSE, c[0], c[1], batch), c[2], c[3], c[4], c[5], gap),
                      HADA_FFT_PLAIN, 0, batch);
    }
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
AGAIN(open_groups, close_device, test_rectangles, test_bytes)
