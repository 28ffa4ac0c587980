/* Focus on the device against the reference, and on scenes with a known answer. */
#include "device_fixture.h"
#include "dry.h"
#include "focus/focus.h"
#include "ref/ref_focus.h"

enum { ROWS = 45, COLS = 53, DEPTHS = 5, PIXELS = ROWS * COLS };
static const double distances[DEPTHS] = {100.0, 130.0, 180.0, 290.0, 600.0};

/* Planes of a scene whose right depth varies over the columns: sharp texture there, weak texture elsewhere. */
static void make_planes(hada_image *planes, int channels, double noise, uint64_t seed)
{
    hada_random random;
    hada_random_seed(&random, seed, 0);
    for (int d = 0; d < DEPTHS; d++) {
        ASSERT_OK(hada_image_create(&planes[d], channels, ROWS, COLS, err));
        for (int c = 0; c < channels; c++)
            for (int i = 0; i < PIXELS; i++) {
                const double off = fabs(d - 4.0 * (i % COLS) / (COLS - 1));
                const double share = off < 1.0 ? 1.0 - off : 0.0;
                planes[d].data[c * PIXELS + i] =
                    (float)(share * (0.2 + hada_random_uniform(&random)) + noise * hada_random_normal(&random));
            }
    }
}

static void destroy_planes(hada_image *planes)
{
    destroy_images(planes, DEPTHS);
}

static void compare(const hada_image *planes, const unsigned char *competing, const hada_focus_options *options)
{
    const int channels = planes[0].channels;
    static float packed[DEPTHS * 3 * PIXELS];
    static double all[3 * PIXELS], distance[PIXELS], lead[PIXELS];
    for (int d = 0; d < DEPTHS; d++)
        memcpy(packed + d * channels * PIXELS, planes[d].data, (size_t)(channels * PIXELS) * sizeof(float));
    hada_focus_report expected, report = {.size = sizeof report};
    ASSERT_OK(hada_ref_focus(packed, channels, ROWS, COLS, DEPTHS, distances, competing, options, all, distance, lead,
                             &expected, err));
    SCOPED(hada_image) fused, map;
    ASSERT_OK(hada_focus_stack(context, planes, distances, DEPTHS, competing, options, &fused, &map, &report, err));
    /* medians come from bins of 1/128 octave */
    assert_true(fabs(report.noise - expected.noise) <= 0.006 * expected.noise);
    assert_true(fabs(report.threshold - expected.threshold) <= 0.02 * expected.threshold);
    assert_true(fabs(report.margin - expected.margin) <= 0.03 * expected.margin + 1e-9);
    double norm = 0.0, error = 0.0;
    for (int i = 0; i < channels * PIXELS; i++) {
        norm += all[i] * all[i];
        error += (all[i] - fused.data[i]) * (all[i] - fused.data[i]);
    }
    assert_true(error <= 1e-6 * 1e-6 * norm);
    int checked = 0;
    for (int i = 0; i < PIXELS; i++) {
        if (fabs(lead[i]) < 0.03) /* the bins' rounding decides */
            continue;
        checked++;
        assert_int_equal(isnan(distance[i]) != 0, isnan(map.data[i]) != 0);
        if (!isnan(distance[i])) /* the base level moves the vertex a little */
            assert_true(fabs(hada_depth_index(distances, DEPTHS, map.data[i]) -
                             hada_depth_index(distances, DEPTHS, distance[i])) < 2e-2);
    }
    assert_true(checked > PIXELS / 2);
}

TEST(equals_the_reference)
{
    const unsigned char some[DEPTHS] = {1, 1, 0, 1, 1}, one[DEPTHS] = {0, 0, 1, 0, 0};
    for (int channels = 1; channels <= 3; channels += 2)
        for (int measure = HADA_FOCUS_CONTRAST; measure <= HADA_FOCUS_COMBINED; measure++) {
            const int shared = measure != HADA_FOCUS_CONTRAST;
            hada_image planes[DEPTHS];
            make_planes(planes, channels, 0.01, 5);
            hada_focus_options options;
            hada_focus_options_init(&options, shared);
            options.measure = (hada_focus_measure)measure;
            compare(planes, NULL, &options);
            compare(planes, some, &options);
            compare(planes, one, &options);
            options.window_sigma = 1.2;
            options.false_alarm = 0.2;
            options.fuse = shared ? HADA_FOCUS_WEIGHTED : HADA_FOCUS_SUM;
            compare(planes, NULL, &options);
            destroy_planes(planes);
        }
}

/* A slanted scene: distances between the depths are found by the parabola. */
TEST(slant)
{
    hada_image planes[DEPTHS], fused, map, truth;
    make_planes(planes, 3, 0.003, 9);
    ASSERT_OK(hada_image_create(&truth, 1, ROWS, COLS, err));
    for (int i = 0; i < PIXELS; i++)
        truth.data[i] = (float)hada_depth_distance(distances, DEPTHS, 4.0 * (i % COLS) / (COLS - 1));
    for (int measure = HADA_FOCUS_CONTRAST; measure <= HADA_FOCUS_COMBINED; measure++) {
        hada_focus_options options;
        hada_focus_report report = {.size = sizeof report};
        hada_depth_score score = {.size = sizeof score};
        hada_focus_options_init(&options, 0);
        options.measure = (hada_focus_measure)measure;
        ASSERT_OK(hada_focus_stack(context, planes, distances, DEPTHS, NULL, &options, &fused, &map, &report, err));
        ASSERT_OK(hada_metric_depth(&map, &truth, distances, DEPTHS, 0.5, NULL, &score, err));
        assert_true(score.coverage > 0.9 && fabs(score.coverage - report.coverage) < 1e-12);
        assert_true(score.within > 0.97);
        assert_true(score.mean_steps < 0.25);
        hada_image_destroy(&fused);
        hada_image_destroy(&map);
    }
    hada_image_destroy(&truth);
    destroy_planes(planes);
}

/* Equal planes everywhere: the nearer depth wins; nothing stands out of equal planes, so what is covered is decided by
 * the measures' own level. Depths that do not compete are passed over. */
TEST(ties_and_occupied)
{
    hada_image planes[DEPTHS], fused, map;
    make_planes(planes, 1, 0.01, 3);
    for (int d = 1; d < DEPTHS; d++)
        memcpy(planes[d].data, planes[0].data, PIXELS * sizeof(float));
    for (int i = 0; i < PIXELS; i++) /* everything lit, so that all is covered */
        for (int d = 0; d < DEPTHS; d++)
            planes[d].data[i] = 1.0f + 0.01f * (float)(i % 3);
    hada_focus_options options;
    hada_focus_options_init(&options, 1);
    options.measure = HADA_FOCUS_ENERGY;
    unsigned char competing[DEPTHS] = {0, 1, 1, 0, 0};
    ASSERT_OK(hada_focus_stack(context, planes, distances, DEPTHS, competing, &options, &fused, &map, NULL, err));
    for (int i = 0; i < PIXELS; i++) {
        assert_true(isnan(map.data[i]) || hada_depth_index(distances, DEPTHS, map.data[i]) <= 1.5 + 1e-6);
        assert_true(fabsf(fused.data[i] - 2.0f * planes[1].data[i]) < 1e-6f);
    }
    hada_image_destroy(&fused);
    hada_image_destroy(&map);
    competing[2] = 0; /* one alone: covered wherever there is light above the noise, at exactly its distance */
    ASSERT_OK(hada_focus_stack(context, planes, distances, DEPTHS, competing, &options, &fused, &map, NULL, err));
    for (int i = 0; i < PIXELS; i++)
        assert_true(fabsf(map.data[i] - 130.0f) < 1e-4f);
    hada_image_destroy(&fused);
    hada_image_destroy(&map);
    destroy_planes(planes);
}

/* Noise alone is not taken for an object. In a frame with nothing at all the losers are the smaller ones of equals, so
 * a few times the false alarm asked for (0.01) is covered. */
TEST(noise_is_not_covered)
{
    hada_image planes[DEPTHS], fused, map;
    hada_random random;
    hada_random_seed(&random, 1, 1);
    for (int d = 0; d < DEPTHS; d++) {
        ASSERT_OK(hada_image_create(&planes[d], 1, ROWS, COLS, err));
        for (int i = 0; i < PIXELS; i++)
            planes[d].data[i] = (float)(0.05 * hada_random_normal(&random));
    }
    for (int measure = HADA_FOCUS_CONTRAST; measure <= HADA_FOCUS_COMBINED; measure++) {
        hada_focus_options options;
        hada_focus_report report = {.size = sizeof report};
        hada_focus_options_init(&options, 0);
        options.measure = (hada_focus_measure)measure;
        ASSERT_OK(hada_focus_stack(context, planes, distances, DEPTHS, NULL, &options, &fused, &map, &report, err));
        assert_true(fabs(report.noise / 0.05 - 1.0) < 0.04);
        assert_true(report.coverage < 0.08);
        hada_image_destroy(&fused);
        hada_image_destroy(&map);
    }
    destroy_planes(planes);
}

/* A batch of planes gives the bits of one at a time. */
TEST(batches)
{
    static float packed[DEPTHS * 3 * PIXELS], out[3][4 * PIXELS];
    hada_image planes[DEPTHS];
    make_planes(planes, 3, 0.01, 21);
    for (int d = 0; d < DEPTHS; d++)
        memcpy(packed + d * 3 * PIXELS, planes[d].data, 3 * PIXELS * sizeof(float));
    hada_slot *slot;
    hada_focus *focus;
    hada_buffer stack, results;
    hada_focus_desc desc = {.channels = 3, .rows = ROWS, .cols = COLS, .depths = DEPTHS, .distances_mm = distances};
    hada_focus_options_init(&desc.options, 1);
    const uint64_t before = hada_context_bytes(context);
    ASSERT_OK(hada_slot_create(&slot, context, err));
    ASSERT_OK(hada_focus_create(&focus, slot, &desc, err));
    ASSERT_DRY(hada_context_bytes(context) - before, context, hada_focus,
               hada_focus_create(&object, &dry.slot, &desc, NULL), hada_focus_destroy);
    ASSERT_OK(hada_buffer_create_from(&stack, slot, packed, sizeof packed, "a stack", err));
    ASSERT_OK(hada_buffer_create(&results, context, sizeof out[0], "results", err));
    const int all[DEPTHS] = {0, 1, 2, 3, 4};
    for (int turn = 0; turn < 3; turn++) {
        ASSERT_OK(hada_focus_begin(focus, NULL, err));
        if (turn == 2)
            ASSERT_OK(hada_focus_push_list(focus, all, DEPTHS, stack.mem, err));
        else if (turn)
            ASSERT_OK(hada_focus_push(focus, 0, DEPTHS, stack.mem, 0, err));
        else
            for (int d = 0; d < DEPTHS; d++)
                ASSERT_OK(hada_focus_push(focus, d, 1, stack.mem, (size_t)d * 3 * PIXELS, err));
        ASSERT_OK(hada_focus_finish(focus, 0.0, results.mem, 0, results.mem, 3 * PIXELS, NULL, err));
        ASSERT_OK(hada_buffer_read(&results, slot, 0, out[turn], sizeof out[0], err));
    }
    assert_memory_equal(out[0], out[1], sizeof out[0]);
    assert_memory_equal(out[0], out[2], sizeof out[0]);
    /* no distance where there is little light: the same map otherwise */
    static double all_in_focus[3 * PIXELS], distance[PIXELS];
    double light = 0.0;
    for (int i = 0; i < 3 * PIXELS; i++)
        light += (all_in_focus[i] = out[0][i]) / (3 * PIXELS);
    for (int i = 0; i < PIXELS; i++)
        distance[i] = out[0][3 * PIXELS + i];
    assert_true(hada_ref_focus_dark(all_in_focus, 3, ROWS, COLS, light, distance) > 1e-6);
    ASSERT_OK(hada_focus_begin(focus, NULL, err));
    ASSERT_OK(hada_focus_push(focus, 0, DEPTHS, stack.mem, 0, err));
    ASSERT_OK(hada_focus_finish(focus, light, results.mem, 0, results.mem, 3 * PIXELS, NULL, err));
    ASSERT_OK(hada_buffer_read(&results, slot, 0, out[1], sizeof out[0], err));
    assert_memory_equal(out[0], out[1], 3 * PIXELS * sizeof(float));
    int dark = 0;
    for (int i = 0; i < PIXELS; i++) {
        assert_int_equal(isnan(out[1][3 * PIXELS + i]) != 0, isnan(distance[i]) != 0);
        assert_true(isnan(distance[i]) || distance[i] == out[1][3 * PIXELS + i]);
        dark += isnan(distance[i]) && !isnan(out[0][3 * PIXELS + i]);
    }
    assert_true(dark > PIXELS / 8 && dark < 7 * PIXELS / 8);
    /* planes of some depths, packed: the same as those of all with the others left out */
    const unsigned char some[DEPTHS] = {1, 0, 1, 0, 1};
    const int list[3] = {0, 2, 4};
    ASSERT_OK(hada_focus_begin(focus, some, err));
    ASSERT_OK(hada_focus_push(focus, 0, DEPTHS, stack.mem, 0, err));
    ASSERT_OK(hada_focus_finish(focus, 0.0, results.mem, 0, results.mem, 3 * PIXELS, NULL, err));
    ASSERT_OK(hada_buffer_read(&results, slot, 0, out[0], sizeof out[0], err));
    for (int i = 0; i < 3; i++)
        ASSERT_OK(hada_buffer_write(&stack, slot, (size_t)i * 3 * PIXELS * sizeof(float), planes[list[i]].data,
                                    3 * PIXELS * sizeof(float), err));
    ASSERT_OK(hada_focus_begin(focus, some, err));
    ASSERT_OK(hada_focus_push_list(focus, list, 3, stack.mem, err));
    ASSERT_OK(hada_focus_finish(focus, 0.0, results.mem, 0, results.mem, 3 * PIXELS, NULL, err));
    ASSERT_OK(hada_buffer_read(&results, slot, 0, out[1], sizeof out[1], err));
    assert_memory_equal(out[0], out[1], sizeof out[0]);
    ASSERT_OK(hada_focus_begin(focus, NULL, err));
    ASSERT_FAILS(hada_focus_finish(focus, 0.0, results.mem, 0, results.mem, 0, NULL, err), HADA_ERROR_STATE, "");
    ASSERT_OK(hada_focus_push(focus, 1, 2, stack.mem, 0, err));
    ASSERT_FAILS(hada_focus_push(focus, 2, 1, stack.mem, 0, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_focus_push(focus, 3, 3, stack.mem, 0, err), HADA_ERROR_ARGUMENT, "");
    const unsigned char none[DEPTHS] = {0};
    ASSERT_FAILS(hada_focus_begin(focus, none, err), HADA_ERROR_ARGUMENT, "");
    hada_focus_destroy(&focus);
    HADA_DESTROY_BUFFERS(&stack, &results);
    hada_slot_destroy(&slot);
    assert_true(hada_context_bytes(context) == before);
    destroy_planes(planes);
}

TEST(refusals)
{
    hada_image planes[DEPTHS], fused, map;
    make_planes(planes, 3, 0.01, 21);
    hada_focus_options options;
    hada_focus_options_init(&options, 0);
    options.false_alarm = 0.0;
    ASSERT_FAILS(hada_focus_stack(context, planes, distances, DEPTHS, NULL, &options, &fused, &map, NULL, err),
                 HADA_ERROR_ARGUMENT, "");
    const double falling[DEPTHS] = {5, 4, 3, 2, 1};
    ASSERT_FAILS(hada_focus_stack(context, planes, falling, DEPTHS, NULL, NULL, &fused, &map, NULL, err),
                 HADA_ERROR_ARGUMENT, "");
    planes[3].data[4] = INFINITY;
    ASSERT_FAILS(hada_focus_stack(context, planes, distances, DEPTHS, NULL, NULL, &fused, &map, NULL, err),
                 HADA_ERROR_NOT_FINITE, "");
    planes[3].cols--;
    ASSERT_FAILS(hada_focus_stack(context, planes, distances, DEPTHS, NULL, NULL, &fused, &map, NULL, err),
                 HADA_ERROR_SIZE, "");
    assert_null(fused.data);
    assert_null(map.data);
    destroy_planes(planes);
}

TEST(quantiles)
{
    assert_true(fabs(hada_focus_normal_quantile(0.01) - 2.3263478740408408) < 1e-9);
    assert_true(fabs(hada_focus_normal_quantile(0.5)) < 1e-9);
}

FIXTURE(open_device, close_device)
