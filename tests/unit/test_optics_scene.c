/* Scenes: cutting and scaling by hand-made cases, procedural scenes by their statistics. */
#include <limits.h>

#include "testing.h"

TEST(scaling)
{
    float in[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
    hada_image image = {1, 3, 4, in}, out;
    assert_int_equal(hada_image_resize(&out, &image, 3, 4, NULL), HADA_OK); /* the same size: the same pixels */
    assert_memory_equal(out.data, in, sizeof in);
    hada_image_destroy(&out);
    assert_int_equal(hada_image_resize(&out, &image, 1, 2, NULL), HADA_OK); /* area means */
    assert_true(out.data[0] == 4.5f && out.data[1] == 6.5f);
    hada_image_destroy(&out);
    assert_int_equal(hada_image_resize(&out, &image, 3, 3, NULL), HADA_OK); /* pixels of 4/3: shares 3/4 and 1/4 */
    assert_true(fabsf(out.data[0] - 0.25f) < 1e-6f && fabsf(out.data[1] - 1.5f) < 1e-6f);
    hada_image_destroy(&out);
    assert_int_equal(hada_image_resize(&out, &image, 3, 8, NULL), HADA_OK); /* bilinear, held at the edges */
    const float line[] = {0, 0.25f, 0.75f, 1.25f, 1.75f, 2.25f, 2.75f, 3};
    assert_memory_equal(out.data, line, sizeof line);
    hada_image_destroy(&out);
    hada_image point = {1, 1, 1, in + 5};
    assert_int_equal(hada_image_resize(&out, &point, 2, 3, NULL), HADA_OK);
    for (int i = 0; i < 6; i++)
        assert_true(out.data[i] == 5.0f);
    hada_image_destroy(&out);
    hada_error err;
    assert_int_equal(hada_image_resize(&out, &image, 0, 3, &err), HADA_ERROR_ARGUMENT);
    assert_null(out.data);
}

TEST(cutting)
{
    float in[12];
    for (int i = 0; i < 12; i++)
        in[i] = (float)(i + 1);
    hada_image image = {1, 3, 4, in}, out;
    assert_int_equal(hada_image_crop(&out, &image, -1, 2, 3, 3, NULL), HADA_OK);
    const float part[] = {0, 0, 0, 3, 4, 0, 7, 8, 0};
    assert_memory_equal(out.data, part, sizeof part);
    hada_image_destroy(&out);
    assert_int_equal(hada_image_crop(&out, &image, INT_MAX, INT_MIN, 3, 3, NULL), HADA_OK);
    assert_true(out.data[0] == 0.0f && out.data[8] == 0.0f);
    hada_image_destroy(&out);
    out = image; /* nothing is made of itself */
    ASSERT_FAILS(hada_image_crop(&out, &out, 0, 0, 2, 2, err), HADA_ERROR_ARGUMENT, "the same image");
    ASSERT_FAILS(hada_image_resize(&out, &out, 2, 2, err), HADA_ERROR_ARGUMENT, "the same image");
    ASSERT_FAILS(hada_image_downsample(&out, &out, 2, HADA_MOSAIC_NONE, 0, err), HADA_ERROR_ARGUMENT, "the same image");
    assert_ptr_equal(out.data, in);
    /* 3 x 4 to a square: the middle 3 x 3 */
    assert_int_equal(hada_scene_fit(&out, &image, 3, 3, NULL), HADA_OK);
    assert_true(out.data[0] == 1.0f && out.data[2] == 3.0f && out.data[8] == 11.0f);
    hada_image_destroy(&out);
    assert_int_equal(hada_scene_fit(&out, &image, 2, 4, NULL), HADA_OK); /* the first two rows of three */
    assert_true(out.data[0] == 1.0f && out.data[7] == 8.0f);
    hada_image_destroy(&out);
    assert_int_equal(hada_window_origin(300, 120), 90);
    assert_int_equal(hada_window_origin(1376, 383), 496);
    assert_int_equal(hada_window_origin(5, 5), 0);
}

TEST(procedural)
{
    hada_image a, b, c;
    assert_int_equal(hada_scene_procedural(&a, 1, 3, 120, 140, NULL), HADA_OK);
    assert_int_equal(hada_scene_procedural(&b, 1, 3, 120, 140, NULL), HADA_OK);
    assert_int_equal(hada_scene_procedural(&c, 2, 3, 120, 140, NULL), HADA_OK);
    assert_memory_equal(a.data, b.data, hada_image_count(&a) * sizeof(float));
    double mae, sum = 0.0, square = 0.0, sharpness;
    assert_int_equal(hada_metric_compare(HADA_METRIC_MAE, &a, &c, 1.0, NULL, &mae, NULL), HADA_OK);
    assert_true(mae > 0.1); /* another seed, another scene */
    for (size_t i = 0; i < hada_image_count(&a); i++) {
        assert_true(a.data[i] >= 0.0f && a.data[i] <= 1.0f);
        sum += a.data[i];
        square += (double)a.data[i] * a.data[i];
    }
    const double mean = sum / (double)hada_image_count(&a);
    assert_true(mean > 0.1 && mean < 0.8);
    assert_true(sqrt(square / (double)hada_image_count(&a) - mean * mean) > 0.1); /* contrast */
    assert_int_equal(hada_metric_sharpness(&a, NULL, &sharpness, NULL), HADA_OK);
    assert_true(sharpness > 0.02); /* edges */
    hada_image_destroy(&a);
    hada_image_destroy(&b);
    hada_image_destroy(&c);
    hada_error err;
    assert_int_equal(hada_scene_procedural(&a, 1, 2, 8, 8, &err), HADA_ERROR_ARGUMENT);
}

TEST(regions)
{
    enum { ROWS = 60, COLS = 80 };
    static int labels[ROWS * COLS], again[ROWS * COLS];
    for (int count = 1; count <= 5; count++) {
        int seen[5] = {0}, borders = 0;
        assert_int_equal(hada_scene_regions(labels, 7, count, ROWS, COLS, NULL), HADA_OK);
        assert_int_equal(hada_scene_regions(again, 7, count, ROWS, COLS, NULL), HADA_OK);
        assert_memory_equal(labels, again, sizeof labels);
        for (int i = 0; i < ROWS * COLS; i++) {
            assert_in_range(labels[i], 0, count - 1);
            seen[labels[i]]++;
            borders += i % COLS && labels[i] != labels[i - 1];
        }
        for (int i = 0; i < count; i++)
            assert_true(seen[i] > ROWS * COLS / 40);
        assert_true(borders < ROWS * 3 * count); /* compact, no salt and pepper */
    }
    hada_error err;
    assert_int_equal(hada_scene_regions(labels, 7, 7, 2, 3, &err), HADA_ERROR_ARGUMENT);
    /* parts add up to the whole */
    assert_int_equal(hada_scene_regions(labels, 3, 3, ROWS, COLS, NULL), HADA_OK);
    hada_image scene, part;
    assert_int_equal(hada_scene_procedural(&scene, 5, 3, ROWS, COLS, NULL), HADA_OK);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(hada_scene_part(&part, &scene, labels, i, NULL), HADA_OK);
        for (size_t j = 0; j < hada_image_count(&scene); j++) {
            assert_true(part.data[j] == (labels[j % (ROWS * COLS)] == i ? scene.data[j] : part.data[j]));
            scene.data[j] -= part.data[j];
        }
        hada_image_destroy(&part);
    }
    for (size_t j = 0; j < hada_image_count(&scene); j++)
        assert_true(scene.data[j] == 0.0f);
    hada_image_destroy(&scene);
}

TEST(noise)
{
    SCOPED(hada_image) image;
    assert_int_equal(hada_image_create(&image, 1, 200, 200, NULL), HADA_OK);
    hada_image_add_noise(&image, 0.1, 9);
    hada_image_add_noise(&image, NAN, 9);
    double sum = 0.0, square = 0.0;
    for (int i = 0; i < 40000; i++)
        sum += image.data[i], square += (double)image.data[i] * image.data[i];
    assert_true(fabs(sum / 40000) < 0.1 * 5.0 / 200.0);
    assert_true(fabs(square / 40000 - 0.01) < 0.01 * 5.0 * sqrt(2.0) / 200.0);
}

/* Every kind stays in the range and differs by its seed; plain shapes by what they are. */
TEST(reliefs)
{
    enum { SIDE = 121 };
    hada_image one, two;
    for (hada_relief_kind kind = HADA_RELIEF_SLANT; kind <= HADA_RELIEF_BARS; kind++) {
        assert_int_equal(
            (hada_relief_kind)hada_enum_value(HADA_ENUM_RELIEF, hada_enum_name(HADA_ENUM_RELIEF, (int)kind)), kind);
        for (uint64_t seed = 0; seed < 6; seed++) {
            double differs = 0.0;
            assert_int_equal(hada_scene_relief(&one, kind, seed, 90, SIDE, NULL), HADA_OK);
            assert_int_equal(hada_scene_relief(&two, kind, seed + 1, 90, SIDE, NULL), HADA_OK);
            for (size_t i = 0; i < hada_image_count(&one); i++) {
                assert_true(one.data[i] >= 0.0f && one.data[i] <= 1.0f);
                differs = fmax(differs, fabs((double)(one.data[i] - two.data[i])));
            }
            assert_true(differs > 0.1);
            hada_image_destroy(&one);
            hada_image_destroy(&two);
        }
    }
    assert_int_equal(hada_scene_relief(&one, HADA_RELIEF_SLANT, 0, SIDE, SIDE, NULL), HADA_OK);
    for (int i = 0; i < SIDE * SIDE; i++)
        assert_true(fabs((double)one.data[i] - i % SIDE / (SIDE - 1.0)) < 1e-6);
    hada_image_destroy(&one);
    assert_int_equal(hada_scene_relief(&one, HADA_RELIEF_HALF, 0, SIDE, SIDE, NULL), HADA_OK);
    for (int i = 0; i < SIDE * SIDE; i++)
        assert_true(fabs((double)one.data[i] - (0.25 + 0.5 * (double)(i / SIDE) / (SIDE - 1.0))) < 1e-6);
    hada_image_destroy(&one);
    assert_int_equal(hada_scene_relief(&one, HADA_RELIEF_STEPS, 0, SIDE, SIDE, NULL), HADA_OK);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double stair = fmin(floor(i % SIDE / (SIDE - 1.0) * 5.0), 4.0);
        assert_true(fabs((double)one.data[i] - (stair / 4.0 * 0.9 + 0.03)) < 1e-6);
    }
    hada_image_destroy(&one);
    assert_int_equal(hada_scene_relief(&one, HADA_RELIEF_BALL, 0, SIDE, SIDE, NULL), HADA_OK);
    assert_true(fabsf(one.data[SIDE * SIDE / 2] - 0.15f) < 1e-6f); /* its middle is nearest, the corners are the wall */
    assert_true(one.data[0] == 0.75f && one.data[SIDE * SIDE - 1] == 0.75f);
    hada_image_destroy(&one);
    /* smooth hills that use the range from 0.1 to 0.9 */
    assert_int_equal(hada_scene_relief(&one, HADA_RELIEF_HILL, 3, SIDE, SIDE, NULL), HADA_OK);
    float least = 1.0f, most = 0.0f, slope = 0.0f;
    for (int i = 1; i < SIDE * SIDE; i++) {
        least = fminf(least, one.data[i]);
        most = fmaxf(most, one.data[i]);
        if (i % SIDE)
            slope = fmaxf(slope, fabsf(one.data[i] - one.data[i - 1]));
    }
    assert_true(fabsf(least - 0.1f) < 1e-6f && fabsf(most - 0.9f) < 1e-6f && slope < 0.05f);
    hada_image_destroy(&one);
    hada_error err;
    assert_int_equal(hada_scene_relief(&one, (hada_relief_kind)9, 0, 8, 8, &err), HADA_ERROR_ARGUMENT);
    assert_null(hada_enum_name(HADA_ENUM_RELIEF, (int)(hada_relief_kind)9));
    assert_int_equal(hada_enum_value(HADA_ENUM_RELIEF, "valley"), -1);
}
