/* The bones of TIFF files: headers and directories of either order and size, the texts of ImageJ and OME, and what is
 * written when files grow large. */
#include <tiffio.h>

#include "core/outfile.h"
#include "io/tiff_meta.h"
#include "io/tiff_page.h"
#include "io/tiff_write.h"
#include "io_testing.h"

enum { ROWS = 5, COLS = 6, AREA = ROWS * COLS };

static hada_status load(hada_image *image, hada_error *err)
{
    return hada_tiff_load(io_path("form.tif"), 0, image, err);
}

static void expect(hada_status status, const char *word)
{
    hada_error err = {0};
    hada_image image;
    const hada_status got = load(&image, &err);
    if (got != status || !strstr(err.message, word))
        fail_msg("status %d, \"%s\"; expected %d with \"%s\"", got, err.message, status, word);
}

/* Headers and directories as bytes: both orders, classic and Big. */
typedef struct bytes {
    unsigned char data[600];
    size_t count;
    int big_endian;
} bytes;

static void put(bytes *b, uint64_t value, int width)
{
    for (int i = 0; i < width; i++)
        b->data[b->count++] = (unsigned char)(value >> 8 * (b->big_endian ? width - 1 - i : i));
}

static void put_head(bytes *b, int big_endian, int big, uint64_t first)
{
    *b = (bytes){.big_endian = big_endian};
    b->data[0] = b->data[1] = big_endian ? 'M' : 'I';
    b->count = 2;
    put(b, big ? 43 : 42, 2);
    if (big) {
        put(b, 8, 2);
        put(b, 0, 2);
    }
    put(b, first, big ? 8 : 4);
}

static void put_entry(bytes *b, int big, unsigned tag, unsigned type, uint64_t value)
{
    const int wide = big ? 8 : 4, width = type == TIFF_SHORT ? 2 : 4;
    put(b, tag, 2);
    put(b, type, 2);
    put(b, 1, wide);
    put(b, value, width);
    put(b, 0, wide - width);
}

/* A page of 2 x 2 pixels 1, 2, 3, 4 that stand behind it. old: Subfiletype by the word of before; link: whether a link
 * to the next directory follows. */
static void put_page(bytes *b, int big, unsigned old, int link)
{
    const unsigned entries = old ? 9 : 8;
    const size_t data = b->count + (big ? 8 + 20 * entries + 8 * (size_t)link : 2 + 12 * entries + 4 * (size_t)link);
    put(b, entries, big ? 8 : 2);
    if (old)
        put_entry(b, big, TIFFTAG_OSUBFILETYPE, TIFF_SHORT, old);
    put_entry(b, big, TIFFTAG_IMAGEWIDTH, TIFF_SHORT, 2);
    put_entry(b, big, TIFFTAG_IMAGELENGTH, TIFF_SHORT, 2);
    put_entry(b, big, TIFFTAG_BITSPERSAMPLE, TIFF_SHORT, 8);
    put_entry(b, big, TIFFTAG_COMPRESSION, TIFF_SHORT, 1);
    put_entry(b, big, TIFFTAG_PHOTOMETRIC, TIFF_SHORT, 1);
    put_entry(b, big, TIFFTAG_STRIPOFFSETS, TIFF_LONG, link ? data : 16);
    put_entry(b, big, TIFFTAG_ROWSPERSTRIP, TIFF_SHORT, 2);
    put_entry(b, big, TIFFTAG_STRIPBYTECOUNTS, TIFF_LONG, 4);
    if (!link)
        return;
    put(b, 0, big ? 8 : 4);
    put(b, b->big_endian ? 0x01020304 : 0x04030201, 4);
}

static void expect_bytes(const bytes *b, hada_status status, const char *word)
{
    io_write_bytes(io_path("form.tif"), b->data, b->count);
    if (status) {
        expect(status, word);
        return;
    }
    SCOPED(hada_image) image;
    hada_error err = {0};
    if (load(&image, &err))
        fail_msg("%s", err.message);
    for (int i = 0; i < 4; i++)
        assert_float_equal(image.data[i], (i + 1) / 255.0, 1e-7);
}

TEST(directories_of_either_order_and_size)
{
    bytes b;
    for (int kind = 0; kind < 4; kind++) {
        const int order = kind & 1, big = kind >> 1, head = big ? 16 : 8;
        for (unsigned old = 0; old <= 3; old++) {
            put_head(&b, order, big, (uint64_t)head);
            put_page(&b, big, old, 1);
            expect_bytes(&b, old == 2 ? HADA_ERROR_FILE_READ : HADA_OK, "holds no image");
        }
        /* some writers leave the last link out where the file ends */
        put_head(&b, order, big, big ? 20 : 20);
        b.count = 16;
        put(&b, order ? 0x01020304 : 0x04030201, 4);
        put_page(&b, big, 0, 0);
        if (!big) /* the offset of the first directory is left as it is in the header */
            expect_bytes(&b, HADA_OK, "");
        /* cut within the count, the entries and the link */
        put_head(&b, order, big, (uint64_t)head);
        b.count++;
        expect_bytes(&b, HADA_ERROR_FILE_READ, "ends before the directory of page 1");
        put_head(&b, order, big, (uint64_t)head);
        put(&b, 20, big ? 8 : 2);
        expect_bytes(&b, HADA_ERROR_FILE_READ, "ends before the directory of page 1");
        put_head(&b, order, big, 1 << 20);
        expect_bytes(&b, HADA_ERROR_FILE_READ, "ends before the directory of page 1");
    }
    put_head(&b, 0, 1, 16);
    put(&b, 70000, 8);
    expect_bytes(&b, HADA_ERROR_FILE_READ, "ends before");
    put_head(&b, 0, 1, 16);
    b.data[4] = 4; /* offsets of four bytes are not Big */
    expect_bytes(&b, HADA_ERROR_FILE_READ, "BigTIFF header");
    b.count = 12;
    expect_bytes(&b, HADA_ERROR_FILE_READ, "BigTIFF header");
    static const char *const none[] = {"II", "IM*\0\0\0\0\0", "KK*\0\0\0\0\0", "II)\0\0\0\0\0"};
    for (int i = 0; i < 4; i++) {
        b.count = i ? 8 : 2;
        memcpy(b.data, none[i], b.count);
        expect_bytes(&b, HADA_ERROR_FILE_FORMAT, "of no known format");
    }
    put_head(&b, 0, 0, 0);
    expect_bytes(&b, HADA_ERROR_FILE_READ, "holds no image");
}

/* What the finder of tags gives, which has no libtiff to check it. */
TEST(tags_are_found_or_not)
{
    bytes b;
    uint64_t length = 0;
    put_head(&b, 0, 0, 8);
    put_page(&b, 0, 0, 1);
    io_write_bytes(io_path("form.tif"), b.data, b.count);
    FILE *file = fopen(io_path("form.tif"), "rb");
    assert_non_null(file);
    hada_tiff_chain chain;
    assert_int_equal(hada_tiff_chain_read(&chain, fileno(file), NULL), HADA_OK);
    const int fd = fileno(file);
    assert_int_equal(hada_tiff_chain_find(&chain, fd, 8, TIFFTAG_IMAGELENGTH, &length), 8 + 2 + 12 + 8);
    assert_int_equal(length, 2);
    assert_int_equal(hada_tiff_chain_find(&chain, fd, 8, TIFFTAG_SOFTWARE, &length), 0);
    assert_int_equal(hada_tiff_chain_find(&chain, fd, b.count, TIFFTAG_IMAGELENGTH, &length), 0);
    hada_tiff_chain_free(&chain);
    fclose(file);
    /* a count beyond the file, a kind that there is not, a place beyond the file */
    const struct {
        size_t at;
        uint32_t value;
        int width;
    } spoilt[] = {{8 + 2 + 12 + 4, 1000000, 4}, {8 + 2 + 12 + 2, 77, 2}, {8 + 2 + 12 + 4, 100, 4}};
    for (int i = 0; i < 3; i++) {
        bytes wrong = b;
        wrong.count = spoilt[i].at;
        put(&wrong, spoilt[i].value, spoilt[i].width);
        if (i == 2)
            put(&wrong, 1 << 20, 4);
        io_write_bytes(io_path("form.tif"), wrong.data, b.count);
        file = fopen(io_path("form.tif"), "rb");
        assert_int_equal(hada_tiff_chain_read(&chain, fileno(file), NULL), HADA_OK);
        assert_int_equal(hada_tiff_chain_find(&chain, fileno(file), 8, TIFFTAG_IMAGELENGTH, &length), 0);
        hada_tiff_chain_free(&chain);
        fclose(file);
    }
}

static hada_tiff_stack parse(const char *text, size_t pages)
{
    hada_tiff_stack stack;
    hada_error err = {0};
    if (hada_tiff_stack_parse(&stack, text, pages, &err))
        fail_msg("%s", err.message);
    return stack;
}

TEST(imagej_gives_the_order_of_pages)
{
    hada_tiff_stack s = parse("ImageJ=1.53\nimages=12\nchannels=2\nframes=3\n", 12); /* the slices can be told */
    assert_true(s.known && s.slices == 2 && s.channels == 2 && s.times == 3);
    assert_true(s.channel_step == 1 && s.slice_step == 2 && s.time_step == 4);
    s = parse("ImageJ=1.53\nimages=5\nchannels=2\nframes=3\n", 5);
    assert_true(!s.known && s.slices == 1);
    s = parse("ImageJ=1.53\nimages=-5\nchannels=0\nslices=1e300\n", 1);
    assert_true(s.known && s.images == 1 && s.channels == 1 && s.slices == 1);
    s = parse("ImageJ=1.53\nimages=4\nslices=4\nunit=micron\nspacing=-2.5\n", 4);
    assert_float_equal(s.spacing_um, 2.5, 1e-9);
    s = parse("ImageJ=1.53\nimages=4\nslices=4\nunit=inch\nzunit=mm\nspacing=2\n", 4);
    assert_true(s.unit_um == 25400 && s.spacing_um == 2000);
    s = parse("ImageJ=1.53\nunit=furlong\nzunit=micrometer\nspacing=2\n", 1);
    assert_true(s.unit_um == 0 && s.spacing_um == 0);
}

#define PIXELS(order, sizes) "<OME><Image><Pixels DimensionOrder=\"" order "\" " sizes ">"
#define SIZES(c, z, t)       "SizeC=\"" c "\" SizeZ='" z "' SizeT=\"" t "\""
#define END                  "</Pixels></Image></OME>"

TEST(ome_gives_the_order_of_pages)
{
    hada_tiff_stack s = parse(PIXELS("XYTZC", SIZES("2", "3", "4")) END, 24);
    assert_true(s.known && s.time_step == 1 && s.slice_step == 4 && s.channel_step == 12 && !s.pages);
    s = parse("<ome:OME><Pixels DimensionOrder=\"XYCZT\" " SIZES("6", "1", "2") "><Channel SamplesPerPixel=\"3\"/>" END,
              4);
    assert_true(s.known && s.channels == 2 && s.times == 2);
    /* what is none, or says nothing that can be used */
    static const char *const useless[] = {
        "<OME>",
        "<OME><Pixels SizeC=\"1\">",
        PIXELS("YXCZT", SIZES("1", "2", "1")) END,
        PIXELS("XYCCT", SIZES("1", "2", "1")) END,
        PIXELS("XYCZ", SIZES("1", "2", "1")) END,
        PIXELS("XYCZT", SIZES("1", "3", "1")) END,
        PIXELS("XYCZT", SIZES("0", "2", "1")) END,
        PIXELS("XYCZT", SIZES("x", "-2", "1")) END,
        "<OME><Pixels DimensionOrder=\"XYCZT",
        "<OME><Pixels DimensionOrder=XYCZT SizeZ=\"2\">",
        /* planes that are placed twice, left out, or have no place */
        PIXELS("XYCZT",
               SIZES("1", "2", "1")) "<TiffData FirstZ=\"0\" IFD=\"0\"/><TiffData FirstZ=\"0\" IFD=\"1\"/>" END,
        PIXELS("XYCZT",
               SIZES("1", "2", "1")) "<TiffData IFD=\"0\" PlaneCount=\"2\"/><TiffData IFD=\"0\" PlaneCount=\"2\"/>" END,
        PIXELS("XYCZT", SIZES("1", "2", "1")) "<TiffData FirstZ=\"1\" IFD=\"0\"/>" END,
        PIXELS("XYCZT", SIZES("1", "2", "1")) "<TiffData FirstZ=\"7\" FirstC=\"9\" IFD=\"0\"/>" END,
        PIXELS("XYCZT", SIZES("1", "2", "1")) "<TiffData IFD=\"2\"/>" END,
    };
    for (size_t i = 0; i < sizeof useless / sizeof *useless; i++) {
        s = parse(useless[i], 2);
        if (s.known || s.pages)
            fail_msg("%s: known %d", useless[i], s.known);
    }
    /* blocks that place planes in another order */
    s = parse(
        PIXELS(
            "XYCZT",
            SIZES(
                "1", "3",
                "1") " PhysicalSizeX=\"2\" PhysicalSizeXUnit=\"nm\" PhysicalSizeY=\"3\"") "<TiffData FirstZ=\"2\" IFD=\"0\"/><TiffData FirstZ=\"0\" IFD=\"1\" PlaneCount=\"2\"/>" END,
        3);
    assert_true(s.known && s.pages && s.pages[0] == 1 && s.pages[1] == 2 && s.pages[2] == 0);
    assert_float_equal(s.width_um, 0.002, 1e-9);
    assert_float_equal(s.height_um, 3, 1e-9);
    hada_tiff_stack_free(&s);
    /* a block of another image does not count */
    s = parse(PIXELS("XYCZT", SIZES("1", "2", "1")) "</Pixels><Pixels><TiffData FirstZ=\"9\"/></Pixels></OME>", 2);
    assert_true(s.known && !s.pages);
}

static void save_pages(const char *text, int pages, int wider)
{
    hada_tiff_writer *writer;
    DEFAULTS(hada_tiff_write_options, options);
    options.description = text;
    assert_int_equal(hada_tiff_create(&writer, io_path("form.tif"), 1, ROWS, COLS, &options, NULL), HADA_OK);
    for (int i = 0; i < pages; i++) {
        SCOPED(hada_image) image;
        assert_int_equal(hada_image_create(&image, 1, ROWS, COLS, NULL), HADA_OK);
        for (int k = 0; k < AREA; k++)
            image.data[k] = (float)(10 * i);
        assert_int_equal(hada_tiff_write(writer, &image, NULL), HADA_OK);
    }
    assert_int_equal(hada_tiff_finish(&writer, NULL), HADA_OK);
    if (wider) { /* the second page gets another size: one pixel less in its width */
        size_t count;
        SCOPED_MEMORY unsigned char *data = io_read_bytes(io_path("form.tif"), &count);
        uint32_t at;
        uint16_t entries, tag;
        const uint32_t width = COLS - 1;
        memcpy(&at, data + 4, 4);
        memcpy(&entries, data + at, 2);
        memcpy(&at, data + at + 2 + 12u * entries, 4);
        memcpy(&entries, data + at, 2);
        for (unsigned i = 0; i < entries; i++) {
            memcpy(&tag, data + at + 2 + 12 * i, 2);
            if (tag == TIFFTAG_IMAGEWIDTH)
                memcpy(data + at + 2 + 12 * i + 8, &width, 4);
        }
        io_write_bytes(io_path("form.tif"), data, count);
    }
}

/* Channels on pages of their own; the text follows our own words, so it is OME's. */
TEST(channels_on_pages_are_one_frame)
{
    hada_tiff_reader *reader;
    hada_image image;
    static const char text[] = PIXELS("XYZCT", SIZES("2", "2", "1")) END;
    save_pages(text, 4, 0);
    ASSERT_OK(hada_tiff_open(&reader, io_path("form.tif"), err));
    assert_int_equal(hada_tiff_get_info(reader)->frames, 2);
    ASSERT_OK(hada_tiff_read(reader, 1, &image, err));
    assert_int_equal(image.channels, 2);
    assert_true(image.data[0] == 10.0f && image.data[AREA] == 30.0f);
    hada_image_destroy(&image);
    for (int wrong = -1; wrong <= 2; wrong += 3) {
        ASSERT_FAILS(hada_tiff_read(reader, wrong, &image, err), HADA_ERROR_ARGUMENT, "the file has 2");
    }
    hada_tiff_close(&reader);
    hada_tiff_close(&reader); /* is nothing then */
    hada_tiff_close(NULL);
    save_pages(PIXELS("XYCZT", SIZES("2", "1", "1")) END, 2, 1);
    ASSERT_FAILS(hada_tiff_load(io_path("form.tif"), 0, &image, err), HADA_ERROR_FILE_FORMAT, "another size");
}

/* Cut while it is open: an error, whatever page is asked for. */
TEST(files_that_shrink_are_errors)
{
    hada_tiff_reader *reader;
    hada_error err = {0};
    hada_image image;
    save_pages("plain", 2, 0);
    assert_int_equal(hada_tiff_open(&reader, io_path("form.tif"), &err), HADA_OK);
    assert_int_equal(truncate(io_path("form.tif"), 60), 0);
    assert_int_equal(hada_tiff_read(reader, 1, &image, &err), HADA_ERROR_FILE_READ);
    hada_tiff_close(&reader);
}

static void expect_write(int channels, const hada_tiff_write_options *options, hada_status status, const char *word)
{
    hada_tiff_writer *writer;
    hada_error err = {0};
    const hada_status got = hada_tiff_create(&writer, io_path("none.tif"), channels, 1, 1, options, &err);
    if (got != status || !strstr(err.message, word))
        fail_msg("status %d, \"%s\"; expected %d with \"%s\"", got, err.message, status, word);
    assert_null(writer);
    assert_false(io_exists(io_path("none.tif")));
}

TEST(what_cannot_be_written_is_refused_first)
{
    static const double scales[] = {0, -1, NAN};
    static const int channels[] = {0, -1, 4097};
    hada_tiff_write_options options;
    for (int i = 0; i < 3; i++) {
        hada_tiff_write_options_init(&options);
        options.scale = scales[i];
        expect_write(1, &options, HADA_ERROR_ARGUMENT, "full scale");
        expect_write(channels[i], NULL, HADA_ERROR_ARGUMENT, "cannot be written");
    }
    hada_tiff_write_options_init(&options);
    options.encoding = 17;
    expect_write(1, &options, HADA_ERROR_ARGUMENT, "encoding of 17");
    hada_tiff_write_options_init(&options);
    options.slices = -1;
    expect_write(1, &options, HADA_ERROR_ARGUMENT, "slices -1");
    options.slices = 1;
    options.times = -3;
    expect_write(1, &options, HADA_ERROR_ARGUMENT, "times -3");
    options.times = 1 << 20;
    options.slices = 1 << 20;
    expect_write(1, &options, HADA_ERROR_ARGUMENT, "slices");
    /* directories that outgrow the four bytes of a place, where the pixels do not */
    hada_tiff_write_options_init(&options);
    options.layout = HADA_TIFF_HYPERSTACK;
    options.bits = 8;
    options.slices = 17000000;
    expect_write(1, &options, HADA_ERROR_SIZE, "too long");
    /* a hyperstack takes what was declared, and no more */
    hada_tiff_writer *writer;
    SCOPED(hada_image) image;
    assert_int_equal(hada_image_create(&image, 1, 1, 1, NULL), HADA_OK);
    image.data[0] = NAN;
    options.slices = 0;
    options.bits = 16;
    options.pixel_um = 1e-9;
    ASSERT_OK(hada_tiff_create(&writer, io_path("one.tif"), 1, 1, 1, &options, err));
    ASSERT_OK(hada_tiff_write(writer, &image, err));
    ASSERT_FAILS(hada_tiff_write(writer, &image, err), HADA_ERROR_STATE, "all are written");
    ASSERT_OK(hada_tiff_finish(&writer, err));
    hada_tiff_abandon(NULL);
    hada_tiff_abandon(&writer);
}

/* Pages that may outgrow 4 GiB begin as BigTIFF. */
TEST(what_may_grow_is_big)
{
    hada_tiff_writer *writer;
    SCOPED(hada_image) image, back;
    DEFAULTS(hada_tiff_write_options, options);
    options.slices = 1 << 30;
    assert_int_equal(hada_image_create(&image, 1, 1, 1, NULL), HADA_OK);
    image.data[0] = 0.25f;
    assert_int_equal(hada_tiff_create(&writer, io_path("form.tif"), 1, 1, 1, &options, NULL), HADA_OK);
    assert_int_equal(hada_tiff_write(writer, &image, NULL), HADA_OK);
    assert_int_equal(hada_tiff_finish(&writer, NULL), HADA_OK);
    size_t count;
    unsigned char *data = io_read_bytes(io_path("form.tif"), &count);
    assert_int_equal(data[2], 43);
    free(data);
    assert_int_equal(load(&back, NULL), HADA_OK);
    assert_true(back.data[0] == 0.25f);
}

/* The layout of a hyperstack beyond 4 GiB, in small: 600 images, more than a block of directories holds. */
TEST(a_big_hyperstack_is_read_by_others)
{
    enum { IMAGES = 600 };
    hada_tiff_text text;
    hada_outfile file;
    hada_error err = {0};
    DEFAULTS(hada_tiff_write_options, options);
    options.layout = HADA_TIFF_HYPERSTACK;
    options.bits = 8;
    options.slices = IMAGES;
    options.times = 1;
    options.pixel_um = 5;
    hada_stack_layout layout = {.big = 1, .rows = ROWS, .cols = COLS, .bits = 8, .images = IMAGES, .pixel_um = 5};
    assert_int_equal(hada_tiff_text_build(&text, 1, ROWS, COLS, &options, NULL, &err), HADA_OK);
    assert_int_equal(hada_stack_layout_place(&layout, &text, &err), HADA_OK);
    assert_int_equal(hada_outfile_open(&file, io_path("form.tif"), &err), HADA_OK);
    assert_int_equal(lseek(file.fd, (off_t)layout.data_at, SEEK_SET), (off_t)layout.data_at);
    for (int i = 0; i < IMAGES; i++) {
        unsigned char pixels[AREA];
        memset(pixels, i % 251, sizeof pixels);
        assert_int_equal(hada_outfile_write(&file, pixels, sizeof pixels, &err), HADA_OK);
    }
    assert_int_equal(hada_stack_layout_write(&layout, &text, &file, &err), HADA_OK);
    assert_int_equal(hada_outfile_commit(&file, &err), HADA_OK);
    hada_tiff_text_free(&text);
    TIFF *tif = TIFFOpen(io_path("form.tif"), "r"); /* libtiff itself walks through every directory */
    assert_non_null(tif);
    assert_int_equal(TIFFNumberOfDirectories(tif), IMAGES);
    for (int i = 0; i < IMAGES; i += 37) {
        unsigned char row[COLS];
        assert_int_equal(TIFFSetDirectory(tif, (tdir_t)i), 1);
        assert_int_equal(TIFFReadScanline(tif, row, 3, 0), 1);
        assert_int_equal(row[2], i % 251);
    }
    TIFFClose(tif);
    hada_tiff_reader *reader;
    assert_int_equal(hada_tiff_open(&reader, io_path("form.tif"), &err), HADA_OK);
    assert_int_equal(hada_tiff_get_info(reader)->slices, IMAGES);
    assert_float_equal(hada_tiff_get_info(reader)->pixel_width_um, 5, 1e-3);
    hada_tiff_close(&reader);
}

FIXTURE(io_setup, io_teardown)
