/* Frames without a header: how they are described, unpacked, and read from files of several; and the files that a
 * simulated camera writes. */
#include <hadalens/headerless.h>
#include <hadalens/tiff.h>

#include "io/decode.h"
#include "io/encode.h"
#include "io_testing.h"

static void expect_refusal_of(const char *text, const char *words)
{
    hada_error err = {0};
    assert_int_equal(hada_headerless_set(text, &err), HADA_ERROR_ARGUMENT);
    assert_non_null(strstr(err.message, words));
}

TEST(test_descriptions)
{
    hada_headerless frames;
    assert_int_equal(hada_headerless_set("1520x2028:csi12:3072", NULL), HADA_OK);
    assert_true(hada_headerless_get(&frames));
    assert_true(frames.rows == 1520 && frames.cols == 2028 && frames.channels == 1 && frames.bits == 12);
    assert_int_equal(hada_headerless_bytes(&frames, 1), 1520 * 3072);
    assert_int_equal(hada_headerless_set("3x5:csi10", NULL), HADA_OK);
    assert_true(hada_headerless_get(&frames));
    assert_int_equal(hada_headerless_bytes(&frames, 1), 3 * 10);
    assert_int_equal(hada_headerless_bytes(&frames, 16), 3 * 16);
    static const char *const wrong[] = {"",         "3x5",     "x5:u8",         "3x5:u9",    "3x5:u8:", "3x5:u8:9:1",
                                        "0x5:u8",   "3x-5:u8", "99999999x1:u8", "3x5:u88",   " 3x5:u8", "3x5:csi12x",
                                        "3x5:u8:0", "3x5:u8 ", "3X5:u8",        "3x5:csi10:"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        expect_refusal_of(wrong[i], "1520x2028:csi12");
    expect_refusal_of("3x5:u16:9", "at least 10");
    assert_int_equal(hada_headerless_set(NULL, NULL), HADA_OK);
    assert_false(hada_headerless_get(&frames));
}

/* Bits of known values, by hand. */
TEST(test_unpacking)
{
    static const unsigned char ten[] = {0x00, 0xff, 0x80, 0x01, 0xe4, 9, 9}, /* lower bits 0, 1, 2, 3 */
        twelve[] = {0xab, 0x12, 0x3c, 0xff, 0x00, 0x0f}, words[] = {0x34, 0x02, 0xff, 0x03};
    uint16_t out[4];
    const hada_headerless csi10 = {.rows = 1, .cols = 4, .channels = 1, .bits = 10, .packing = HADA_PACKING_CSI10};
    hada_headerless_unpack(&csi10, ten, out);
    assert_true(out[0] == 0 && out[1] == 0x3fd && out[2] == 0x202 && out[3] == 7);
    const hada_headerless csi12 = {.rows = 1, .cols = 3, .channels = 1, .bits = 12, .packing = HADA_PACKING_CSI12};
    hada_headerless_unpack(&csi12, twelve, out);
    assert_true(out[0] == 0xabc && out[1] == 0x123 && out[2] == 0xfff);
    const hada_headerless u10 = {.rows = 2, .cols = 1, .channels = 1, .bits = 10};
    hada_headerless_unpack(&u10, words, out);
    assert_true(out[0] == 0x234 && out[1] == 0x3ff);
}

/* Two frames in a file, with and without gaps between rows. */
TEST(test_files)
{
    static const unsigned char bytes[2 * 2 * 16] = {0, 51, 102, [16] = 153, 204, 255, [32] = 255, [50] = 51};
    hada_tiff_reader *reader;
    SCOPED(hada_image) first = {0};
    SCOPED(hada_image) second = {0};
    hada_error err = {0};
    io_write_bytes(io_path("frames.raw"), bytes, sizeof bytes);
    expect_refusal(io_path("frames.raw"), HADA_ERROR_FILE_FORMAT, "headerless", "no known format");
    for (int given = 0; given < 2; given++) {
        assert_int_equal(hada_headerless_set(given ? "2x3:u8:16" : "2x3:u8", NULL), HADA_OK);
        assert_int_equal(hada_tiff_open(&reader, io_path("frames.raw"), &err), HADA_OK);
        assert_int_equal(hada_tiff_get_info(reader)->frames, 2); /* rows at multiples of 16: no other way fits */
        assert_int_equal(hada_tiff_read(reader, 0, &first, &err), HADA_OK);
        assert_int_equal(hada_tiff_read(reader, 1, &second, &err), HADA_OK);
        hada_tiff_close(&reader);
        for (int i = 0; i < 6; i++)
            assert_float_equal(first.data[i], i / 5.0, 1e-7);
        assert_float_equal(second.data[0], 1.0, 0);
        assert_float_equal(second.data[5], 0.2, 1e-7);
        hada_image_destroy(&first);
        hada_image_destroy(&second);
    }
    assert_int_equal(hada_headerless_set("3x5:u8", NULL), HADA_OK);
    expect_refusal(io_path("frames.raw"), HADA_ERROR_FILE_FORMAT, "64 bytes", "15 bytes each");
    /* what says its format is read by it */
    assert_int_equal(hada_tiff_load(io_golden("mosaic.dng"), 0, &first, NULL), HADA_OK);
    assert_int_equal(first.rows, 24);
    assert_int_equal(hada_headerless_set(NULL, NULL), HADA_OK);
}

/* What is written is read again, to the step of its integers. */
TEST(test_written_frames)
{
    enum { ROWS = 24, COLS = 33, COUNT = ROWS * COLS };
    SCOPED(hada_image) image = {0};
    SCOPED(hada_image) again = {0};
    assert_int_equal(hada_image_create(&image, 1, ROWS, COLS, NULL), HADA_OK);
    for (int i = 0; i < COUNT; i++)
        image.data[i] = 1.1f * (float)i / COUNT - 0.05f; /* below 0 and above 1, too */
    for (int kind = 0; kind < 4; kind++) {
        static const double steps[] = {0, 65535, 4095, 65535};
        const char *path = io_path("frame.any");
        const hada_status status = kind == 0   ? hada_numpy_save(path, &image, 32, NULL)
                                   : kind == 1 ? hada_numpy_save(path, &image, 16, NULL)
                                   : kind == 2 ? hada_packed12_save(path, &image, NULL)
                                               : hada_dng_save(path, &image, HADA_MOSAIC_GRBG, 0.0, NULL);
        assert_int_equal(status, HADA_OK);
        assert_int_equal(hada_headerless_set("24x33:csi12", NULL), HADA_OK);
        assert_int_equal(hada_tiff_load(path, 0, &again, NULL), HADA_OK);
        assert_true(again.channels == 1 && again.rows == ROWS && again.cols == COLS);
        for (int i = 0; i < COUNT; i++) {
            const double value = (double)image.data[i],
                         held = kind ? floor(fmin(fmax(value, 0), 1) * steps[kind] + 0.5) / steps[kind] : value;
            assert_float_equal(again.data[i], held, 1e-7);
        }
        hada_image_destroy(&again);
    }
    assert_int_equal(hada_headerless_set(NULL, NULL), HADA_OK);
}

TEST(test_black_level)
{
    SCOPED(hada_image) image = {0};
    SCOPED(hada_image) again = {0};
    hada_tiff_reader *reader;
    assert_int_equal(hada_image_create(&image, 1, 32, 32, NULL), HADA_OK);
    for (int i = 0; i < 1024; i++)
        image.data[i] = 0.2f + 0.8f * (float)i / 1023;
    assert_int_equal(hada_dng_save(io_path("black.dng"), &image, HADA_MOSAIC_GBRG, 0.2, NULL), HADA_OK);
    assert_int_equal(hada_tiff_open(&reader, io_path("black.dng"), NULL), HADA_OK);
    assert_int_equal(hada_tiff_get_info(reader)->mosaic, HADA_MOSAIC_GBRG);
    assert_int_equal(hada_tiff_read(reader, 0, &again, NULL), HADA_OK);
    hada_tiff_close(&reader);
    for (int i = 0; i < 1024; i++)
        assert_float_equal(again.data[i], i / 1023.0, 2e-5);
}

FIXTURE(io_setup, io_teardown)
