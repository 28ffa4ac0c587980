/* Files that are decoded by a process of their own: the same results, and no more than that. */
#include <dirent.h>
#include <hadalens/headerless.h>
#include <sys/wait.h>
#include <time.h>

#include "io/tiff_page.h"
#include "io_testing.h"

#ifdef HADALENS_SANITIZED
#define SKIP_SANITIZED() skip() /* sanitizers need more memory, and open files */
#else
#define SKIP_SANITIZED() (void)0
#endif

static void isolate(hada_isolate how, const char *program)
{
    DEFAULTS(hada_limits, limits);
    limits.isolate = how;
    limits.seconds = 2;
    setenv("HADALENS_READER", program, 1);
    assert_int_equal(hada_limits_set(&limits, NULL), HADA_OK);
}

static void as_ever(void)
{
    unsetenv("HADALENS_READER");
    assert_int_equal(hada_limits_set(NULL, NULL), HADA_OK);
}

static hada_status open_file(hada_tiff_reader **reader, const char *path, int isolated, hada_error *err)
{
    isolate(isolated ? HADA_ISOLATE_ALL : HADA_ISOLATE_NONE, READER);
    *err = (hada_error){0};
    return hada_tiff_open(reader, path, err);
}

static void assert_same_info(const hada_tiff_info *one, const hada_tiff_info *two)
{
    hada_tiff_info a = *one, b = *two;
    assert_string_equal(a.description, b.description);
    assert_int_equal(a.distances, b.distances);
    if (a.distances)
        assert_memory_equal(a.distances_mm, b.distances_mm, (size_t)a.distances * sizeof(double));
    a.description = b.description = NULL;
    a.distances_mm = b.distances_mm = NULL;
    assert_memory_equal(&a.frames, &b.frames, offsetof(hada_tiff_info, scale) - offsetof(hada_tiff_info, frames));
    assert_true(a.scale == b.scale && a.slices == b.slices && a.times == b.times && a.encoding == b.encoding &&
                a.mosaic == b.mosaic && a.pixel_width_um == b.pixel_width_um && a.slice_spacing == b.slice_spacing &&
                a.pixel_height_um == b.pixel_height_um);
}

static int samples(const hada_pixels *pixels)
{
    return pixels->channels * pixels->rows * pixels->cols * (int)pixels->col_stride;
}

static void assert_same_frames(hada_tiff_reader *here, hada_tiff_reader *there)
{
    hada_error first = {0}, second = {0};
    for (int i = 0; i < hada_tiff_get_info(here)->frames; i++) {
        hada_pixels one, two;
        SCOPED(hada_image) image = {0}, other = {0};
        assert_int_equal(hada_tiff_read_stored(here, i, HADA_AUTO, &one, &first),
                         hada_tiff_read_stored(there, i, HADA_AUTO, &two, &second));
        assert_string_equal(first.message, second.message);
        if (*first.message)
            return;
        assert_int_equal(one.type, two.type);
        assert_int_equal(samples(&one), samples(&two));
        assert_true(one.full_scale == two.full_scale);
        assert_memory_equal(one.data, two.data, (size_t)samples(&one));
        free((void *)one.data);
        free((void *)two.data);
        assert_int_equal(hada_tiff_read(here, i, &image, &first), HADA_OK);
        assert_int_equal(hada_tiff_read(there, i, &other, &second), HADA_OK);
        assert_memory_equal(image.data, other.data, hada_image_count(&image) * sizeof(float));
    }
}

static void assert_same(const char *path)
{
    hada_tiff_reader *here, *there;
    hada_error first, second;
    const hada_status status = open_file(&here, path, 0, &first);
    assert_int_equal(open_file(&there, path, 1, &second), status);
    assert_string_equal(first.message, second.message);
    if (status)
        return;
    assert_same_info(hada_tiff_get_info(here), hada_tiff_get_info(there));
    assert_same_frames(here, there);
    hada_tiff_close(&here);
    hada_tiff_close(&there);
}

/* All pictures that tests have, whole and cut off; texts and errors too. */
TEST(isolated_files_give_the_same)
{
    SKIP_SANITIZED();
    int count = 0;
    DIR *folder = opendir(io_golden(""));
    for (const struct dirent *entry; (entry = readdir(folder));) {
        const char *end = strrchr(entry->d_name, '.');
        if (!end || !strstr(".tif.png.jpg.npy.mat.dng", end) || strlen(end) != 4)
            continue;
        assert_same(io_golden(entry->d_name));
        size_t bytes;
        SCOPED_MEMORY unsigned char *data = io_read_bytes(io_golden(entry->d_name), &bytes);
        io_write_bytes(io_path("cut"), data, bytes * 2 / 3);
        assert_same(io_path("cut"));
        count++;
    }
    closedir(folder);
    as_ever();
    assert_true(count > 40);
}

static void assert_refused(const char *word, hada_isolate how, const char *says)
{
    char text[200] = {0};
    hada_tiff_reader *reader;
    hada_error err = {0};
    snprintf(text, sizeof text, "%s\n", word);
    memcpy(text + 124, "\0\2IM", 4);
    io_write_bytes(io_path("bad"), text, sizeof text);
    isolate(how, MISBEHAVING);
    const hada_status status = hada_tiff_open(&reader, io_path("bad"), &err);
    as_ever();
    if ((status != HADA_ERROR_FILE_READ && status != HADA_ERROR_FILE_FORMAT) || !strstr(err.message, says) ||
        !strstr(err.message, "/bad: "))
        fail_msg("%s: %d, %s", word, (int)status, err.message);
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1); /* nothing is left */
}

/* Files, connections, processes, programs, signals, new code: EACCES (exit code 13 of the program for this test). */
TEST(isolated_processes_have_no_rights)
{
    static const char *const words[] = {"open", "write", "socket", "fork", "exec", "signal", "code"};
    SKIP_SANITIZED();
    for (size_t i = 0; i < HADA_COUNT(words); i++)
        assert_refused(words[i], HADA_ISOLATE_ALL, "exit code 13");
    assert_false(io_exists("/tmp/hadalens-misbehaves"));
}

TEST(isolated_processes_are_bounded)
{
    SKIP_SANITIZED();
    const time_t begun = time(NULL);
    assert_refused("memory", HADA_ISOLATE_ALL, "signal 6");
    assert_refused("forever", HADA_ISOLATE_ALL, "options.limits seconds=N");
    assert_refused("crash", HADA_ISOLATE_ALL, "signal 11");
    assert_true(time(NULL) - begun < 20);
}

/* By default only files whose library is not to be trusted, and where it is possible. */
TEST(isolation_by_default)
{
    SKIP_SANITIZED();
    hada_error err = {0};
    SCOPED(hada_image) image = {0};
    assert_refused("MATLAB 7.3 crash", HADA_ISOLATE_SOME, "signal 11");
    isolate(HADA_ISOLATE_SOME, "/nowhere/hadalens-reader");
    assert_int_equal(hada_tiff_load(io_golden("grey_u1.tif"), 0, &image, &err), HADA_OK);
    hada_image_destroy(&image);
    isolate(HADA_ISOLATE_ALL, "/nowhere/hadalens-reader");
    assert_int_equal(hada_tiff_load(io_golden("grey_u1.tif"), 0, &image, &err), HADA_ERROR_UNSUPPORTED);
    assert_non_null(strstr(err.message, "HADALENS_READER"));
    as_ever();
}

/* Each open file has its own process: one that is closed, or has ended, does not touch the others. */
TEST(isolated_files_side_by_side)
{
    enum { FILES = 12 };
    SKIP_SANITIZED();
    hada_tiff_reader *readers[FILES];
    hada_error err = {0};
    for (int i = 0; i < FILES; i++)
        assert_int_equal(open_file(&readers[i], io_golden("imagej.tif"), 1, &err), HADA_OK);
    for (int i = 0; i < FILES; i += 2)
        hada_tiff_close(&readers[i]);
    for (int i = 1; i < FILES; i += 2) {
        SCOPED(hada_image) image = {0};
        assert_int_equal(hada_tiff_read(readers[i], 99999, &image, &err), HADA_ERROR_ARGUMENT);
        assert_int_equal(hada_tiff_read(readers[i], 1, &image, &err), HADA_OK);
        hada_tiff_close(&readers[i]);
    }
    as_ever();
}

/* Numbers alone are read as ever: the process does not know how they lie. */
TEST(frames_without_a_header_are_not_isolated)
{
    SKIP_SANITIZED();
    static const unsigned char numbers[6] = {0, 51, 102, 153, 204, 255};
    SCOPED(hada_image) image = {0};
    hada_error err = {0};
    io_write_bytes(io_path("frame.raw"), numbers, sizeof numbers);
    assert_int_equal(hada_headerless_set("2x3:u8", &err), HADA_OK);
    isolate(HADA_ISOLATE_ALL, READER);
    assert_int_equal(hada_tiff_load(io_path("frame.raw"), 0, &image, &err), HADA_OK);
    assert_float_equal(image.data[4], 0.8f, 1e-6f);
    assert_int_equal(hada_headerless_set(NULL, &err), HADA_OK);
    as_ever();
}

FIXTURE(io_setup, io_teardown)
