/* Small files that claim much: each ends within two seconds and 256 MiB, with a message. Larger budgets let them in. */
#include <sys/resource.h>
#include <time.h>

#include "io/safetensors.h"
#include "io/tiff_meta.h"
#include "io/tiff_page.h"
#include "io_testing.h"
#include "model/model.h"

#ifdef HADALENS_SANITIZED
enum { MOST_SECONDS = 20, MOST_KIB = 1 << 30 }; /* shadow memory is not ours */
#else
enum { MOST_SECONDS = 2, MOST_KIB = 256 << 10 };
#endif

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static double started;

static void begin(void)
{
    started = now();
}

static void assert_cheap(const hada_error *err, const char *word)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    if (now() - started > MOST_SECONDS || usage.ru_maxrss > MOST_KIB)
        fail_msg("%.1f s, %ld KiB: %s", now() - started, usage.ru_maxrss, err->message);
    if (word && !strstr(err->message, word))
        fail_msg("no '%s' in '%s'", word, err->message);
}

static unsigned char *put_entry(unsigned char *to, unsigned tag, unsigned type, uint32_t count, uint32_t value)
{
    return io_put(io_put(io_put(io_put(to, tag, 2), type, 2), count, 4), value, 4);
}

/* A little-endian grey picture in one strip, with the bytes of `data` behind its directory. */
static void write_grey(const char *path, uint32_t rows, uint32_t cols, unsigned bits, unsigned compression,
                       const char *text, const void *data, size_t bytes)
{
    const size_t length = text ? strlen(text) + 1 : 0;
    SCOPED_MEMORY unsigned char *file = calloc(1, 400 + bytes + length);
    unsigned char *at = file;
    memcpy(at, "II*\0", 4);
    at = io_put(at + 4, 8, 4);
    at = io_put(at, text ? 10 : 9, 2);
    at = put_entry(at, 256, 4, 1, cols);
    at = put_entry(at, 257, 4, 1, rows);
    at = put_entry(at, 258, 3, 1, bits);
    at = put_entry(at, 259, 3, 1, compression);
    at = put_entry(at, 262, 3, 1, 1);
    if (text)
        at = put_entry(at, 270, 2, (uint32_t)length, (uint32_t)(200 + bytes));
    at = put_entry(at, 273, 4, 1, 200);
    at = put_entry(at, 277, 3, 1, 1);
    at = put_entry(at, 278, 4, 1, rows);
    put_entry(at, 279, 4, 1, (uint32_t)bytes);
    memcpy(file + 200, data, bytes);
    if (text)
        memcpy(file + 200 + bytes, text, length);
    io_write_bytes(path, file, 200 + bytes + length);
}

/* One bit a pixel, compressed: 33 KB for a gigabyte of floats. */
TEST(a_small_file_is_not_a_large_picture)
{
    enum { BYTES = 33000 };
    static unsigned char packed[BYTES];
    hada_image image;
    hada_error err = {0};
    for (size_t i = 0; i < BYTES; i += 2)
        packed[i] = 0x81;                                                      /* PackBits: 128 times the next */
    write_grey(io_path("small.tif"), 16384, 16384, 1, 4, NULL, packed, BYTES); /* CCITT */
    begin();
    assert_int_equal(hada_tiff_load(io_path("small.tif"), 0, &image, &err), HADA_ERROR_FILE_FORMAT);
    assert_cheap(&err, "options.limits pixels=N");
    /* and where it is trusted it is read, as far as it goes */
    DEFAULTS(hada_limits, limits);
    limits.pixels = UINT64_C(1) << 40;
    assert_int_equal(hada_limits_set(&limits, &err), HADA_OK);
    write_grey(io_path("fine.tif"), 1024, 2048, 1, 32773, NULL, packed, BYTES);
    assert_int_equal(hada_tiff_load(io_path("fine.tif"), 0, &image, &err), HADA_OK);
    hada_image_destroy(&image);
    limits.pixels = 10;
    assert_int_equal(hada_limits_set(&limits, &err), HADA_OK);
    assert_int_equal(hada_tiff_load(io_path("fine.tif"), 0, &image, &err), HADA_OK); /* 64 for each byte */
    hada_image_destroy(&image);
    assert_int_equal(hada_limits_set(NULL, &err), HADA_OK);
}

/* Deflate of fixed codes: so many bytes as they are, then zeros. */
static size_t deflate_zeros(unsigned char *to, const unsigned char *bytes, size_t count, size_t zeros)
{
    size_t bit = 16;
    memcpy(to, "\x78\x9c", 2);
    to[2] = 3; /* the last block, of fixed codes */
    bit += 3;
    for (size_t i = 0; i < count + zeros / 258; i++) {
        /* a byte, or 258 times the last one; codes begin with their highest bit */
        const unsigned value = i < count ? bytes[i] : 0, wide = value > 143,
                       code = i >= count ? 0xc5u << 5
                              : wide     ? 0x190u + value - 144
                                         : 0x30u + value;
        for (unsigned k = i >= count ? 13 : 8 + wide; k-- > 0; bit++)
            to[bit / 8] = (unsigned char)(to[bit / 8] | (code >> k & 1u) << bit % 8);
    }
    return bit / 8 + 2; /* the end, code 0, is there */
}

static size_t put_matlab_head(unsigned char *file)
{
    memset(file, ' ', 128);
    memcpy(file, "MATLAB 5.0 MAT-file", 19);
    memcpy(file + 124, "\0\1IM", 4);
    return 128;
}

/* Cells within cells made a library's stack overflow, and an array of 2^25 dimensions took 400 MB from 130 KB. */
TEST(matlab_files_that_nest_or_claim)
{
    enum { DEPTH = 100000, CELL = 48, ZEROS = 128 << 20, ROOM = 1 << 20 };
    hada_tiff_reader *reader;
    hada_error err = {0};
    SCOPED_MEMORY unsigned char *file = calloc(1, 128 + (size_t)DEPTH * CELL), *packed = calloc(1, ROOM);
    unsigned char head[64], *at = file + put_matlab_head(file);
    for (uint32_t i = 0; i < DEPTH; i++) {
        at = io_put(io_put(at, 14, 4), (uint64_t)(DEPTH - i) * CELL - 8, 4);
        at = io_put(io_put(io_put(at, 6, 4), 8, 4), 1, 8);               /* a cell */
        at = io_put(io_put(io_put(io_put(at, 5, 4), 8, 4), 1, 4), 1, 4); /* 1 x 1 */
        at = io_put(io_put(at, 1, 4), 0, 4);                             /* without a name */
    }
    io_write_bytes(io_path("cells.mat"), file, (size_t)(at - file));
    begin();
    assert_int_equal(hada_tiff_open(&reader, io_path("cells.mat"), &err), HADA_ERROR_FILE_FORMAT);
    assert_cheap(&err, "no array of real numbers");
    at = io_put(io_put(head, 14, 4), ZEROS + 64, 4);
    at = io_put(io_put(io_put(at, 6, 4), 8, 4), 6, 8);
    at = io_put(io_put(at, 5, 4), ZEROS, 4);
    const size_t begun = put_matlab_head(packed),
                 bytes = deflate_zeros(packed + begun + 8, head, (size_t)(at - head), ZEROS);
    io_put(io_put(packed + begun, 15, 4), bytes, 4);
    io_write_bytes(io_path("sizes.mat"), packed, begun + 8 + bytes);
    begin();
    assert_int_equal(hada_tiff_open(&reader, io_path("sizes.mat"), &err), HADA_ERROR_FILE_FORMAT);
    assert_cheap(&err, "no array of real numbers");
}

/* Pages of 1000 x 1000 pixels, which all have the same 16 KB of the file as theirs. */
static void write_pages(const char *path, uint32_t pages, const char *text)
{
    enum { SIDE = 1000, ENTRIES = 10, RUN = 128, PACKED = 2 * (SIDE * SIDE / RUN + 1) };
    const size_t length = strlen(text) + 1, directory = 2 + 12 * ENTRIES + 4, first = 8 + PACKED + length + length % 2;
    SCOPED_MEMORY unsigned char *file = calloc(1, first + pages * directory);
    memcpy(file, "II*\0", 4);
    io_put(file + 4, first, 4);
    for (size_t i = 0; i < PACKED; i += 2)
        file[8 + i] = 0x81; /* PackBits: 128 times the next, zero */
    memcpy(file + 8 + PACKED, text, length);
    for (uint32_t i = 0; i < pages; i++) {
        unsigned char *at = io_put(file + first + i * directory, ENTRIES, 2);
        at = put_entry(at, 256, 4, 1, SIDE);
        at = put_entry(at, 257, 4, 1, SIDE);
        at = put_entry(at, 258, 3, 1, 8);
        at = put_entry(at, 259, 3, 1, 32773);
        at = put_entry(at, 262, 3, 1, 1);
        at = put_entry(at, 270, 2, (uint32_t)length, (uint32_t)(8 + PACKED));
        at = put_entry(at, 273, 4, 1, 8);
        at = put_entry(at, 277, 3, 1, 1);
        at = put_entry(at, 278, 4, 1, SIDE);
        at = put_entry(at, 279, 4, 1, PACKED);
        io_put(at, i + 1 < pages ? first + (i + 1) * directory : 0, 4);
    }
    io_write_bytes(path, file, first + pages * directory);
}

/* A frame of 600 channels, each a page: 94 KB for 2.4 GB. */
TEST(channels_on_pages_are_numbers_too)
{
    hada_tiff_reader *reader;
    hada_error err = {0};
    static const char *const texts[] = {
        "ImageJ=1.53\nimages=600\nchannels=600\n",
        "<OME><Pixels DimensionOrder=\"XYCZT\" SizeC=\"600\" SizeZ=\"1\" SizeT=\"1\"><TiffData/></Pixels></OME>"};
    for (size_t i = 0; i < 2; i++) {
        write_pages(io_path("channels.tif"), 600, texts[i]);
        begin();
        assert_int_equal(hada_tiff_open(&reader, io_path("channels.tif"), &err), HADA_ERROR_FILE_FORMAT);
        assert_cheap(&err, "600000000 numbers");
        assert_cheap(&err, "options.limits pixels=N");
    }
}

/* 2,000 pages would be read for minutes, though each is within its limit; one may be read again and again. */
TEST(pages_have_pixels_of_their_own)
{
    enum { PAGES = 2000 };
    hada_tiff_reader *reader;
    hada_image image;
    hada_error error = {0};
    int read = 0;
    hada_status status = HADA_OK;
    write_pages(io_path("shared.tif"), PAGES, "");
    begin();
    ASSERT_OK(hada_tiff_open(&reader, io_path("shared.tif"), err));
    assert_int_equal(hada_tiff_get_info(reader)->frames, PAGES);
    for (; read < PAGES && !status; read += !status) {
        status = hada_tiff_read(reader, read, &image, &error);
        hada_image_destroy(&image);
    }
    assert_int_equal(status, HADA_ERROR_FILE_READ);
    assert_true(read > 4 && read < PAGES / 20);
    assert_cheap(&error, "more pixels than the file has bytes for");
    for (int i = 0; i < 3; i++) {
        ASSERT_OK(hada_tiff_read(reader, 7, &image, err));
        hada_image_destroy(&image);
    }
    /* who wants to hold all of them at once gets an error first */
    ASSERT_FAILS(hada_tiff_check_all(reader, err), HADA_ERROR_FILE_FORMAT, "2000000000 numbers");
    hada_tiff_close(&reader);
    write_pages(io_path("few.tif"), 4, "");
    ASSERT_OK(hada_tiff_open(&reader, io_path("few.tif"), err));
    ASSERT_OK(hada_tiff_check_all(reader, err));
    hada_tiff_close(&reader);
}

/* A list of places that cannot be read comes out of libtiff as zeros: the file's header would be the picture. */
TEST(a_header_is_no_picture)
{
    static unsigned char pixels[64 * 64];
    hada_image image;
    hada_error err = {0};
    size_t bytes;
    write_grey(io_path("places.tif"), 64, 64, 8, 1, NULL, pixels, sizeof pixels);
    unsigned char *file = io_read_bytes(io_path("places.tif"), &bytes);
    io_put(file + 10 + 6 * 12 + 4 - 12, 0, 4); /* the count of tag 273, the sixth */
    io_write_bytes(io_path("places.tif"), file, bytes);
    free(file);
    assert_int_equal(hada_tiff_load(io_path("places.tif"), 0, &image, &err), HADA_ERROR_FILE_READ);
}

/* Not a byte of 40 GB is read, nor memory taken for it. */
TEST(a_long_file_of_nothing_is_no_model)
{
    hada_tensors *tensors;
    hada_error err = {0};
    io_write_bytes(io_path("nothing.model"), "", 0);
    if (truncate(io_path("nothing.model"), (off_t)40 << 30))
        skip(); /* a file system without holes */
    begin();
    assert_int_equal(hada_tensors_open(&tensors, io_path("nothing.model"), &err), HADA_ERROR_FILE_FORMAT);
    assert_cheap(&err, "no header of a plausible length");
}

static void open_text(char *text)
{
    hada_error err = {0};
    hada_tiff_reader *reader;
    const unsigned char pixel = 0;
    write_grey(io_path("text.tif"), 1, 1, 8, 1, text, &pixel, 1);
    begin();
    if (!hada_tiff_open(&reader, io_path("text.tif"), &err))
        hada_tiff_close(&reader);
    assert_cheap(&err, NULL);
    hada_tiff_stack stack;
    begin();
    if (!hada_tiff_stack_parse(&stack, text, 1 << 24, &err))
        hada_tiff_stack_free(&stack);
    assert_cheap(&err, NULL);
    free(text);
}

static char *repeat(const char *head, const char *part, size_t bytes)
{
    char *text = malloc(bytes + strlen(head) + strlen(part) + 1), *at = text + sprintf(text, "%s", head);
    while ((size_t)(at - text) < bytes)
        at += sprintf(at, "%s", part);
    return text;
}

TEST(descriptions_cost_what_they_are_long)
{
    const char *const heads[] = {
        "<OME><Pixels DimensionOrder=\"XYCZT\" SizeC=\"1\" SizeZ=\"16777216\" SizeT=\"1\">",
        "<OME><Pixels DimensionOrder=\"XYCZT\" SizeC=\"1\" SizeZ=\"1\" SizeT=\"1\">",
    };
    const char *const parts[] = {"<TiffData IFD=\"0\" PlaneCount=\"16777216\"/>", "<TiffData ", "<TiffData/>",
                                 "<TiffData FirstZ=\"1000000000\" FirstT=\"1000000000\" IFD=\"0\"/>"};
    for (size_t h = 0; h < 2; h++)
        for (size_t p = 0; p < 4; p++)
            open_text(repeat(heads[h], parts[p], 123000));
    open_text(repeat("ImageJ=1.53\nimages=1000000000\nslices=1000000000\n", "\n", 123000));
    hada_error err = {0};
    hada_tiff_reader *reader;
    char *text = repeat("", "a long description. ", 9 << 20);
    const unsigned char pixel = 0;
    write_grey(io_path("long.tif"), 1, 1, 8, 1, text, &pixel, 1);
    free(text);
    begin();
    assert_int_equal(hada_tiff_open(&reader, io_path("long.tif"), &err), HADA_ERROR_FILE_FORMAT);
    assert_cheap(&err, "options.limits text=N");
}

/* Directories of 65535 entries, each 8 bytes behind the one before. */
TEST(directories_do_not_overlap)
{
    enum { BYTES = 1500000, STEP = 8, COUNT = 190000 / 4 };
    unsigned char *file = calloc(1, BYTES);
    hada_error err = {0};
    hada_tiff_reader *reader;
    memcpy(file, "II*\0", 4);
    io_put(file + 4, 8, 4);
    /* each directory's count, and what it finds as its link, stand in one pattern */
    for (size_t at = 8; at + 4 < BYTES; at += STEP)
        io_put(io_put(file + at, 5000, 2), 0, 2);
    for (uint32_t i = 0; i < COUNT; i++) {
        const size_t link = 8 + (size_t)i * STEP + 2 + 5000 * 12;
        if (link + 4 < BYTES)
            io_put(file + link, 8 + (i + 1) * STEP, 4);
    }
    io_write_bytes(io_path("chain.tif"), file, BYTES);
    begin();
    assert_int_equal(hada_tiff_open(&reader, io_path("chain.tif"), &err), HADA_ERROR_FILE_READ);
    assert_cheap(&err, "overlap");
    /* many pages that are sound but for what is in them */
    const uint32_t pages = BYTES / 6 - 2;
    memset(file, 0, BYTES);
    memcpy(file, "II*\0", 4);
    io_put(file + 4, 8, 4);
    for (uint32_t i = 0; i + 1 < pages; i++)
        io_put(file + 8 + i * 6 + 2, 8 + (i + 1) * 6, 4);
    io_write_bytes(io_path("pages.tif"), file, BYTES);
    free(file);
    begin();
    assert_int_not_equal(hada_tiff_open(&reader, io_path("pages.tif"), &err), HADA_OK);
    assert_cheap(&err, NULL);
    DEFAULTS(hada_limits, limits);
    limits.pages = 1000;
    assert_int_equal(hada_limits_set(&limits, &err), HADA_OK);
    assert_int_equal(hada_tiff_open(&reader, io_path("pages.tif"), &err), HADA_ERROR_FILE_FORMAT);
    assert_cheap(&err, "options.limits pages=N");
    assert_int_equal(hada_limits_set(NULL, &err), HADA_OK);
}

#define NET "{\"format\":\"hadalens-net-1\",\"colours\":%d,\"layers\":[{\"layer\":\"input\",\"channels\":%d}"

TEST(nets_are_no_larger_than_their_files)
{
    hada_net *net;
    hada_error err = {0};
    char text[600];
    /* 600 million weights */
    snprintf(text, sizeof text,
             NET ",{\"layer\":\"conv\",\"name\":\"a\",\"channels\":8192,\"kernel\":3},{\"layer\":\"conv\",\"name\":"
                 "\"b\",\"channels\":8192,\"kernel\":3}]}",
             1, 1);
    begin();
    assert_int_equal(hada_net_create(&net, text, 1, &err), HADA_ERROR_MODEL);
    assert_cheap(&err, "options.limits parameters=N");
    /* products that do not fit into 64 bits */
    snprintf(text, sizeof text,
             NET ",{\"layer\":\"conv\",\"name\":\"a\",\"channels\":65536,\"kernel\":1048576,\"pad\":0}]}", 1, 65536);
    assert_int_equal(hada_net_create(&net, text, 1, &err), HADA_ERROR_MODEL);
    /* the same in a file with hardly any weight */
    snprintf(text, sizeof text,
             NET ",{\\\"layer\\\":\\\"conv\\\",\\\"name\\\":\\\"a\\\",\\\"channels\\\":1024,\\\"kernel\\\":3}]}", 1,
             512);
    char header[900], quoted[700];
    char *to = quoted;
    for (const char *from = text; *from; from++) {
        if (*from == '"' && (from == text || from[-1] != '\\'))
            *to++ = '\\';
        *to++ = *from;
    }
    *to = '\0';
    const int length = snprintf(header + 8, sizeof header - 8,
                                "{\"__metadata__\":{\"net\":\"%s\"},\"x\":{\"dtype\":\"U8\",\"shape\":[0],"
                                "\"data_offsets\":[0,0]}}",
                                quoted);
    io_put((unsigned char *)header, (uint64_t)length, 8);
    io_write_bytes(io_path("net.safetensors"), header, 8 + (size_t)length);
    begin();
    assert_int_equal(hada_net_load(&net, io_path("net.safetensors"), &err), HADA_ERROR_MODEL);
    assert_cheap(&err, "more than");
}

/* Layers times the size at which a net runs, in a model of a few kilobytes. */
TEST(nets_in_models_run_at_no_size_out_of_proportion)
{
    static const double distance = 100.0;
    const hada_model_info info = io_model_info(1, &distance);
    SCOPED(hada_model) * model, *with = NULL;
    SCOPED(hada_net) * net;
    hada_model *back;
    hada_error error = {0};
    ASSERT_OK(hada_model_create(&model, &info, 0, err));
    for (size_t i = 0; i < 2 * hada_model_plane(model); i++)
        model->filter[i] = 1.0f;
    if (model->pairs)
        model->pairs[0] = 1.0;
    ASSERT_OK(hada_net_create_preset(&net, "compact", 1, 1, err));
    ASSERT_OK(hada_model_with_enhance(&with, model, net, 64, 64, err));
    ASSERT_OK(hada_model_save(with, io_path("net.model"), err));
    ASSERT_OK(hada_model_load(&back, io_path("net.model"), err));
    hada_model_destroy(&back);
    hada_model_destroy(&with);
    ASSERT_OK(hada_model_with_enhance(&with, model, net, 2000, 2000, err));
    ASSERT_OK(hada_model_save(with, io_path("net.model"), err));
    begin();
    assert_int_equal(hada_model_load(&back, io_path("net.model"), &error), HADA_ERROR_FILE_FORMAT);
    assert_cheap(&error, "options.limits pixels=");
    DEFAULTS(hada_limits, limits);
    limits.pixels = UINT64_C(1) << 40;
    assert_int_equal(hada_limits_set(&limits, &error), HADA_OK);
    ASSERT_OK(hada_model_load(&back, io_path("net.model"), err));
    hada_model_destroy(&back);
    assert_int_equal(hada_limits_set(NULL, &error), HADA_OK);
}

/* A map and a long list of distances: two files, each sound. */
TEST(long_lists_of_distances_cost_little)
{
    enum { LIST = 1000000, SIDE = 300 };
    SCOPED_MEMORY double *list = malloc(LIST * sizeof *list);
    SCOPED_MEMORY unsigned char *parts = malloc(SIDE * SIDE);
    SCOPED(hada_image) map;
    hada_error error = {0};
    assert_true(list && parts);
    ASSERT_OK(hada_image_create(&map, 1, SIDE, SIDE, err));
    for (int i = 0; i < LIST; i++)
        list[i] = 100.0 + 0.001 * i;
    for (int i = 0; i < SIDE * SIDE; i++)
        map.data[i] = 100.0f + 0.01f * (float)i;
    begin();
    ASSERT_OK(hada_metric_depth_parts(&map, list, LIST, HADA_AUTO, HADA_AUTO, parts, err));
    assert_cheap(&error, NULL);
    assert_true(parts[0] == HADA_DEPTH_JUMP && parts[SIDE * SIDE - 1] == HADA_DEPTH_JUMP);
}

/* Many layers, many parameters each: names are compared once. */
TEST(lists_of_layers_cost_what_they_are_long)
{
    hada_net *net;
    hada_error err = {0};
    SCOPED_MEMORY char *text = malloc(200000);
    char *at = text + sprintf(text, NET, 64, 1);
    for (int i = 0; i < 250; i++)
        at += sprintf(at, ",{\"layer\":\"norm\",\"name\":\"n%d\"}", i);
    sprintf(at, "]}");
    begin();
    assert_int_equal(hada_net_create(&net, text, 1, &err), HADA_OK);
    assert_cheap(&err, NULL);
    hada_net_destroy(&net);
    at = text + sprintf(text, NET, 64, 1);
    for (int i = 0; i < 4095; i++)
        at += sprintf(at, ",{\"layer\":\"norm\",\"name\":\"n%d\"}", i);
    sprintf(at, "]}");
    begin();
    assert_int_equal(hada_net_create(&net, text, 1, &err), HADA_ERROR_MODEL);
    assert_cheap(&err, "tensors of parameters");
}

TEST(limits_are_words_or_numbers)
{
    hada_error error = {0};
    DEFAULTS(hada_limits, limits);
    ASSERT_OK(hada_limits_parse(&limits, "pixels=4G,pages=20k,text=3M,parameters=17", err));
    assert_true(limits.pixels == 4000000000u && limits.pages == 20000 && limits.text == 3000000 &&
                limits.parameters == 17);
    ASSERT_OK(hada_limits_parse(&limits, "isolate=all,seconds=5", err));
    assert_true(limits.isolate == HADA_ISOLATE_ALL && limits.seconds == 5 && limits.pages == 20000);
    limits.isolate = 7;
    ASSERT_FAILS(hada_limits_set(&limits, err), HADA_ERROR_ARGUMENT, "isolate");
    const char *const wrong[] = {"pixels",    "isolate=",  "isolate=1",  "isolate=allx",
                                 "seconds=0", "pixels=",   "pixels=0",   "pixels=-1",
                                 "pixels=4T", "colours=4", "pixels=4,,", "pixels=99999999999999999999",
                                 "pages=1k2"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        if (hada_limits_parse(&limits, wrong[i], &error) != HADA_ERROR_ARGUMENT)
            fail_msg("%s", wrong[i]);
    assert_int_equal(limits.parameters, 17);
    setenv("HADALENS_LIMITS", "pages=5", 1);
    ASSERT_OK(hada_limits_get(&limits, err));
    assert_int_equal(limits.pages, 5);
    setenv("HADALENS_LIMITS", "pages=", 1);
    ASSERT_FAILS(hada_limits_get(&limits, err), HADA_ERROR_ARGUMENT, "HADALENS_LIMITS");
    unsetenv("HADALENS_LIMITS");
}

FIXTURE(io_setup, io_teardown)
