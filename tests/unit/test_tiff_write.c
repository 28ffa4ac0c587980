/* Writing: what comes back, metadata, and that a failure leaves nothing. */
#include <signal.h>
#include <sys/resource.h>

#include "io_testing.h"

static void fill(hada_image *image, int channels, int rows, int cols, uint64_t seed)
{
    assert_int_equal(hada_image_create(image, channels, rows, cols, NULL), HADA_OK);
    for (size_t i = 0, n = hada_image_count(image); i < n; i++)
        image->data[i] = (float)io_random(&seed) / 2147483648.0f;
}

/* What `value` becomes in a file of that many bits and back. */
static float stored(float value, int bits, double scale)
{
    if (bits == 32)
        return value;
    double full = bits == 8 ? 255 : 65535, number = (double)value / scale * full;
    number = number > 0 ? (number < full ? floor(number + 0.5) : full) : 0;
    return (float)number / (float)full;
}

static void round_trip(int bits, hada_tiff_layout layout, int channels, int slices, int compress, double scale)
{
    /* Many rows, so that there are several strips with a shorter last one. */
    const int rows = channels == 1 ? 1201 : 23, cols = channels == 1 ? 517 : 31;
    const double distances[] = {100, 137.5, 600.25};
    DEFAULTS(hada_tiff_write_options, options);
    options.bits = bits;
    options.layout = layout;
    options.slices = slices;
    options.distances_mm = distances;
    options.encoding = 2.2;
    options.compress = compress;
    options.scale = scale;
    options.pixel_um = 2;
    options.description = "model=some camera\n";
    hada_error err = {0};
    hada_tiff_writer *writer;
    assert_int_equal(hada_tiff_create(&writer, io_path("trip.tif"), channels, rows, cols, &options, &err), HADA_OK);
    hada_image image[3] = {{0}};
    for (int i = 0; i < slices; i++) {
        fill(&image[i], channels, rows, cols, (uint64_t)i + 5);
        image[i].data[0] = -1;
        image[i].data[1] = 3;
        image[i].data[2] = NAN;
        assert_int_equal(hada_tiff_write(writer, &image[i], &err), HADA_OK);
    }
    assert_int_equal(hada_tiff_finish(&writer, &err), HADA_OK);
    assert_null(writer);
    hada_tiff_reader *reader;
    assert_int_equal(hada_tiff_open(&reader, io_path("trip.tif"), &err), HADA_OK);
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    assert_int_equal(info->frames, slices);
    assert_int_equal(info->channels, channels);
    assert_int_equal(info->bits, bits);
    assert_float_equal(info->pixel_width_um, 2, 1e-5);
    double found[3] = {0};
    assert_int_equal(hada_tiff_get_info(reader)->distances, slices);
    memcpy(found, hada_tiff_get_info(reader)->distances_mm, (size_t)slices * sizeof *found);
    assert_true(hada_tiff_get_info(reader)->encoding == 2.2);
    assert_memory_equal(found, distances, (size_t)slices * sizeof(double));
    assert_non_null(strstr(hada_tiff_get_info(reader)->description, "model=some camera\n"));
    if (bits < 32)
        assert_non_null(
            strstr(hada_tiff_get_info(reader)->description, bits == 8 ? "full_scale=255\n" : "full_scale=65535\n"));
    if (layout == HADA_TIFF_HYPERSTACK)
        assert_int_equal(info->slices, slices);
    for (int i = 0; i < slices; i++) {
        SCOPED(hada_image) back;
        assert_int_equal(hada_tiff_read(reader, i, &back, &err), HADA_OK);
        for (size_t k = 0; k < hada_image_count(&back); k++) {
            float expected = stored(image[i].data[k], bits, scale);
            if (memcmp(&expected, &back.data[k], sizeof expected) && !(isnan(expected) && isnan(back.data[k])))
                fail_msg("%d bits, layout %d, %d channels, frame %d, value %zu: %.9g, expected %.9g", bits, layout,
                         channels, i, k, (double)back.data[k], (double)expected);
        }
        hada_image_destroy(&image[i]);
    }
    hada_tiff_close(&reader);
}

TEST(test_round_trips)
{
    const int bits[] = {8, 16, 32}, channels[] = {1, 2, 3, 5};
    for (int b = 0; b < 3; b++)
        for (int c = 0; c < 4; c++)
            for (int layout = 0; layout < 2; layout++)
                for (int compress = 0; compress < 2; compress++)
                    round_trip(bits[b], (hada_tiff_layout)layout, channels[c], 1 + (b + c) % 3, compress,
                               b == 1 ? 2.5 : 1);
}

TEST(test_stated_range)
{
    SCOPED(hada_image) image;
    fill(&image, 3, 4, 4, 1);
    image.data[5] = -0.25f;
    image.data[20] = 1.5f;
    DEFAULTS(hada_tiff_write_options, options);
    options.layout = HADA_TIFF_HYPERSTACK;
    assert_int_equal(hada_tiff_save(io_path("range.tif"), &image, &options, NULL), HADA_OK);
    hada_tiff_reader *reader;
    assert_int_equal(hada_tiff_open(&reader, io_path("range.tif"), NULL), HADA_OK);
    const char *text = hada_tiff_get_info(reader)->description;
    assert_true(!strncmp(text, "ImageJ=", 7));
    assert_non_null(strstr(text, "images=3\nchannels=3\nslices=1\n"));
    assert_non_null(strstr(text, "mode=composite\n"));
    assert_non_null(strstr(text, "min=-2.500000000e-01\n"));
    assert_non_null(strstr(text, "max= 1.500000000e+00\n"));
    hada_tiff_close(&reader);
}

/* The same calls give the same bytes. */
TEST(test_deterministic)
{
    SCOPED(hada_image) image;
    fill(&image, 3, 9, 8, 3);
    for (int layout = 0; layout < 2; layout++) {
        DEFAULTS(hada_tiff_write_options, options);
        options.layout = (hada_tiff_layout)layout;
        size_t bytes[2];
        unsigned char *data[2];
        for (int i = 0; i < 2; i++) {
            assert_int_equal(hada_tiff_save(io_path("same.tif"), &image, &options, NULL), HADA_OK);
            data[i] = io_read_bytes(io_path("same.tif"), &bytes[i]);
        }
        assert_int_equal(bytes[0], bytes[1]);
        assert_memory_equal(data[0], data[1], bytes[0]);
        HADA_FREE(data[0], data[1]);
    }
}

static long peak_kib(void)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss;
}

/* 400 pages of 256 KiB through one image: memory stays far below the file's 100 MiB, and page 400 costs what page 1
 * costs. */
TEST(test_streaming)
{
    enum { PAGES = 400 };
    long before = peak_kib();
    hada_image image;
    fill(&image, 1, 256, 256, 7);
    hada_tiff_writer *writer;
    assert_int_equal(hada_tiff_create(&writer, io_path("long.tif"), 1, 256, 256, NULL, NULL), HADA_OK);
    for (int i = 0; i < PAGES; i++) {
        image.data[0] = (float)i;
        assert_int_equal(hada_tiff_write(writer, &image, NULL), HADA_OK);
    }
    assert_int_equal(hada_tiff_finish(&writer, NULL), HADA_OK);
    hada_image_destroy(&image);
    hada_tiff_reader *reader;
    assert_int_equal(hada_tiff_open(&reader, io_path("long.tif"), NULL), HADA_OK);
    assert_int_equal(hada_tiff_get_info(reader)->frames, PAGES);
    for (int i = 0; i < PAGES; i++) {
        int page = i * 7 % PAGES;
        assert_int_equal(hada_tiff_read(reader, page, &image, NULL), HADA_OK);
        assert_true(image.data[0] == (float)page);
        hada_image_destroy(&image);
    }
    hada_tiff_close(&reader);
#ifndef HADALENS_SANITIZED /* sanitizers keep freed memory aside */
    long grown = peak_kib() - before;
    if (grown > 50000) /* all pages take 100 MiB; memcheck keeps 20 MB of freed memory aside */
        fail_msg("streaming %d pages took %ld KiB", PAGES, grown);
#else
    (void)before;
#endif
}

TEST(test_mistakes)
{
    SCOPED(hada_image) image, other;
    fill(&image, 1, 4, 4, 1);
    fill(&other, 1, 4, 5, 1);
    DEFAULTS(hada_tiff_write_options, options);
    options.layout = HADA_TIFF_HYPERSTACK;
    options.slices = 2;
    hada_tiff_writer *writer;
    int files = io_count();
    ASSERT_OK(hada_tiff_create(&writer, io_path("bad.tif"), 1, 4, 4, &options, err));
    ASSERT_FAILS(hada_tiff_write(writer, &other, err), HADA_ERROR_SIZE, "4 x 5");
    ASSERT_OK(hada_tiff_write(writer, &image, err));
    ASSERT_FAILS(hada_tiff_finish(&writer, err), HADA_ERROR_STATE, "1 of 2 frames");
    assert_null(writer);
    ASSERT_OK(hada_tiff_create(&writer, io_path("bad.tif"), 1, 4, 4, &options, err));
    hada_tiff_abandon(&writer);
    options.pixel_um = -1.0;
    ASSERT_FAILS(hada_tiff_create(&writer, io_path("bad.tif"), 1, 4, 4, &options, err), HADA_ERROR_ARGUMENT,
                 "pixel_um is -1");
    options.pixel_um = 0.0;
    options.bits = 12;
    ASSERT_FAILS(hada_tiff_create(&writer, io_path("bad.tif"), 1, 4, 4, &options, err), HADA_ERROR_ARGUMENT, "12 bits");
    ASSERT_FAILS(hada_tiff_save(io_path("no/such/folder.tif"), &image, NULL, err), HADA_ERROR_FILE_WRITE,
                 "create its folder");
    ASSERT_FAILS(hada_tiff_save("/dev/full", &image, NULL, err), HADA_ERROR_FILE_WRITE, "not an ordinary file");
    ASSERT_FAILS(hada_tiff_save(io_folder, &image, NULL, err), HADA_ERROR_FILE_WRITE, "");
    assert_int_equal(io_count(), files);
}

/* A disk that fills up, played by a limit on the size of files: an older file stays as it was, nothing else appears. */
TEST(test_full_disk)
{
    struct rlimit old, small;
    SCOPED(hada_image) image;
    fill(&image, 3, 300, 300, 1);
    io_write_bytes(io_path("old.tif"), "old", 3);
    int files = io_count();
    getrlimit(RLIMIT_FSIZE, &old);
    for (int kind = 0; kind < 3; kind++) {
        small = old;
        small.rlim_cur = 300000;
        DEFAULTS(hada_tiff_write_options, options);
        options.layout = kind ? HADA_TIFF_HYPERSTACK : HADA_TIFF_PAGES;
        options.compress = kind == 2;
        hada_error err = {0};
        signal(SIGXFSZ, SIG_IGN);
        setrlimit(RLIMIT_FSIZE, &small);
        hada_status status = hada_tiff_save(io_path("old.tif"), &image, &options, &err);
        setrlimit(RLIMIT_FSIZE, &old);
        assert_int_equal(status, HADA_ERROR_FILE_WRITE);
        if (!strstr(err.message, "File too large") || !strstr(err.message, "old.tif") ||
            !strstr(err.message, "nothing was left"))
            fail_msg("the message does not say what happened: %s", err.message);
        assert_int_equal(io_count(), files);
        size_t bytes;
        SCOPED_MEMORY unsigned char *data = io_read_bytes(io_path("old.tif"), &bytes);
        assert_non_null(data);
        assert_int_equal(bytes, 3);
    }
}

FIXTURE(io_setup, io_teardown)
