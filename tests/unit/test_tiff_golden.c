/* Files that other software wrote (tests/golden/make_golden.py says what is in them), read without Python. */
#include <hadalens/response.h>

#include "io/tiff_page.h"
#include "io_testing.h"

/* The pixel of make_golden.py, before the file's own factor. */
static double golden(int page, int channel, int index)
{
    return index + 1 + 3 * page + 40 * channel;
}

typedef struct golden_case {
    const char *name;
    int frames, channels, slices, times, bits;
    double factor; /* of a pixel as read */
} golden_case;

static const golden_case cases[] = {
    {"grey_u1.tif", 1, 1, 1, 1, 8, 1 / 255.0},
    {"grey_u2.tif", 1, 1, 1, 1, 16, 257 / 65535.0},
    {"grey_u2_big_endian.tif", 1, 1, 1, 1, 16, 257 / 65535.0},
    {"grey_u4.tif", 1, 1, 1, 1, 32, 8388608 / 4294967295.0},
    {"grey_u4_big_endian.tif", 1, 1, 1, 1, 32, 8388608 / 4294967295.0},
    {"grey_i2.tif", 1, 1, 1, 1, 16, 128 / 32767.0},
    {"grey_i2_big_endian.tif", 1, 1, 1, 1, 16, 128 / 32767.0},
    {"grey_f2.tif", 1, 1, 1, 1, 16, 1 / 64.0},
    {"grey_f2_big_endian.tif", 1, 1, 1, 1, 16, 1 / 64.0},
    {"grey_f4.tif", 1, 1, 1, 1, 32, 1 / 64.0},
    {"grey_f4_big_endian.tif", 1, 1, 1, 1, 32, 1 / 64.0},
    {"grey_f8.tif", 1, 1, 1, 1, 64, 1 / 64.0},
    {"grey_f8_big_endian.tif", 1, 1, 1, 1, 64, 1 / 64.0},
    {"rgb_u1.tif", 1, 3, 1, 1, 8, 1 / 255.0},
    {"rgba_u1.tif", 1, 3, 1, 1, 8, 1 / 255.0},
    {"rgb_u2_planar.tif", 1, 3, 1, 1, 16, 257 / 65535.0},
    {"grey_u2_white.tif", 1, 1, 1, 1, 16, 257 / 65535.0},
    {"grey_u2_strips.tif", 1, 1, 1, 1, 16, 257 / 65535.0},
    {"rgb_f4_tiles.tif", 1, 3, 1, 1, 32, 1 / 64.0},
    {"grey_u2_lzw.tif", 1, 1, 1, 1, 16, 257 / 65535.0},
    {"grey_u1_packbits.tif", 1, 1, 1, 1, 8, 1 / 255.0},
    {"grey_f4_deflate.tif", 1, 1, 1, 1, 32, 1 / 64.0},
    {"palette_u1.tif", 1, 3, 1, 1, 8, 1 / 255.0},
    {"pages_bigtiff.tif", 3, 1, 1, 3, 16, 257 / 65535.0},
    {"pages_thumbnails.tif", 2, 1, 1, 2, 8, 1 / 255.0},
    {"imagej.tif", 3, 2, 3, 1, 16, 257 / 65535.0},
    {"imagej_one_directory.tif", 3, 2, 3, 1, 16, 257 / 65535.0},
    {"ome.tif", 3, 2, 3, 1, 16, 257 / 65535.0},
    {"grey_u1.png", 1, 1, 1, 1, 8, 1 / 255.0},
    {"grey_u2.png", 1, 1, 1, 1, 16, 257 / 65535.0},
    {"rgba_u1.png", 1, 3, 1, 1, 8, 1 / 255.0},
    {"palette_u1.png", 1, 3, 1, 1, 8, 1 / 255.0},
    {"grey_u1.npy", 1, 1, 1, 1, 8, 1 / 255.0},
    {"grey_u2.npy", 1, 1, 1, 1, 16, 257 / 65535.0},
    {"grey_u2_big_endian.npy", 1, 1, 1, 1, 16, 257 / 65535.0},
    {"grey_f4.npy", 1, 1, 1, 1, 32, 1 / 64.0},
    {"grey_f8.npy", 1, 1, 1, 1, 64, 1 / 64.0},
    {"rgb_u1.npy", 1, 3, 1, 1, 8, 1 / 255.0},
    {"rgb_u2_planar.npy", 1, 3, 1, 1, 16, 257 / 65535.0},
    {"rgb_f4_fortran.npy", 1, 3, 1, 1, 32, 1 / 64.0},
    {"frames_f4.npy", 4, 1, 1, 4, 32, 1 / 64.0},
    {"frames_rgb_u1.npy", 2, 3, 1, 2, 8, 1 / 255.0},
    {"rgb_f8.mat", 1, 3, 1, 1, 64, 1 / 64.0},
    {"frames_u2.mat", 4, 1, 1, 4, 16, 257 / 65535.0},
    {"grey_u2.mat73", 1, 1, 1, 1, 16, 257 / 65535.0},
};

/* In the form in which the file has it, a frame has the same floats; 8 and 16 bits stay what they are. */
static int expect_stored(hada_tiff_reader *reader, int frame, const hada_image *image)
{
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    hada_pixels pixels;
    SCOPED(hada_image) copy;
    assert_int_equal(hada_tiff_read_stored(reader, frame, HADA_AUTO, &pixels, NULL), HADA_OK);
    assert_true(pixels.type == HADA_PIXEL_F32 || (pixels.type == HADA_PIXEL_U16) == (info->bits > 8));
    assert_int_equal(hada_pixels_to_image(&pixels, &copy, NULL), HADA_OK);
    assert_int_equal(hada_image_count(&copy), hada_image_count(image));
    assert_memory_equal(copy.data, image->data, hada_image_count(image) * sizeof *copy.data);
    free((void *)pixels.data);
    return pixels.type != HADA_PIXEL_F32;
}

TEST(test_pixels)
{
    int whole = 0;
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        const golden_case *g = &cases[k];
        hada_error err = {0};
        hada_tiff_reader *reader;
        if (hada_tiff_open(&reader, io_golden(g->name), &err))
            fail_msg("%s: %s", g->name, err.message);
        const hada_tiff_info *info = hada_tiff_get_info(reader);
        if (info->frames != g->frames || info->channels != g->channels || info->rows != 7 || info->cols != 5 ||
            info->slices != g->slices || info->times != g->times || info->bits != g->bits)
            fail_msg("%s: %d frames, %d channels, %d x %d, %d slices, %d times, %d bits", g->name, info->frames,
                     info->channels, info->rows, info->cols, info->slices, info->times, info->bits);
        /* Backwards, so that pages are not read in the order of the file. */
        for (int frame = g->frames - 1; frame >= 0; frame--) {
            SCOPED(hada_image) image;
            if (hada_tiff_read(reader, frame, &image, &err))
                fail_msg("%s: %s", g->name, err.message);
            assert_int_equal(image.channels, g->channels);
            for (int c = 0; c < image.channels; c++)
                for (int i = 0; i < 35; i++) {
                    double expected = golden(frame, c, i) * g->factor, got = (double)image.data[c * 35 + i];
                    if (fabs(got - expected) > 1e-7 * fabs(expected) + 1e-9)
                        fail_msg("%s, frame %d, channel %d, pixel %d: %.9g, expected %.9g", g->name, frame, c, i, got,
                                 expected);
                }
            whole += expect_stored(reader, frame, &image);
        }
        hada_tiff_close(&reader);
    }
    assert_true(whole > 0);
}

TEST(test_sizes_in_the_world)
{
    const struct {
        const char *name;
        double pixel, spacing;
    } files[] = {{"imagej.tif", 0.25, 2.5}, {"ome.tif", 6.5, 100}, {"grey_u1.tif", 0, 0}};
    for (int i = 0; i < 3; i++) {
        hada_tiff_reader *reader;
        assert_int_equal(hada_tiff_open(&reader, io_golden(files[i].name), NULL), HADA_OK);
        assert_float_equal(hada_tiff_get_info(reader)->pixel_width_um, files[i].pixel, 1e-6);
        assert_float_equal(hada_tiff_get_info(reader)->slice_spacing, files[i].spacing, 1e-6);
        assert_int_equal(hada_tiff_get_info(reader)->distances, 0);
        hada_tiff_close(&reader);
    }
}

/* JPEG changes values by a step or two, and says that they are encoded; light is what a camera's frame is read as. */
TEST(test_jpeg)
{
    static const char *const names[] = {"grey_u1.jpg", "rgb_u1.jpg"};
    for (int k = 0; k < 2; k++) {
        SCOPED(hada_image) stored, light;
        hada_tiff_reader *reader;
        assert_int_equal(hada_tiff_open(&reader, io_golden(names[k]), NULL), HADA_OK);
        assert_true(hada_tiff_get_info(reader)->encoding == HADA_RESPONSE_SRGB);
        hada_tiff_close(&reader);
        assert_int_equal(hada_tiff_load(io_golden(names[k]), 0, &stored, NULL), HADA_OK);
        assert_int_equal(hada_tiff_load_light(io_golden(names[k]), 0, HADA_AUTO, &light, NULL), HADA_OK);
        assert_int_equal(stored.channels, k ? 3 : 1);
        for (int i = 0; i < 35 * stored.channels; i++)
            assert_true(fabs((double)stored.data[i] - golden(0, i / 35, i % 35) / 255.0) < 3.1 / 255.0);
        hada_response_convert(stored.data, hada_image_count(&stored), HADA_RESPONSE_SRGB, HADA_RESPONSE_LINEAR);
        assert_memory_equal(stored.data, light.data, hada_image_count(&light) * sizeof *light.data);
    }
}

/* A raw file gives light: 0 at the black level, 1 at white. */
TEST(test_raw_file)
{
    SCOPED(hada_image) image;
    hada_tiff_reader *reader;
    assert_int_equal(hada_tiff_open(&reader, io_golden("mosaic.dng"), NULL), HADA_OK);
    assert_int_equal(hada_tiff_get_info(reader)->mosaic, HADA_MOSAIC_BGGR);
    hada_tiff_close(&reader);
    assert_int_equal(hada_tiff_load(io_golden("mosaic.dng"), 0, &image, NULL), HADA_OK);
    assert_true(image.channels == 1 && image.rows == 24 && image.cols == 32);
    for (int i = 0; i < 24 * 32; i++)
        assert_float_equal(image.data[i], i / 959.0, 1e-7);
}

TEST(test_refusals)
{
    expect_refusal(io_golden("complex.npy"), HADA_ERROR_FILE_FORMAT, "<c8", "astype");
    expect_refusal(io_golden("complex.tif"), HADA_ERROR_FILE_FORMAT, "complex", "modulus");
    expect_refusal(io_golden("grey_u1_jpegxl.tif"), HADA_ERROR_FILE_FORMAT, "JPEG XL", "deflate");
    expect_refusal(io_golden("missing.tif"), HADA_ERROR_FILE_OPEN, "No such file", "opened");
    expect_refusal(io_folder, HADA_ERROR_FILE_OPEN, "ordinary", "file");
    io_write_bytes(io_path("empty.tif"), "", 0);
    expect_refusal(io_path("empty.tif"), HADA_ERROR_FILE_READ, "empty", "");
    io_write_bytes(io_path("text.tif"), "This is no picture at all.", 26);
    expect_refusal(io_path("text.tif"), HADA_ERROR_FILE_FORMAT, "no known format", "convert");
}

TEST(test_absurd_sizes)
{
    size_t bytes;
    for (int k = 0; k < 3; k++) {
        unsigned char *data = io_read_bytes(io_golden(k == 2 ? "grey_f4_deflate.tif" : "grey_u2.tif"), &bytes);
        io_set_tag(data, bytes, 256, TIFF_LONG, k ? 60000 : 20000000);
        io_set_tag(data, bytes, 257, TIFF_LONG, 60000);
        io_set_tag(data, bytes, 278, TIFF_LONG, 60000); /* still one strip */
        io_write_bytes(io_path("absurd.tif"), data, bytes);
        free(data);
        if (k)
            expect_refusal(io_path("absurd.tif"), HADA_ERROR_FILE_READ, "can hold", "get it again");
        else
            expect_refusal(io_path("absurd.tif"), HADA_ERROR_FILE_FORMAT, "not plausible", "damaged");
    }
}

/* JBIG's library ends the process where a file is damaged. */
TEST(test_codecs_that_are_not_trusted)
{
    size_t bytes;
    SCOPED_MEMORY unsigned char *data = io_read_bytes(io_golden("grey_u2.tif"), &bytes);
    io_set_tag(data, bytes, 259, TIFF_LONG, 34661);
    io_write_bytes(io_path("jbig.tif"), data, bytes);
    expect_refusal(io_path("jbig.tif"), HADA_ERROR_FILE_FORMAT, "JBIG", "deflate");
}

/* Private tags that share bytes: libtiff would take 40 MB for a file of 200 KB. */
TEST(test_tags_that_share_bytes)
{
    enum { TAGS = 200, BYTES = 200000, DIRECTORY = BYTES - 2 - 12 * TAGS - 4 };
    SCOPED_MEMORY unsigned char *data = calloc(BYTES, 1);
    memcpy(data, "II*\0", 4);
    const uint32_t at = DIRECTORY, count = BYTES - 20, offset = 8;
    const uint16_t tags = TAGS, type = 1;
    memcpy(data + 4, &at, 4);
    memcpy(data + at, &tags, 2);
    for (int i = 0; i < TAGS; i++) {
        const uint16_t tag = (uint16_t)(65000 + i);
        unsigned char *entry = data + at + 2 + 12 * i;
        memcpy(entry, &tag, 2);
        memcpy(entry + 2, &type, 2);
        memcpy(entry + 4, &count, 4);
        memcpy(entry + 8, &offset, 4);
    }
    io_write_bytes(io_path("shared.tif"), data, BYTES);
    expect_refusal(io_path("shared.tif"), HADA_ERROR_FILE_READ, "tags of page 1", "get it again");
}

/* A ring of directories must end. */
TEST(test_ring)
{
    size_t bytes;
    unsigned char *data = io_read_bytes(io_golden("grey_u2.tif"), &bytes);
    uint32_t at;
    uint16_t entries;
    memcpy(&at, data + 4, 4);
    memcpy(&entries, data + at, 2);
    memcpy(data + at + 2 + 12u * entries, &at, 4);
    io_write_bytes(io_path("ring.tif"), data, bytes);
    free(data);
    expect_refusal(io_path("ring.tif"), HADA_ERROR_FILE_READ, "ring", "damaged");
}

/* Reads whatever can be read of a damaged file: any status will do, crashes and endless loops will not. */
static int try_all(const char *path)
{
    hada_tiff_reader *reader;
    hada_error err = {0};
    int fine = 0;
    if (hada_tiff_open(&reader, path, &err)) {
        assert_true(*err.message);
        return 0;
    }
    for (int z = 0; z < hada_tiff_get_info(reader)->distances; z++)
        assert_false(isnan(hada_tiff_get_info(reader)->distances_mm[z]));
    int frames = hada_tiff_get_info(reader)->frames;
    for (int i = 0; i < frames && i < 8; i++) {
        SCOPED(hada_image) image;
        fine += !hada_tiff_read(reader, i, &image, &err);
    }
    hada_tiff_close(&reader);
    return fine;
}

static size_t put_value(unsigned char *file, size_t at, int big, int bytes, uint64_t value)
{
    for (int i = 0; i < bytes; i++)
        file[at + (size_t)i] = (unsigned char)(value >> 8 * (big ? bytes - 1 - i : i));
    return at + (size_t)bytes;
}

/* MATLAB writes the numbers of an array in the smallest type that holds them. */
TEST(matlab_numbers_in_smaller_types)
{
    static const struct {
        int class, type, bytes;
        int64_t first; /* of four numbers, each one more */
        int status;
        double scale;
    } rows[] = {{6, 2, 1, 7, HADA_OK, 1},
                {7, 3, 2, -2, HADA_OK, 1},
                {6, 12, 8, -5, HADA_OK, 1},
                {13, 4, 2, 65000, HADA_OK, 4294967295.0},
                {10, 1, 1, -3, HADA_OK, 32767},
                {11, 5, 4, 3, HADA_OK, 65535},
                {9, 1, 1, -3, HADA_ERROR_FILE_READ, 1},
                {9, 4, 2, 255, HADA_ERROR_FILE_READ, 1},
                {6, 8, 1, 1, HADA_ERROR_FILE_READ, 1}};
    for (size_t k = 0; k < 2 * HADA_COUNT(rows); k++) {
        const int i = (int)k / 2, big = (int)k % 2, bytes = rows[i].bytes;
        unsigned char file[300] = "MATLAB 5.0 MAT-file";
        size_t at = put_value(file, put_value(file, 124, big, 2, 0x100), big, 2, 'M' << 8 | 'I');
        at = put_value(file, put_value(file, at, big, 4, 14), big, 4, 16 + 16 + 8 + 8 + 4 * (uint64_t)bytes);
        at = put_value(file, put_value(file, put_value(file, at, big, 4, 6), big, 4, 8), big, 4,
                       (uint64_t)rows[i].class) +
             4;
        at = put_value(file, put_value(file, at, big, 4, 5), big, 4, 8);
        at = put_value(file, put_value(file, at, big, 4, 2), big, 4, 2);
        at = put_value(file, at, big, 4, 1 << 16 | 1) + 4; /* its name, one letter */
        at = put_value(file, put_value(file, at, big, 4, (uint64_t)rows[i].type), big, 4, 4 * (uint64_t)bytes);
        for (int n = 0; n < 4; n++)
            at = put_value(file, at, big, bytes, (uint64_t)(rows[i].first + n));
        io_write_bytes(io_path("small.mat"), file, at);
        SCOPED(hada_image) image = {0}, none = {0};
        hada_error err = {0};
        if ((int)hada_tiff_load(io_path("small.mat"), 0, &image, &err) != rows[i].status)
            fail_msg("row %d: %s", i, err.message);
        for (int n = 0; !rows[i].status && n < 4; n++) /* columns come first */
            assert_float_equal(image.data[n % 2 * 2 + n / 2], (float)((double)(rows[i].first + n) / rows[i].scale), 0);
        io_write_bytes(io_path("small.mat"), file, at - 1); /* cut off */
        assert_int_equal(hada_tiff_load(io_path("small.mat"), 0, &none, &err), HADA_ERROR_FILE_READ);
        assert_non_null(strstr(err.message, "damaged"));
    }
}

static const char *const victims[] = {"imagej.tif",
                                      "imagej_one_directory.tif",
                                      "ome.tif",
                                      "pages_bigtiff.tif",
                                      "rgb_f4_tiles.tif",
                                      "grey_u2_lzw.tif",
                                      "palette_u1.tif",
                                      "pages_thumbnails.tif",
                                      "grey_u1_packbits.tif",
                                      "rgba_u1.png",
                                      "palette_u1.png",
                                      "rgb_u1.jpg",
                                      "rgb_f4_fortran.npy",
                                      "frames_f4.npy",
                                      "rgb_f8.mat",
                                      "frames_u2.mat",
                                      "mosaic.dng"};

TEST(test_truncated)
{
    for (size_t k = 0; k < sizeof victims / sizeof victims[0]; k++) {
        size_t bytes;
        SCOPED_MEMORY unsigned char *data = io_read_bytes(io_golden(victims[k]), &bytes);
        size_t step = bytes > 1000 ? 7 : 1;
        for (size_t length = 0; length < bytes; length += step) {
            io_write_bytes(io_path("cut.tif"), data, length);
            if (try_all(io_path("cut.tif")) && strstr(victims[k], ".jpg"))
                fail_msg("%s can be read from %zu of its %zu bytes", victims[k], length, bytes);
        }
        io_write_bytes(io_path("cut.tif"), data, bytes);
        if (!try_all(io_path("cut.tif")))
            fail_msg("%s cannot be read", victims[k]);
    }
}

TEST(test_flipped)
{
    uint64_t random = 1;
    for (size_t k = 0; k < sizeof victims / sizeof victims[0]; k++) {
        size_t bytes;
        SCOPED_MEMORY unsigned char *data = io_read_bytes(io_golden(victims[k]), &bytes);
        SCOPED_MEMORY unsigned char *copy = malloc(bytes);
        for (int round = 0; round < 150; round++) {
            memcpy(copy, data, bytes);
            for (int flips = 1 + round % 4; flips > 0; flips--)
                copy[io_random(&random) % bytes] = (unsigned char)io_random(&random);
            io_write_bytes(io_path("flipped.tif"), copy, bytes);
            try_all(io_path("flipped.tif"));
        }
    }
}

FIXTURE(io_setup, io_teardown)
