/* Where distance maps are hard, by hand: jumps, pixels beyond the list, two surfaces at a pixel, confidence. */
#include "testing.h"

/* Steps of 1/z: indices 0, 1, 2. */
static const double list[] = {100.0, 150.0, 300.0};

/* A map from fractional indices; beyond 99: NaN. */
static hada_image map_of(int rows, int cols, const double *index)
{
    hada_image map;
    ASSERT_OK(hada_image_create(&map, 1, rows, cols, err));
    for (int i = 0; i < rows * cols; i++)
        map.data[i] = index[i] > 99.0 ? NAN : (float)hada_depth_distance(list, 3, index[i]);
    return map;
}

TEST(parts_of_a_map)
{
    unsigned char parts[24];
    const double row[] = {0.0, 0.0, 0.0, 0.4, 0.4, 0.4, 1.0, 1.0, 1.0, 100.0, 2.4, 2.4, -0.6, 2.6};
    SCOPED(hada_image) map = map_of(1, 14, row);
    ASSERT_OK(hada_metric_depth_parts(&map, list, 3, HADA_AUTO, 2, parts, err));
    /* from 0.4 to 1.0 is a jump of 0.6, from 0 to 0.4 none; so are those beside the two pixels outside, which stay
     * outside; a missing pixel is no jump */
    const unsigned char expected[] = {1, 1, 1, 1, 2, 2, 2, 2, 1, 0, 2, 2, 3, 3};
    assert_memory_equal(parts, expected, sizeof expected);
    ASSERT_OK(hada_metric_depth_parts(&map, list, 3, 0.3, 1, parts, err));
    const unsigned char finer[] = {1, 1, 2, 2, 1, 2, 2, 1, 1, 0, 1, 2, 3, 3};
    assert_memory_equal(parts, finer, sizeof finer);
    hada_image_destroy(&map);
    /* downwards as well, and the band has corners */
    double square[24] = {0};
    square[9] = 1.0;
    map = map_of(4, 6, square);
    ASSERT_OK(hada_metric_depth_parts(&map, list, 3, HADA_AUTO, 1, parts, err));
    const unsigned char around[] = {1, 1, 2, 2, 2, 1, 1, 1, 2, 2, 2, 1, 1, 1, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1};
    for (int i = 0; i < 24; i++)
        assert_int_equal(parts[i], around[i]);
    ASSERT_FAILS(hada_metric_depth_parts(&map, list, 1, HADA_AUTO, HADA_AUTO, parts, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_metric_depth_parts(&map, (const double[]){200.0, 100.0}, 2, HADA_AUTO, HADA_AUTO, parts, err),
                 HADA_ERROR_ARGUMENT, "distance 1 is 100 mm");
    ASSERT_FAILS(hada_metric_depth_parts(&map, list, 3, 0.0, HADA_AUTO, parts, err), HADA_ERROR_ARGUMENT, "");
}

TEST(two_surfaces)
{
    const double first[] = {0.0, 0.0, 0.0, 100.0, 0.0}, second[] = {2.0, 2.0, 100.0, 2.0, 2.0},
                 result[] = {0.9, 1.2, 1.9, 0.1, 100.0}, expected[] = {0.0, 2.0, 0.0, 2.0, 0.0};
    SCOPED(hada_image) truth = map_of(1, 5, first), other = map_of(1, 5, second), map = map_of(1, 5, result);
    ASSERT_OK(hada_metric_depth_nearer(&truth, &other, &map, list, 3, err));
    for (int i = 0; i < 5; i++)
        assert_true(fabs(hada_depth_index(list, 3, (double)truth.data[i]) - expected[i]) < 1e-5);
}

/* Errors of 0.1, 0.2, 0.3 and 0.6 steps. */
TEST(confidence)
{
    const double first[] = {0.0, 0.0, 1.0, 1.0, 1.0, 100.0}, result[] = {0.1, 0.2, 1.3, 1.6, 100.0, 1.0};
    SCOPED(hada_image) truth = map_of(1, 6, first), map = map_of(1, 6, result), sure;
    ASSERT_OK(hada_image_create(&sure, 1, 1, 6, err));
    const struct {
        float confidence[4];
        double half, risk;
    } cases[] = {
        {{0.9f, 0.8f, 0.7f, 0.6f}, 0.15, (0.1 + 0.15 + 0.2 + 0.3) / 4.0},             /* knows it all */
        {{0.1f, 0.2f, 0.3f, 0.4f}, 0.45, (0.6 + 0.45 + 1.1 / 3.0 + 0.3) / 4.0},       /* the wrong way round */
        {{0.5f, 0.5f, 0.5f, 0.5f}, 0.30, 0.30},                                       /* says nothing */
        {{0.9f, 0.5f, 0.5f, 0.1f}, (0.1 + 0.25) / 2.0, (0.1 + 0.175 + 0.2 + 0.3) / 4} /* two alike */
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        hada_confidence_score score = {.size = sizeof score};
        memcpy(sure.data, cases[k].confidence, sizeof cases[k].confidence);
        ASSERT_OK(hada_metric_depth_confidence(&map, &truth, &sure, list, 3, NULL, &score, err));
        assert_int_equal(score.pixels, 4);
        assert_true(fabs(score.half_error - cases[k].half) < 1e-5);
        assert_true(fabs(score.risk - cases[k].risk) < 1e-5);
    }
    const unsigned char mask[] = {0, 0, 0, 1, 1, 1}, none[6] = {0};
    hada_confidence_score score = {.size = sizeof score};
    ASSERT_OK(hada_metric_depth_confidence(&map, &truth, &sure, list, 3, mask, &score, err));
    assert_true(score.pixels == 1 && fabs(score.half_error - 0.6) < 1e-5 && fabs(score.risk - 0.6) < 1e-5);
    ASSERT_OK(hada_metric_depth_confidence(&map, &truth, &sure, NULL, 0, mask, &score, err)); /* in millimetres */
    assert_true(fabs(score.risk - fabs((double)map.data[3] - (double)truth.data[3])) < 1e-6);
    ASSERT_OK(hada_metric_depth_confidence(&map, &truth, &sure, list, 3, none, &score, err));
    assert_true(score.pixels == 0 && isnan(score.half_error) && isnan(score.risk));
    sure.cols = 5;
    ASSERT_FAILS(hada_metric_depth_confidence(&map, &truth, &sure, list, 3, NULL, &score, err), HADA_ERROR_SIZE, "");
}
