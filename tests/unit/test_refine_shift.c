/* How far a scene moved as a whole. */
#include <math.h>

#include "refine/shift.h"
#include "testing.h"

enum { ROWS = 60, COLS = 72, PLANES = 2, BORDER = 4 };

/* Smooth images that moved by `by`, with an object that did not. */
static void fill(float *images, const double by[2], int object)
{
    for (int z = 0; z < PLANES; z++)
        for (int i = 0; i < ROWS; i++)
            for (int j = 0; j < COLS; j++) {
                const double y = i - by[0], x = j - by[1];
                const int inside = object && i >= 20 && i < 30 && j >= 20 && j < 30;
                images[(z * ROWS + i) * COLS + j] =
                    inside ? 3.0f : (float)(sin(0.4 * y + z) * cos(0.3 * x) + sin(0.21 * y - 0.25 * x));
            }
}

static hada_shift found(const double by[2], int object)
{
    static const double none[2] = {0.0, 0.0};
    static float before[PLANES * ROWS * COLS], now[PLANES * ROWS * COLS];
    hada_shift shift = {.by = {0.0, 0.0}};
    fill(before, none, 0);
    fill(now, by, object);
    ASSERT_OK(hada_shift_find(before, now, PLANES, ROWS, COLS, BORDER, 1, &shift, err));
    return shift;
}

TEST(parts_of_a_pixel_and_several_are_found)
{
    static const double motions[][2] = {{0.0, 0.0}, {0.3, -0.4}, {-1.2, 0.7}, {3.0, 2.5}, {-4.0, 0.1}};
    for (size_t i = 0; i < sizeof motions / sizeof *motions; i++) {
        const hada_shift shift = found(motions[i], 0);
        for (int k = 0; k < 2; k++)
            assert_true(fabs(shift.by[k] - motions[i][k]) < 0.02);
    }
}

TEST(an_object_shows_and_draws_nothing_along)
{
    static const double motion[2] = {0.6, -0.4};
    const hada_shift shift = found(motion, 1);
    for (int k = 0; k < 2; k++)
        assert_true(fabs(shift.by[k] - motion[k]) < 0.1);
    assert_true(shift.spread > 3.0 && shift.most > 5.0);
}

/* Halves of a scene in two planes: it moves behind the edge between them, and becomes brighter; or one half stays. */
TEST(edges_between_planes_draw_nothing_along)
{
    enum { PIXELS = ROWS * COLS };
    static const double motion[2] = {0.5, -0.7}, none[2] = {0.0, 0.0};
    static float scene[PLANES * PIXELS], moved[PLANES * PIXELS];
    fill(scene, none, 0);
    fill(moved, motion, 0);
    for (int alone = 0; alone < 2; alone++) {
        float before[PLANES * PIXELS] = {0.0f}, now[PLANES * PIXELS] = {0.0f};
        hada_shift shift = {.by = {0.0, 0.0}};
        for (int i = 0; i < PIXELS; i++) {
            const int plane = i % COLS >= COLS / 2;
            before[plane * PIXELS + i] = 3.0f + scene[i];
            now[plane * PIXELS + i] = alone ? 3.0f + (plane ? scene : moved)[i] : 1.05f * (3.0f + moved[i]);
        }
        ASSERT_OK(hada_shift_find(before, now, PLANES, ROWS, COLS, BORDER, 1, &shift, err));
        assert_true(alone ? shift.apart > 0.2 : shift.apart < 0.05);
        for (int k = 0; k < 2 && !alone; k++)
            assert_true(fabs(shift.by[k] - motion[k]) < 0.03);
    }
}

/* A motion along edges can't be seen, nor one in the dark. */
TEST(edges_in_one_direction_tell_nothing)
{
    static float before[ROWS * COLS], now[ROWS * COLS];
    for (int pass = 0; pass < 2; pass++) {
        hada_shift shift = {.by = {0.0, 0.0}};
        for (int i = 0; i < ROWS * COLS; i++) {
            before[i] = pass ? (float)sin(0.5 * (i % COLS)) : 0.0f;
            now[i] = pass ? (float)sin(0.5 * (i % COLS) + 0.2) : 0.0f;
        }
        ASSERT_OK(hada_shift_find(before, now, 1, ROWS, COLS, BORDER, 1, &shift, err));
        assert_true(shift.by[0] == 0.0 && shift.by[1] == 0.0);
    }
}

TEST(weights_add_up_to_one)
{
    for (int i = -30; i <= 30; i++) {
        float weights[HADA_REFINE_MOVE_TAPS];
        double sum = 0.0, at = 0.0;
        const int first = hada_shift_weights(i / 10.0, weights);
        for (int a = 0; a < HADA_REFINE_MOVE_TAPS; a++) {
            sum += weights[a];
            at += weights[a] * (double)(first + a);
        }
        assert_true(fabs(sum - 1.0) < 1e-6 && fabs(at + i / 10.0) < 0.05);
    }
}
