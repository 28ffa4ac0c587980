/* Pictures: decoded again with libpng and looked at where something must stand. */
#include <hadalens/preview.h>
#include <math.h>
#include <png.h>

#include "io/canvas.h"
#include "io/colormap.h"
#include "io/font.h"
#include "io/tone.h"
#include "io_testing.h"

typedef struct picture {
    int width, height;
    unsigned char *rgb;
} picture;

static picture load(const char *path)
{
    png_image image = {.version = PNG_IMAGE_VERSION};
    assert_true(png_image_begin_read_from_file(&image, path));
    image.format = PNG_FORMAT_RGB;
    picture result = {(int)image.width, (int)image.height, malloc(PNG_IMAGE_SIZE(image))};
    assert_non_null(result.rgb);
    assert_true(png_image_finish_read(&image, NULL, result.rgb, 0, NULL));
    return result;
}

static int count_colour(const picture *p, unsigned char r, unsigned char g, unsigned char b)
{
    int count = 0;
    for (int i = 0; i < p->width * p->height; i++)
        count += p->rgb[3 * i] == r && p->rgb[3 * i + 1] == g && p->rgb[3 * i + 2] == b;
    return count;
}

static void test_one_image(void **state)
{
    (void)state;
    hada_image image;
    assert_int_equal(hada_image_create(&image, 3, 2, 4, NULL), HADA_OK);
    image.data[0] = 0.25f;  /* red of pixel 0 */
    image.data[8 + 1] = 1;  /* green of pixel 1 */
    image.data[16 + 2] = 5; /* blue of pixel 2: above white */
    image.data[3] = NAN;
    assert_int_equal(hada_png_save(io_path("one.png"), &image, 1, 0.5, NULL), HADA_OK);
    picture p = load(io_path("one.png"));
    const unsigned char expected[24] = {128, 0, 0, 0, 255, 0, 0, 0, 255};
    assert_int_equal(p.width, 4);
    assert_int_equal(p.height, 2);
    assert_memory_equal(p.rgb, expected, 24);
    free(p.rgb);
    hada_image_destroy(&image);
}

static void test_white(void **state)
{
    (void)state;
    hada_image image;
    assert_int_equal(hada_image_create(&image, 1, 100, 100, NULL), HADA_OK);
    assert_true(hada_tone_white(&image, 1) == 1);
    image.data[7] = 3; /* a single pixel on black still is seen */
    assert_float_equal(hada_tone_white(&image, 1), 3, 0.03);
    for (int i = 0; i < 10000; i++)
        image.data[i] = (float)i;
    image.data[9999] = INFINITY;
    assert_float_equal(hada_tone_white(&image, 1), 9990, 100);
    hada_image_destroy(&image);
}

/* Averaging areas keeps the mean; a constant stays constant at any size. */
static void test_resampling(void **state)
{
    (void)state;
    const int sizes[][2] = {{7, 5}, {3, 2}, {35, 20}, {10, 3}, {1, 1}, {7, 23}};
    hada_image image;
    assert_int_equal(hada_image_create(&image, 1, 5, 7, NULL), HADA_OK);
    for (int constant = 0; constant < 2; constant++) {
        double mean = 0;
        for (int i = 0; i < 35; i++) {
            image.data[i] = constant ? 0.5f : (float)(i % 7) / 7;
            mean += (double)image.data[i] / 35;
        }
        for (int k = 0; k < 6; k++) {
            hada_canvas canvas;
            int width = sizes[k][0], height = sizes[k][1];
            assert_int_equal(hada_canvas_create(&canvas, width, height, (hada_colour){9, 9, 9}, NULL), HADA_OK);
            assert_int_equal(hada_tone_draw(&canvas, 0, 0, width, height, &image, 1, 1, NULL), HADA_OK);
            double sum = 0;
            for (int i = 0; i < width * height; i++) {
                sum += canvas.rgb[3 * i];
                assert_true(!constant || canvas.rgb[3 * i] == 128);
            }
            assert_float_equal(sum / (width * height), 255 * mean, 1.0);
            hada_canvas_destroy(&canvas);
        }
    }
    hada_image_destroy(&image);
}

/* Equal steps along the map are equal steps of lightness (CIE L* of the drawn bytes). */
static void test_colours(void **state)
{
    (void)state;
    double last = 0, least = 100, most = 0;
    for (int i = 0; i <= 32; i++) {
        unsigned char rgb[3];
        hada_colormap(i / 32.0, rgb);
        double luminance = 0;
        static const double weights[3] = {0.2126, 0.7152, 0.0722};
        for (int c = 0; c < 3; c++) {
            double value = rgb[c] / 255.0;
            luminance += weights[c] * (value <= 0.04045 ? value / 12.92 : pow((value + 0.055) / 1.055, 2.4));
        }
        double lightness = 116 * cbrt(luminance) - 16;
        if (i) {
            least = fmin(least, lightness - last);
            most = fmax(most, lightness - last);
        }
        last = lightness;
    }
    assert_true(least > 1 && most < 4);
}

static void test_glyphs(void **state)
{
    (void)state;
    for (unsigned a = 33; a < 127; a++)
        for (unsigned b = a + 1; b < 127; b++)
            if (!memcmp(hada_font_glyph(a), hada_font_glyph(b), HADA_FONT_HEIGHT))
                fail_msg("'%c' and '%c' look the same", (int)a, (int)b);
    hada_canvas canvas;
    const hada_colour black = {0, 0, 0}, white = {255, 255, 255};
    assert_int_equal(hada_canvas_create(&canvas, 60, 20, black, NULL), HADA_OK);
    assert_true(hada_canvas_text(&canvas, 0, 0, 1, 40, white, "much too long for it") <= 42);
    assert_int_equal(hada_text_width("\xc3\xa4"
                                     "b",
                                     2),
                     22);
    hada_canvas_text(&canvas, -20, -3, 3, 500, white, "over the edge"); /* drawn outside: left out */
    hada_canvas_destroy(&canvas);
}

typedef struct scene {
    hada_image raw, map, aif, planes[20];
    double distances[20];
    unsigned char occupied[20];
    hada_preview preview;
} scene;

static void make(scene *s, int depths, int channels, int rows, int cols)
{
    memset(s, 0, sizeof *s);
    uint64_t random = 1;
    hada_image *images[] = {&s->raw, &s->aif, &s->map};
    assert_int_equal(hada_image_create(&s->raw, channels, 2 * rows, 2 * cols, NULL), HADA_OK);
    assert_int_equal(hada_image_create(&s->aif, channels, rows, cols, NULL), HADA_OK);
    assert_int_equal(hada_image_create(&s->map, 1, rows, cols, NULL), HADA_OK);
    for (int i = 0; i < depths; i++) {
        assert_int_equal(hada_image_create(&s->planes[i], channels, rows, cols, NULL), HADA_OK);
        s->distances[i] = 100 + 25 * i;
        s->occupied[i] = i == depths / 2;
        for (size_t k = 0; k < hada_image_count(&s->planes[i]); k++)
            s->planes[i].data[k] = (float)(io_random(&random) % 1000) / 1000;
    }
    for (int k = 0; k < 3; k++)
        for (size_t i = 0; i < hada_image_count(images[k]); i++)
            images[k]->data[i] =
                k == 2 ? (i % 3 ? (float)s->distances[depths - 1] : NAN) : (float)(io_random(&random) % 1000);
    s->preview = (hada_preview){.size = sizeof(hada_preview),
                                .title = "a frame, a model",
                                .raw = &s->raw,
                                .planes = s->planes,
                                .depths = depths,
                                .distances_mm = s->distances,
                                .occupied = s->occupied,
                                .all_in_focus = &s->aif,
                                .distance_map = &s->map};
}

static void drop(scene *s)
{
    hada_image_destroy(&s->raw);
    hada_image_destroy(&s->aif);
    hada_image_destroy(&s->map);
    for (int i = 0; i < 20; i++)
        hada_image_destroy(&s->planes[i]);
}

static void test_sheets(void **state)
{
    (void)state;
    const int shapes[][4] = {{1, 1, 30, 40}, {2, 3, 40, 30}, {7, 3, 5, 300}, {14, 3, 192, 192}, {20, 1, 200, 4}};
    for (int k = 0; k < 5; k++) {
        scene s;
        make(&s, shapes[k][0], shapes[k][1], shapes[k][2], shapes[k][3]);
        hada_error err = {0};
        if (hada_preview_save(io_path("sheet.png"), &s.preview, &err))
            fail_msg("%s", err.message);
        picture p = load(io_path("sheet.png"));
        assert_int_equal(p.width, 1600);
        assert_in_range(p.height, 100, 2400);
        assert_true(count_colour(&p, 255, 184, 40) > 100); /* the frame of the occupied plane and its words */
        unsigned char far[3];
        hada_colormap(shapes[k][0] > 1, far);
        if (shapes[k][0] > 1)
            assert_true(count_colour(&p, far[0], far[1], far[2]) > 100); /* the map and its scale */
        free(p.rgb);
        if (k == 0) { /* the same input gives the same bytes */
            size_t bytes[2];
            unsigned char *first = io_read_bytes(io_path("sheet.png"), &bytes[0]);
            assert_int_equal(hada_preview_save(io_path("sheet.png"), &s.preview, NULL), HADA_OK);
            unsigned char *second = io_read_bytes(io_path("sheet.png"), &bytes[1]);
            assert_int_equal(bytes[0], bytes[1]);
            assert_memory_equal(first, second, bytes[0]);
            free(first);
            free(second);
        }
        drop(&s);
    }
}

/* Any part may be missing; none at all, or a folder that is not there, is an error that leaves nothing. */
static void test_parts(void **state)
{
    (void)state;
    scene s;
    make(&s, 3, 1, 20, 20);
    for (int missing = 0; missing < 16; missing++) {
        hada_preview preview = s.preview;
        preview.raw = missing & 1 ? NULL : preview.raw;
        preview.planes = missing & 2 ? NULL : preview.planes;
        preview.all_in_focus = missing & 4 ? NULL : preview.all_in_focus;
        preview.distance_map = missing & 8 ? NULL : preview.distance_map;
        preview.distances_mm = missing & 1 ? NULL : preview.distances_mm;
        preview.occupied = missing & 4 ? NULL : preview.occupied;
        preview.title = missing & 8 ? NULL : preview.title;
        unlink(io_path("part.png"));
        assert_int_equal(hada_preview_save(io_path("part.png"), &preview, NULL),
                         missing == 15 ? HADA_ERROR_ARGUMENT : HADA_OK);
        assert_int_equal(io_exists(io_path("part.png")), missing != 15);
    }
    for (int i = 0; i < 400; i++)
        s.map.data[i] = NAN;
    s.preview.planes = NULL;
    s.preview.depths = 0;
    assert_int_equal(hada_preview_save(io_path("nothing.png"), &s.preview, NULL), HADA_OK);
    hada_error err = {0};
    assert_int_equal(hada_preview_save(io_path("no/folder.png"), &s.preview, &err), HADA_ERROR_FILE_WRITE);
    assert_non_null(strstr(err.message, "create its folder"));
    drop(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_image), cmocka_unit_test(test_white),  cmocka_unit_test(test_resampling),
        cmocka_unit_test(test_colours),   cmocka_unit_test(test_glyphs), cmocka_unit_test(test_sheets),
        cmocka_unit_test(test_parts),
    };
    return cmocka_run_group_tests(tests, io_setup, io_teardown);
}
