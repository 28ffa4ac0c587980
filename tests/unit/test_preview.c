/* Pictures are decoded again and examined where something must be drawn. */
#include <cairo.h>

#include "io_testing.h"
#include "picture/drawing.h"
#include "picture/tone.h"

typedef struct picture {
    int width, height;
    unsigned char *rgb;
} picture;

static picture load(const char *path)
{
    cairo_surface_t *image = cairo_image_surface_create_from_png(path);
    assert_int_equal(cairo_surface_status(image), CAIRO_STATUS_SUCCESS);
    picture result = {cairo_image_surface_get_width(image), cairo_image_surface_get_height(image), NULL};
    result.rgb = malloc((size_t)result.width * (size_t)result.height * 3);
    assert_non_null(result.rgb);
    for (int i = 0; i < result.width * result.height; i++) {
        uint32_t pixel;
        memcpy(&pixel,
               cairo_image_surface_get_data(image) + i / result.width * cairo_image_surface_get_stride(image) +
                   4 * (i % result.width),
               sizeof pixel);
        for (int c = 0; c < 3; c++)
            result.rgb[3 * i + c] = (unsigned char)(pixel >> (16 - 8 * c));
    }
    cairo_surface_destroy(image);
    return result;
}

static int count_colour(const picture *p, unsigned char r, unsigned char g, unsigned char b)
{
    int count = 0;
    for (int i = 0; i < p->width * p->height; i++)
        count += p->rgb[3 * i] == r && p->rgb[3 * i + 1] == g && p->rgb[3 * i + 2] == b;
    return count;
}

TEST(test_one_image)
{
    SCOPED(hada_image) image;
    assert_int_equal(hada_image_create(&image, 3, 2, 4, NULL), HADA_OK);
    image.data[0] = 0.25f;  /* red of pixel 0 */
    image.data[8 + 1] = 1;  /* green of pixel 1 */
    image.data[16 + 2] = 5; /* blue of pixel 2: above white */
    image.data[3] = NAN;
    assert_int_equal(hada_png_save(io_path("one.png"), &image, 0, 0.5, NULL), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_png_save(io_path("one.png"), &image, 1, 0.5, NULL), HADA_OK);
    picture p = load(io_path("one.png"));
    const unsigned char expected[24] = {128, 0, 0, 0, 255, 0, 0, 0, 255};
    assert_int_equal(p.width, 4);
    assert_int_equal(p.height, 2);
    assert_memory_equal(p.rgb, expected, 24);
    free(p.rgb);
}

TEST(test_white)
{
    SCOPED(hada_image) image;
    assert_int_equal(hada_image_create(&image, 1, 100, 100, NULL), HADA_OK);
    assert_true(hada_tone_white(&image, 1) == 1);
    image.data[7] = 3; /* a single pixel on black still is seen */
    assert_float_equal(hada_tone_white(&image, 1), 3, 0.03);
    for (int i = 0; i < 10000; i++)
        image.data[i] = (float)i;
    image.data[9999] = INFINITY;
    assert_float_equal(hada_tone_white(&image, 1), 9990, 100);
}

/* Averaging areas keeps the mean; a constant stays constant at any size. */
TEST(test_resampling)
{
    const int sizes[][2] = {{7, 5}, {3, 2}, {35, 20}, {10, 3}, {1, 1}, {7, 23}};
    SCOPED(hada_image) image;
    assert_int_equal(hada_image_create(&image, 1, 5, 7, NULL), HADA_OK);
    for (int constant = 0; constant < 2; constant++) {
        double mean = 0;
        for (int i = 0; i < 35; i++) {
            image.data[i] = constant ? 0.5f : (float)(i % 7) / 7;
            mean += (double)image.data[i] / 35;
        }
        for (int k = 0; k < 6; k++) {
            SCOPED_MEMORY uint32_t *pixels;
            int width = sizes[k][0], height = sizes[k][1];
            assert_int_equal(hada_tone_pixels(&pixels, width, height, &image, 1, 1, NULL), HADA_OK);
            double sum = 0;
            for (int i = 0; i < width * height; i++) {
                sum += pixels[i] & 255;
                assert_true(!constant || pixels[i] == 0x808080);
            }
            assert_float_equal(sum / (width * height), 255 * mean, 1.0);
        }
    }
}

/* Equal steps along the map are equal steps of lightness (CIE L* of the drawn bytes). */
TEST(test_colours)
{
    double last = 0, least = 100, most = 0;
    for (int i = 0; i <= 32; i++) {
        const uint32_t colour = hada_colormap(i / 32.0);
        double luminance = 0;
        static const double weights[3] = {0.2126, 0.7152, 0.0722};
        for (int c = 0; c < 3; c++) {
            double value = (colour >> (16 - 8 * c) & 255) / 255.0;
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

/* Text is as wide as it says, is cut where it must be, between characters, and may leave the sheet. */
TEST(test_text)
{
    SCOPED(hada_drawing) * drawing;
    assert_int_equal(hada_drawing_create(&drawing, 200, 40, 0x000000, NULL), HADA_OK);
    const double whole = hada_drawing_text_width(drawing, 12, "much too long for it");
    assert_true(whole > 60 && hada_drawing_text_width(drawing, 24, "much too long for it") > 1.8 * whole);
    assert_float_equal(hada_drawing_text(drawing, 0, 12, HADA_ANCHOR_LEFT, 12, 0, 0xffffff, "much too long for it"),
                       whole, 1e-9);
    for (double limit = 20; limit < whole; limit += 7) {
        const double width = hada_drawing_text(drawing, 0, 30, HADA_ANCHOR_LEFT, 12, limit, 0xffffff,
                                               "\xc3\xa4\xc3\xb6\xc3\xbc too long");
        assert_true(width <= limit && width > 0);
    }
    hada_drawing_text(drawing, -20, -3, HADA_ANCHOR_RIGHT, 30, 500, 0xffffff, "over the edge");
    char longest[2000];
    memset(longest, 'x', sizeof longest - 1);
    longest[sizeof longest - 1] = 0;
    hada_drawing_text(drawing, 0, 30, HADA_ANCHOR_LEFT, 12, 0, 0xffffff, longest);
    assert_int_equal(hada_drawing_save(drawing, io_path("text.png"), NULL), HADA_OK);
    picture p = load(io_path("text.png"));
    assert_int_equal(p.width, 200);
    assert_true(count_colour(&p, 0, 0, 0) < 200 * 40 - 50); /* something was drawn */
    free(p.rgb);
    ASSERT_FAILS(hada_drawing_save(drawing, io_path("text.gif"), err), HADA_ERROR_ARGUMENT, ".svg");
}

/* A point, a line and a bar of a plot are where the axes say, in PNG; as SVG the same plot is XML. */
TEST(test_plot)
{
    for (int svg = 0; svg < 2; svg++) {
        hada_plot *plot;
        const double x[] = {1, 10, 100}, y[] = {0, 5, 10};
        hada_plot_panel panel = {.left = 60, .top = 30, .width = 200, .height = 100, .title = "a title"};
        panel.across = (hada_plot_axis){1, 100, 1, 0, "across"};
        panel.up = hada_plot_axis_for(y, 3, 0, "up");
        assert_true(panel.up.low == 0 && panel.up.high == 10);
        const hada_plot_mark mark = {HADA_PLOT_SQUARE, 0xff0000, 6, 0, 0};
        assert_int_equal(hada_plot_create(&plot, 300, 180, NULL), HADA_OK);
        hada_plot_panel_begin(plot, &panel);
        hada_plot_bar(plot, 10, 100, 0, 2, 0x00ff00);
        hada_plot_line(plot, x, y, 3, 0x0000ff, 0);
        hada_plot_point(plot, 10, 5, &mark);
        hada_plot_label(plot, 10, 5, "<here & there>");
        hada_plot_panel_end(plot);
        assert_int_equal(hada_plot_save(plot, io_path(svg ? "plot.svg" : "plot.png"), NULL), HADA_OK);
        hada_plot_destroy(&plot);
        assert_null(plot);
    }
    picture p = load(io_path("plot.png"));
    const unsigned char *middle = p.rgb + 3 * (80 * p.width + 160), *bar = p.rgb + 3 * (121 * p.width + 200);
    assert_int_equal(p.width, 300);
    assert_true(middle[0] == 255 && middle[1] == 0 && middle[2] == 0);
    assert_true(bar[0] == 0 && bar[1] == 255 && bar[2] == 0);
    int blue = 0; /* the line is smooth: few pixels are its colour alone */
    for (int i = 0; i < p.width * p.height; i++)
        blue += p.rgb[3 * i + 2] > p.rgb[3 * i] + 60;
    assert_true(blue > 150);
    free(p.rgb);
    size_t bytes;
    unsigned char *text = io_read_bytes(io_path("plot.svg"), &bytes);
    assert_true(bytes > 500 && !memcmp(text, "<?xml", 5));
    free(text);
    SCOPED(hada_plot) *none = NULL; /* as after a failed create: nothing happens */
    hada_plot_point(none, 1, 1, &(hada_plot_mark){0});
    assert_int_equal(hada_plot_save(none, NULL, NULL), HADA_OK);
    hada_plot_destroy(&none);
    assert_int_equal(hada_plot_create(&none, 10, 10, NULL), HADA_OK);
    assert_int_equal(hada_plot_save(none, NULL, NULL), HADA_ERROR_ARGUMENT);
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
                                .gamma = HADA_AUTO,
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
    destroy_images(s->planes, 20);
}

TEST(test_sheets)
{
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
        const uint32_t far = hada_colormap(1);
        if (shapes[k][0] > 1) /* the map and its scale */
            assert_true(count_colour(&p, far >> 16, far >> 8 & 255, far & 255) > 100);
        free(p.rgb);
        if (k == 0) { /* the same input gives the same bytes */
            size_t bytes[2];
            SCOPED_MEMORY unsigned char *first = io_read_bytes(io_path("sheet.png"), &bytes[0]);
            assert_int_equal(hada_preview_save(io_path("sheet.png"), &s.preview, NULL), HADA_OK);
            SCOPED_MEMORY unsigned char *second = io_read_bytes(io_path("sheet.png"), &bytes[1]);
            assert_int_equal(bytes[0], bytes[1]);
            assert_memory_equal(first, second, bytes[0]);
        }
        drop(&s);
    }
}

/* Of a volume: the brightest voxel of each pixel in the colour of its distance, as bright as it can be. */
TEST(test_volume)
{
    scene s;
    make(&s, 7, 1, 40, 40);
    for (int z = 0; z < 7; z++)
        memset(s.planes[z].data, 0, 1600 * sizeof(float));
    for (int i = 0; i < 800; i++) {
        s.planes[6].data[i] = 1.0F;
        s.planes[2].data[i] = 0.9F;
        s.planes[0].data[800 + i] = 1.0F;
    }
    s.preview.volume = 1;
    s.preview.occupied = NULL;
    assert_int_equal(hada_preview_save(io_path("volume.png"), &s.preview, NULL), HADA_OK);
    picture p = load(io_path("volume.png"));
    for (int at = 0; at <= 1; at++) {
        const uint32_t colour = hada_colormap(at), parts[] = {colour >> 16, colour >> 8 & 255, colour & 255};
        uint32_t most = 0;
        int here = 0;
        for (int c = 0; c < 3; c++)
            most = parts[c] > most ? parts[c] : most;
        for (int i = 0; i < p.width * p.height; i++) {
            int near = 1;
            for (int c = 0; c < 3; c++)
                near = near && abs((int)p.rgb[3 * i + c] - (int)(parts[c] * 255 / most)) <= 2;
            here += near;
        }
        assert_true(here > 30000); /* half of a panel, one of 80,000 pixels at least */
    }
    assert_int_equal(count_colour(&p, 255, 184, 40), 0); /* all planes are occupied: none is marked */
    free(p.rgb);
    s.preview.distances_mm = NULL;
    assert_int_equal(hada_preview_save(io_path("volume.png"), &s.preview, NULL), HADA_OK);
    drop(&s);
}

/* Distances beyond which a number and the next are one. */
TEST(test_far_away)
{
    static const double ends[][2] = {{9e15, 9.1e15}, {1e17, 1e17 + 64}, {1e300, 2e300}, {-1e18, 1e18}};
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        scene s;
        SCOPED(hada_plot) * plot;
        hada_plot_panel panel = {.left = 40, .top = 10, .width = 200, .height = 100};
        make(&s, 2, 1, 300, 40);
        memcpy(s.distances, ends[i], sizeof ends[i]);
        assert_int_equal(hada_preview_save(io_path("far.png"), &s.preview, NULL), HADA_OK);
        drop(&s);
        panel.across = panel.up = hada_plot_axis_for(ends[i], 2, 0, "far");
        assert_int_equal(hada_plot_create(&plot, 300, 150, NULL), HADA_OK);
        hada_plot_panel_begin(plot, &panel);
        assert_int_equal(hada_plot_save(plot, io_path("far.svg"), NULL), HADA_OK);
    }
}

/* Any part may be missing; none at all, or a folder that is not there, is an error that leaves nothing. */
TEST(test_parts)
{
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
    ASSERT_FAILS(hada_preview_save(io_path("no/folder.png"), &s.preview, err), HADA_ERROR_FILE_WRITE,
                 "create its folder");
    drop(&s);
}

FIXTURE(io_setup, io_teardown)
