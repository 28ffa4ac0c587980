/* Depth maps on the host: each by what must come out. */
#include "surface/level.h"
#include "testing.h"

enum { ROWS = 12, COLS = 17, AREA = ROWS * COLS };
static const hada_map_size whole = {ROWS, COLS};

static void assert_near(double got, double expected, double within)
{
    if (!(fabs(got - expected) <= within))
        fail_msg("%.9g, expected %.9g within %g", got, expected, within);
}

TEST(test_centre)
{
    enum { PLANES = 5, CHANNELS = 2 };
    static float light[PLANES * CHANNELS * AREA], depth[AREA], sum[AREA];
    memset(light, 0, sizeof light);
    for (int i = 0; i < AREA; i++) {
        light[(2 * CHANNELS + 0) * AREA + i] = 1.0F;
        light[(3 * CHANNELS + 1) * AREA + i] = i < AREA / 2 ? 3.0F : 0.0F;
    }
    ASSERT_OK(hada_map_centre(light, PLANES, CHANNELS, whole, 0.0, depth, sum, err));
    for (int i = 0; i < AREA; i++) {
        assert_near(depth[i], i < AREA / 2 ? 2.75 : 2.0, 1e-5);
        assert_near(sum[i], i < AREA / 2 ? 4.0 : 1.0, 1e-6);
    }
    /* light at one pixel reaches its neighbours by a Gaussian, and a scene without light has a depth as well */
    memset(light, 0, sizeof light);
    light[4 * CHANNELS * AREA + 5 * COLS + 8] = 1.0F;
    ASSERT_OK(hada_map_centre(light, PLANES, CHANNELS, whole, 0.5, depth, sum, err));
    assert_near(sum[5 * COLS + 9] / sum[5 * COLS + 8], exp(-2.0), 1e-6);
    assert_near(sum[4 * COLS + 9] / sum[5 * COLS + 8], exp(-4.0), 1e-6);
    assert_near(depth[5 * COLS + 8], 4.0, 1e-3);
    assert_near(depth[0], 2.0, 1e-6);
    light[4 * CHANNELS * AREA + 5 * COLS + 8] = 0.0F;
    ASSERT_OK(hada_map_centre(light, PLANES, CHANNELS, whole, 0.5, depth, sum, err));
    for (int i = 0; i < AREA; i++)
        assert_near(depth[i], 2.0, 1e-6);
}

/* A map of three pixels a row, and a level twice as fine whose window begins one coarse pixel inside. */
TEST(test_band)
{
    enum { PLANES = 8 };
    const float depth[12] = {2.0F, 2.0F, 2.0F, 4.5F, 2.0F, 2.0F, 2.0F, 2.0F, 2.0F, 2.0F, 2.0F, 2.0F};
    const hada_map_size from = {3, 4}, to = {2, 4};
    const hada_map_place place = {1.0, 1.0, 0.5, 0.5};
    float allowed[PLANES * 8];
    ASSERT_OK(hada_map_band(depth, from, 1.0, 1.5, PLANES, to, &place, allowed, err));
    for (int k = 0; k < PLANES; k++) {
        /* its coarse pixels: 1, 1.5 (2), 2, 2.5 (3): from 2 on the map's 4.5 is in reach */
        assert_int_equal(allowed[k * 8 + 0] > 0.0F, k >= 0 && k <= 4);
        assert_int_equal(allowed[k * 8 + 1] > 0.0F, k >= 0 && k <= 6);
        assert_int_equal(allowed[k * 8 + 3] > 0.0F, k >= 0 && k <= 6);
    }
    ASSERT_OK(hada_map_band(depth, from, 2.0, 0.5, PLANES, to, &place, allowed, err));
    for (int k = 0; k < PLANES; k++)
        assert_int_equal(allowed[k * 8 + 0] > 0.0F, k >= 3 && k <= 5);
}

TEST(test_resample)
{
    static float in[AREA], out[4 * AREA];
    const hada_map_size fine = {2 * ROWS, 2 * COLS};
    const hada_map_place place = {-0.25, -0.25, 0.5, 0.5};
    for (int i = 0; i < AREA; i++)
        in[i] = (float)(3.0 * (i / COLS) - 2.0 * (i % COLS));
    hada_map_resample(in, whole, out, fine, &place);
    for (int y = 0; y < fine.rows; y++)
        for (int x = 0; x < fine.cols; x++) {
            const double row = fmin(fmax(0.5 * y - 0.25, 0.0), ROWS - 1),
                         col = fmin(fmax(0.5 * x - 0.25, 0.0), COLS - 1);
            assert_near(out[y * fine.cols + x], 3.0 * row - 2.0 * col, 1e-5);
        }
    /* of one pixel */
    const hada_map_size one = {1, 1};
    const float value = 7.0F;
    hada_map_resample(&value, one, out, whole, &place);
    for (int i = 0; i < AREA; i++)
        assert_true(out[i] == 7.0F);
}

/* Two pixels approach one another by the weight over their light; four steps do not get there, two thousand do. */
TEST(test_smooth_exact)
{
    const hada_map_size two = {1, 2};
    const float light[2] = {1.0F, 3.0F}, texture[2] = {1.0F, 1.0F};
    float depth[2] = {0.0F, 1.0F};
    hada_map_rule rule = {.weight = 0.1, .data = 1.0, .tolerance = 0.4, .steps = 2000};
    ASSERT_OK(hada_map_smooth(depth, light, texture, 1, two, &rule, err));
    assert_near(depth[0], 0.1 / 0.5, 1e-6);
    assert_near(depth[1], 1.0 - 0.1 / 1.5, 1e-6);
    /* an edge of the texture lets them be: exp(-2 / (0.4 * 2)) */
    const float edge[2] = {1.0F, 3.0F}, even[2] = {1.0F, 1.0F};
    float apart[2] = {0.0F, 1.0F};
    ASSERT_OK(hada_map_smooth(apart, even, edge, 1, two, &rule, err));
    assert_near(apart[0], 0.1 * exp(-2.5), 1e-6);
    /* no measurements */
    const float dark[2] = {0.0F, 0.0F};
    apart[0] = 5.0F;
    ASSERT_OK(hada_map_smooth(apart, dark, edge, 1, two, &rule, err));
    assert_true(apart[0] == 5.0F);
}

/* Noise goes, a step stays; both directions of the image alike. */
TEST(test_smooth)
{
    static float depth[2][AREA], light[AREA], texture[AREA];
    const hada_map_size turned = {COLS, ROWS};
    hada_random random;
    double before = 0.0, after = 0.0;
    DEFAULTS(hada_map_rule, rule);
    hada_random_seed(&random, 3, 0);
    for (int i = 0; i < AREA; i++) {
        light[i] = texture[i] = 1.0F;
        depth[0][i] = (float)((i % COLS < COLS / 2 ? 2.0 : 6.0) + 0.05 * hada_random_normal(&random));
        depth[1][i % COLS * ROWS + i / COLS] = depth[0][i];
        before += pow(depth[0][i] - (i % COLS < COLS / 2 ? 2.0 : 6.0), 2.0);
    }
    ASSERT_OK(hada_map_smooth(depth[0], light, texture, 1, whole, &rule, err));
    ASSERT_OK(hada_map_smooth(depth[1], light, texture, 1, turned, &rule, err));
    for (int i = 0; i < AREA; i++) {
        after += pow(depth[0][i] - (i % COLS < COLS / 2 ? 2.0 : 6.0), 2.0);
        assert_near(depth[1][i % COLS * ROWS + i / COLS], depth[0][i], 1e-6);
    }
    assert_true(after < 0.5 * before);
}

TEST(test_confidence)
{
    static float texture[2 * AREA], depth[AREA], sure[AREA];
    const double shift[3] = {1.0, 2.0, 4.0};
    memset(texture, 0, sizeof texture);
    for (int i = 0; i < AREA; i++)
        depth[i] = i % COLS < 8 ? 0.0F : 2.0F;
    /* a bright pixel in both channels: its gradient is at itself and at its neighbours above and to the left */
    texture[5 * COLS + 4] = texture[AREA + 5 * COLS + 4] = 0.3F;
    texture[5 * COLS + 12] = texture[AREA + 5 * COLS + 12] = 0.3F;
    ASSERT_OK(hada_map_confidence(texture, 2, depth, whole, 0.1, shift, 3, 1, sure, err));
    for (int k = 0; k < 2; k++) {
        /* all of it within the 3 x 3 pixels: 2 (2 + 1 + 1) 0.3^2 */
        const double s = (k ? 4.0 : 1.0), deviation = 0.1 / (s * sqrt(8.0 * 0.09));
        assert_near(sure[5 * COLS + 4 + 8 * k], 1.0 / (1.0 + deviation * deviation / 0.25), 1e-5);
    }
    assert_true(sure[0] == 0.0F && sure[AREA - 1] == 0.0F);
    assert_true(sure[7 * COLS + 4] == 0.0F && sure[6 * COLS + 4] > 0.0F);
}

/* A pixel with the light of both sides of a jump takes a side; maps without jumps stay. */
TEST(test_sharpen)
{
    static float depth[AREA], light[AREA];
    for (int i = 0; i < AREA; i++) {
        depth[i] = i % COLS < 8 ? 2.0F : i % COLS > 8 ? 6.0F : 4.5F;
        light[i] = i % COLS < 9 ? 1.0F : 1.2F;
    }
    ASSERT_OK(hada_map_sharpen(depth, light, whole, 1.0, err));
    for (int i = 0; i < AREA; i++)
        assert_true(depth[i] == (i % COLS < 8 ? 2.0F : i % COLS > 8 ? 6.0F : 4.5F));
    for (int i = 0; i < AREA; i++)
        light[i] = i % COLS == 8 ? 0.1F : i % COLS > 8 ? 3.0F : 1.0F;
    ASSERT_OK(hada_map_sharpen(depth, light, whole, 1.0, err));
    for (int i = 0; i < AREA; i++)
        assert_true(depth[i] == (i % COLS < 8 ? 2.0F : 6.0F));
    for (int i = 0; i < AREA; i++)
        depth[i] = 0.4F * (float)(i % COLS);
    ASSERT_OK(hada_map_sharpen(depth, light, whole, 1.0, err));
    for (int i = 0; i < AREA; i++)
        assert_true(depth[i] == 0.4F * (float)(i % COLS));
}

/* Depths on a plane, however steep, are as sure as their texture; beside a jump they are not. */
TEST(test_bend)
{
    static float texture[AREA], depth[AREA], sure[2][AREA];
    const double shift[3] = {1.0, 1.0, 1.0};
    for (int i = 0; i < AREA; i++) {
        texture[i] = (float)((i / COLS + i % COLS) % 2);
        depth[i] = 0.3F * (float)(i % COLS) - 0.2F * (float)(i / COLS);
    }
    ASSERT_OK(hada_map_confidence(texture, 1, depth, whole, 1e-3, shift, 3, 1, sure[0], err));
    for (int y = 3; y < ROWS - 3; y++)
        for (int x = 3; x < COLS - 3; x++)
            assert_true(sure[0][y * COLS + x] > 0.999F);
    for (int i = 0; i < AREA; i++)
        depth[i] = i % COLS < 9 ? 0.0F : 2.0F;
    ASSERT_OK(hada_map_confidence(texture, 1, depth, whole, 1e-3, shift, 3, 1, sure[1], err));
    assert_true(sure[1][5 * COLS + 3] > 0.999F && sure[1][5 * COLS + 14] > 0.999F);
    /* of the columns -3 ... 3 the last four are 2 */
    const double mean = 8.0 / 7.0, slope = 2.0 * (0 + 1 + 2 + 3) / 28.0;
    const double bend = 16.0 / 7.0 - mean * mean - slope * slope * 28.0 / 7.0;
    assert_near(sure[1][5 * COLS + 9], 1.0 / (1.0 + 16.0 * bend), 1e-4);
}
