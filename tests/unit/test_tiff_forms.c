/* Forms of TIFF that others write and golden files lack: kinds of numbers and colours, alpha, tiles, resolutions and
 * codecs. What is not offered is refused by its name. */
#include <tiffio.h>

#include "io_testing.h"

enum { ROWS = 5, COLS = 6, AREA = ROWS * COLS, MOST_SAMPLES = 4, TILE = 16, ICCLAB = 9 };

/* A page that libtiff writes; zeros are TIFF's own defaults. */
typedef struct form {
    unsigned bits, samples, format, photometric, compression, planar, tiled, extra, unit, type;
} form;

static TIFF *begin_page(const char *path, const form *f)
{
    TIFF *tif = TIFFOpen(path, "w");
    assert_non_null(tif);
    TIFFSetField(tif, TIFFTAG_IMAGEWIDTH, COLS);
    TIFFSetField(tif, TIFFTAG_IMAGELENGTH, ROWS);
    TIFFSetField(tif, TIFFTAG_BITSPERSAMPLE, f->bits);
    TIFFSetField(tif, TIFFTAG_SAMPLESPERPIXEL, f->samples);
    TIFFSetField(tif, TIFFTAG_PHOTOMETRIC, f->photometric);
    TIFFSetField(tif, TIFFTAG_COMPRESSION, f->compression ? f->compression : COMPRESSION_NONE);
    TIFFSetField(tif, TIFFTAG_PLANARCONFIG, f->planar ? f->planar : PLANARCONFIG_CONTIG);
    if (f->format)
        TIFFSetField(tif, TIFFTAG_SAMPLEFORMAT, f->format);
    if (f->type)
        TIFFSetField(tif, TIFFTAG_SUBFILETYPE, f->type);
    if (f->extra) {
        const uint16_t kind = (uint16_t)(f->extra - 1);
        TIFFSetField(tif, TIFFTAG_EXTRASAMPLES, 1, &kind);
    }
    if (f->unit) {
        TIFFSetField(tif, TIFFTAG_XRESOLUTION, 254.0);
        TIFFSetField(tif, TIFFTAG_YRESOLUTION, 127.0);
        TIFFSetField(tif, TIFFTAG_RESOLUTIONUNIT, f->unit);
    }
    if (f->tiled) {
        TIFFSetField(tif, TIFFTAG_TILEWIDTH, TILE);
        TIFFSetField(tif, TIFFTAG_TILELENGTH, TILE);
    } else {
        TIFFSetField(tif, TIFFTAG_ROWSPERSTRIP, 2);
    }
    return tif;
}

/* `pixels`: the bytes of a row, for every row, of a plane after the other where they stand apart. */
static void write_form(const char *path, const form *f, const void *row)
{
    unsigned char bytes[8 * COLS * MOST_SAMPLES];
    TIFF *tif = begin_page(path, f);
    for (uint32_t i = 0; f->tiled && i < TIFFNumberOfTiles(tif); i++) {
        unsigned char tile[8 * TILE * TILE * MOST_SAMPLES] = {0};
        assert_true(TIFFWriteEncodedTile(tif, i, tile, TIFFTileSize(tif)) > 0);
    }
    for (unsigned plane = 0; !f->tiled && plane < (f->planar == PLANARCONFIG_SEPARATE ? f->samples : 1); plane++)
        for (uint32_t y = 0; y < ROWS; y++) {
            memcpy(bytes, row, (size_t)TIFFScanlineSize(tif)); /* libtiff may turn bytes round in place */
            assert_int_equal(TIFFWriteScanline(tif, bytes, y, (uint16_t)plane), 1);
        }
    TIFFClose(tif);
}

static hada_status load(hada_image *image, hada_error *err)
{
    return hada_tiff_load(io_path("form.tif"), 0, image, err);
}

TEST(numbers_of_every_kind_are_read)
{
    static const int8_t signed8[COLS] = {-127, -1, 0, 1, 64, 127};
    static const int32_t signed32[COLS] = {-INT32_MAX, -1, 0, 1, 1 << 30, INT32_MAX};
    static const unsigned char twelve[] = {0x00, 0x0f, 0xff, 0x80, 0x01, 0x23, 0xab, 0xcd, 0xef};
    static const unsigned char four[] = {0x0f, 0x8a, 0x31}, one[] = {0xa8};
    static const struct {
        form form;
        const void *row;
        double factor, expected[COLS]; /* of the file's numbers */
    } cases[] = {
        {{.bits = 8, .samples = 1, .format = SAMPLEFORMAT_INT, .photometric = 1},
         signed8,
         127,
         {-127, -1, 0, 1, 64, 127}},
        {{.bits = 32, .samples = 1, .format = SAMPLEFORMAT_INT, .photometric = 1},
         signed32,
         2147483647.0,
         {-2147483647.0, -1, 0, 1, 1073741824.0, 2147483647.0}},
        {{.bits = 12, .samples = 1, .photometric = 1}, twelve, 4095, {0x000, 0xfff, 0x800, 0x123, 0xabc, 0xdef}},
        {{.bits = 4, .samples = 1, .photometric = 1}, four, 15, {0, 15, 8, 10, 3, 1}},
        {{.bits = 1, .samples = 1, .photometric = 1}, one, 1, {1, 0, 1, 0, 1, 0}},
        /* white is zero; of signed numbers there is no such thing */
        {{.bits = 1, .samples = 1, .photometric = 0}, one, 1, {0, 1, 0, 1, 0, 1}},
        {{.bits = 8, .samples = 1, .format = SAMPLEFORMAT_INT, .photometric = 0},
         signed8,
         127,
         {-127, -1, 0, 1, 64, 127}},
        {{.bits = 4, .samples = 1, .photometric = 1, .compression = COMPRESSION_PACKBITS},
         four,
         15,
         {0, 15, 8, 10, 3, 1}},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        hada_error err = {0};
        SCOPED(hada_image) image;
        write_form(io_path("form.tif"), &cases[k].form, cases[k].row);
        if (load(&image, &err))
            fail_msg("case %zu: %s", k, err.message);
        for (int i = 0; i < AREA; i++)
            if (fabs((double)image.data[i] - cases[k].expected[i % COLS] / cases[k].factor) > 1e-7)
                fail_msg("case %zu, pixel %d: %g", k, i, (double)image.data[i]);
    }
}

/* Of grey and colours with alpha the alpha goes; further samples of grey are channels. */
TEST(alpha_goes_and_channels_stay)
{
    static const unsigned char row[COLS * MOST_SAMPLES] = {10, 20, 30, 40};
    static const struct {
        form form;
        int channels;
    } cases[] = {
        {{.bits = 8, .samples = 2, .photometric = 1, .extra = 1 + EXTRASAMPLE_ASSOCALPHA}, 1},
        {{.bits = 8, .samples = 2, .photometric = 1, .extra = 1 + EXTRASAMPLE_UNASSALPHA}, 1},
        {{.bits = 8, .samples = 2, .photometric = 1, .extra = 1 + EXTRASAMPLE_UNSPECIFIED}, 2},
        {{.bits = 8, .samples = 4, .photometric = 2, .extra = 1 + EXTRASAMPLE_ASSOCALPHA}, 3},
        {{.bits = 8, .samples = 4, .photometric = 2, .extra = 1 + EXTRASAMPLE_ASSOCALPHA, .planar = 2}, 3},
        {{.bits = 8, .samples = 2, .photometric = 1, .extra = 1 + EXTRASAMPLE_ASSOCALPHA, .planar = 2}, 1},
        {{.bits = 8, .samples = 3, .photometric = 2, .tiled = 1, .planar = 2}, 3},
        {{.bits = 8, .samples = 1, .photometric = 1, .tiled = 1}, 1},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        hada_error err = {0};
        SCOPED(hada_image) image;
        write_form(io_path("form.tif"), &cases[k].form, row);
        if (load(&image, &err))
            fail_msg("case %zu: %s", k, err.message);
        assert_int_equal(image.channels, cases[k].channels);
        for (int c = 0; c < image.channels; c++) {
            const int first = cases[k].form.tiled ? 0 : cases[k].form.planar == 2 ? 10 : 10 * (c + 1);
            assert_float_equal(image.data[c * AREA], first / 255.0, 1e-7);
        }
    }
}

TEST(jpegs_of_cameras_are_read)
{
    unsigned char pixels[3 * COLS];
    const form colours = {.bits = 8, .samples = 3, .photometric = PHOTOMETRIC_YCBCR, .compression = COMPRESSION_JPEG};
    hada_error err = {0};
    SCOPED(hada_image) image;
    if (!TIFFIsCODECConfigured(COMPRESSION_JPEG))
        skip();
    TIFF *tif = begin_page(io_path("form.tif"), &colours);
    TIFFSetField(tif, TIFFTAG_ROWSPERSTRIP, 16);
    TIFFSetField(tif, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    memset(pixels, 100, sizeof pixels);
    for (uint32_t y = 0; y < ROWS; y++)
        assert_int_equal(TIFFWriteScanline(tif, pixels, y, 0), 1);
    TIFFClose(tif);
    if (load(&image, &err))
        fail_msg("%s", err.message);
    assert_int_equal(image.channels, 3);
    assert_float_equal(image.data[2 * AREA + 7], 100 / 255.0, 0.02);
}

static void set_tag(unsigned tag, uint16_t type, uint32_t value)
{
    size_t bytes;
    SCOPED_MEMORY unsigned char *data = io_read_bytes(io_path("form.tif"), &bytes);
    io_set_tag(data, bytes, tag, type, value);
    io_write_bytes(io_path("form.tif"), data, bytes);
}

static void expect(hada_status status, const char *word, const char *what)
{
    hada_error err = {0};
    hada_image image;
    const hada_status got = load(&image, &err);
    if (got != status || !strstr(err.message, word))
        fail_msg("%s: status %d, \"%s\"; expected %d with \"%s\"", what, got, err.message, status, word);
}

/* A plain page, of which one tag says something else. */
static void expect_tag(unsigned tag, uint32_t value, hada_status status, const char *word)
{
    static const unsigned char row[8 * COLS * MOST_SAMPLES];
    static const form plain = {.bits = 8, .samples = 1, .format = SAMPLEFORMAT_UINT, .photometric = 1};
    char what[40];
    write_form(io_path("form.tif"), &plain, row);
    set_tag(tag, tag == TIFFTAG_IMAGELENGTH || tag == TIFFTAG_IMAGEWIDTH ? TIFF_LONG : TIFF_SHORT, value);
    snprintf(what, sizeof what, "tag %u = %u", tag, value);
    expect(status, word, what);
}

TEST(what_is_not_offered_is_named)
{
    static const struct {
        unsigned tag, value;
        const char *word;
    } cases[] = {
        {TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_SEPARATED, "CMYK"},
        {TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_CIELAB, "L*a*b*"},
        {TIFFTAG_PHOTOMETRIC, ICCLAB, "L*a*b*"},
        {TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_LOGL, "LogLuv"},
        {TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_LOGLUV, "LogLuv"},
        {TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_CFA, "mosaic"},
        {TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MASK, "tag 262"},
        {TIFFTAG_BITSPERSAMPLE, 64, "64 bits (unsigned)"},
        {TIFFTAG_BITSPERSAMPLE, 24, "24 bits (unsigned)"},
        {TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP, "8 bits (float)"},
        {TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_COMPLEXINT, "complex"},
        {TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_COMPLEXIEEEFP, "complex"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        expect_tag(cases[i].tag, cases[i].value, HADA_ERROR_FILE_FORMAT, cases[i].word);
    expect_tag(TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_RGB, HADA_ERROR_FILE_FORMAT, "RGB image with 1 samples");
    expect_tag(TIFFTAG_IMAGEWIDTH, 1 << 25, HADA_ERROR_FILE_FORMAT, "not plausible");
    /* signed numbers of odd length; colours that only JPEG brings */
    static const unsigned char row[8 * COLS * MOST_SAMPLES];
    const form odd = {.bits = 12, .samples = 1, .format = SAMPLEFORMAT_INT, .photometric = 1};
    write_form(io_path("form.tif"), &odd, row);
    expect(HADA_ERROR_FILE_FORMAT, "12 bits (signed)", "odd");
    const form colours = {.bits = 8, .samples = 3, .photometric = PHOTOMETRIC_RGB};
    write_form(io_path("form.tif"), &colours, row);
    set_tag(TIFFTAG_PHOTOMETRIC, TIFF_SHORT, PHOTOMETRIC_YCBCR);
    expect(HADA_ERROR_FILE_FORMAT, "YCbCr without JPEG", "YCbCr");
}

/* Whatever this libtiff has: a codec that it lacks is refused by its name, and JBIG, whose library ends the process. */
TEST(codecs_are_named)
{
    static const struct {
        uint16_t code;
        const char *name;
    } codecs[] = {{2, "CCITT RLE"},   {5, "LZW"},           {7, "JPEG"},
                  {8, "deflate"},     {33003, "JPEG 2000"}, {33005, "JPEG 2000"},
                  {34661, "JBIG"},    {34712, "JPEG 2000"}, {34887, "LERC"},
                  {34892, "JPEG"},    {34925, "LZMA"},      {34926, "Zstandard"},
                  {34927, "WebP"},    {34934, "JPEG XR"},   {22610, "JPEG XR"},
                  {50002, "JPEG XL"}, {52546, "JPEG XL"},   {12345, "unknown (12345)"}};
    for (size_t i = 0; i < sizeof codecs / sizeof *codecs; i++)
        if (codecs[i].code == 34661 || !TIFFIsCODECConfigured(codecs[i].code))
            expect_tag(TIFFTAG_COMPRESSION, codecs[i].code, HADA_ERROR_FILE_FORMAT, codecs[i].name);
}

TEST(resolutions_have_units)
{
    static const unsigned char row[COLS];
    static const double expected[] = {0, 100.0, 10000.0 / 254.0}; /* none, inch, centimetre: micrometres a pixel */
    for (unsigned unit = RESUNIT_NONE; unit <= RESUNIT_CENTIMETER; unit++) {
        const form f = {.bits = 8, .samples = 1, .photometric = 1, .unit = unit};
        hada_tiff_reader *reader;
        write_form(io_path("form.tif"), &f, row);
        assert_int_equal(hada_tiff_open(&reader, io_path("form.tif"), NULL), HADA_OK);
        const hada_tiff_info *info = hada_tiff_get_info(reader);
        assert_float_equal(info->pixel_width_um, expected[unit - 1], 1e-3);
        assert_float_equal(info->pixel_height_um, 2 * expected[unit - 1], 1e-3);
        assert_true(hada_tiff_get_info(reader)->encoding == 0.0);
        hada_tiff_close(&reader);
    }
}

/* Masks and thumbnails, in words of either age, are no frames. */
TEST(only_frames_count)
{
    static const unsigned char row[COLS];
    for (unsigned type = 1; type <= 4; type *= 2) {
        const form f = {.bits = 8, .samples = 1, .photometric = 1, .type = type};
        write_form(io_path("form.tif"), &f, row);
        if (type == FILETYPE_PAGE) {
            hada_image image;
            assert_int_equal(load(&image, NULL), HADA_OK);
            hada_image_destroy(&image);
            continue;
        }
        expect(HADA_ERROR_FILE_READ, "holds no image", "a mask");
    }
}

/* ImageJ's one directory for many images: pixels that are not there, or strips that do not follow each other. */
TEST(one_directory_for_many_images)
{
    static const unsigned char row[COLS];
    const form plain = {.bits = 8, .samples = 1, .photometric = 1};
    hada_image image;
    TIFF *tif = begin_page(io_path("form.tif"), &plain);
    TIFFSetField(tif, TIFFTAG_IMAGEDESCRIPTION, "ImageJ=1.53\nimages=3\nslices=3\n");
    unsigned char copy[COLS];
    for (uint32_t y = 0; y < ROWS; y++) {
        memcpy(copy, row, sizeof row);
        TIFFWriteScanline(tif, copy, y, 0);
    }
    TIFFClose(tif);
    size_t count;
    SCOPED_MEMORY unsigned char *data = io_read_bytes(io_path("form.tif"), &count);
    const size_t claimed = count;
    SCOPED_MEMORY unsigned char *longer = calloc(1, claimed + 1000);
    memcpy(longer, data, claimed);
    for (size_t i = 0; i < AREA; i++)
        longer[claimed + i] = 255;
    /* the file goes on behind the first image: enough for two further ones */
    io_write_bytes(io_path("form.tif"), longer, claimed + 1000);
    hada_tiff_reader *reader;
    ASSERT_OK(hada_tiff_open(&reader, io_path("form.tif"), err));
    assert_int_equal(hada_tiff_get_info(reader)->frames, 3);
    ASSERT_OK(hada_tiff_read(reader, 2, &image, err));
    hada_image_destroy(&image);
    /* cut while it is open */
    assert_int_equal(truncate(io_path("form.tif"), 60), 0);
    ASSERT_FAILS(hada_tiff_read(reader, 2, &image, err), HADA_ERROR_FILE_READ, "cut off");
    hada_tiff_close(&reader);
}

FIXTURE(io_setup, io_teardown)
