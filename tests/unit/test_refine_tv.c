/* The proximal step of total variation on windows of many sizes: bands, tiles and edges against the reference. */
#include "device_fixture.h"

#include "core/random.h"
#include "ref/ref_tv.h"
#include "refine/proximal.h"

FIXTURE(open_device, close_device)

enum { PLACES = 2, MOST = PLACES * 130 * 520 * 3, PASSES = 2 };

static float planes[MOST], duals[2 * MOST];
static double w[MOST], expected_duals[2 * MOST], u[MOST];

/* Rounding: in six steps each dual errs by a few 2^-24, and u by theta times that. */
#define TOLERANCE 4e-6

static void compare(const float *values, const double *expected, size_t count, double scale)
{
    for (size_t i = 0; i < count; i++)
        assert_true(fabs((double)values[i] - expected[i]) <= TOLERANCE * scale);
}

/* The second pass goes on from the duals of the first one. */
static void check(int channels, int rows, int cols, double theta, double colour)
{
    const size_t count = (size_t)channels * (size_t)rows * (size_t)cols, all = PLACES * count;
    const size_t floats = hada_variation_floats(context, channels, rows, cols, PLACES);
    SCOPED(hada_slot) * slot;
    hada_buffer image, first, second;
    hada_variation variation;
    hada_random random;
    ASSERT_OK(hada_slot_create(&slot, context, err));
    ASSERT_OK(hada_variation_prepare(&variation, slot, channels, rows, cols, err));
    ASSERT_OK(hada_buffer_create(&image, context, (all + HADA_VARIATION_ROOM) * sizeof(float), "planes", err));
    ASSERT_OK(hada_buffer_create(&first, context, floats * sizeof(float), "duals", err));
    ASSERT_OK(hada_buffer_create(&second, context, floats * sizeof(float), "duals", err));
    const cl_mem both[2] = {first.mem, second.mem};
    hada_random_seed(&random, 5, (unsigned)rows);
    memset(expected_duals, 0, sizeof expected_duals);
    for (int pass = 0; pass < PASSES; pass++) {
        for (size_t i = 0; i < all; i++)
            w[i] = planes[i] = (float)hada_random_range(&random, -0.2, 0.8);
        ASSERT_OK(hada_buffer_write(&image, slot, 0, planes, all * sizeof *planes, err));
        ASSERT_OK(hada_variation_step(&variation, slot, image.mem, both, PLACES, theta, colour, !pass, err));
        ASSERT_OK(hada_buffer_read(&image, slot, 0, planes, all * sizeof *planes, err));
        ASSERT_OK(hada_buffer_read(&first, slot, 0, duals, 2 * all * sizeof *duals, err));
        for (size_t at = 0; at < all; at += count)
            ASSERT_OK(hada_ref_tv_coupled(w + at, channels, rows, cols, theta, colour, HADA_REFINE_TV_LENGTH,
                                          HADA_REFINE_TV_STEPS, expected_duals + 2 * at, u + at, err));
        compare(planes, u, all, 1.0 + theta);
        compare(duals, expected_duals, 2 * all, 1.0 / fmin(theta, 1.0));
    }
    HADA_DESTROY_BUFFERS(&image, &first, &second);
}

TEST(agrees_with_the_reference_on_windows_of_any_size)
{
    static const int sides[][2] = {{1, 1}, {2, 9}, {9, 2}, {23, 240}, {24, 241}, {25, 248}, {130, 520}};
    for (size_t i = 0; i < HADA_COUNT(sides); i++) {
        check(3, sides[i][0], sides[i][1], 0.3, 1.5);
        check(1, sides[i][0], sides[i][1], 0.05, 1.0);
    }
    check(3, 100, 31, 0.02, 3.0);
    check(2, 40, 40, 0.1, 1.0);
    check(31, 12, 20, 0.1, 1.5);
}
