/* Shared by the file tests: a folder of their own, golden files, files as bytes. */
#ifndef IO_TESTING_H
#define IO_TESTING_H

#include <dirent.h>
#include <hadalens/model.h>
#include <hadalens/tiff.h>
#include <tiffio.h>

#include "testing.h"

static char io_folder[200];

static inline int io_setup(void **state)
{
    (void)state;
    TIFFSetErrorHandler(NULL); /* what libtiff says about damaged files */
    TIFFSetWarningHandler(NULL);
    const char *folder = getenv("TMPDIR");
    snprintf(io_folder, sizeof io_folder, "%s/hadalens-io-XXXXXX", folder ? folder : P_tmpdir);
    return !mkdtemp(io_folder);
}

/* Removes the folder; fails when a test left an unfinished file behind. */
static inline int io_teardown(void **state)
{
    (void)state;
    int unfinished = 0;
    DIR *folder = opendir(io_folder);
    for (struct dirent *entry; folder && (entry = readdir(folder));) {
        char path[600];
        snprintf(path, sizeof path, "%s/%s", io_folder, entry->d_name);
        unfinished += strstr(entry->d_name, ".hadalens-") != NULL;
        if (entry->d_name[0] != '.')
            unlink(path);
    }
    if (folder)
        closedir(folder);
    rmdir(io_folder);
    return unfinished;
}

/* A path in the folder. */
static inline const char *io_path(const char *name)
{
    return path_below(io_folder, name);
}

/* A new file outside the folder. */
static inline void make_path(char *path)
{
    strcpy(path, "/tmp/hadalens-test-XXXXXX");
    const int file = mkstemp(path);
    assert_true(file >= 0);
    close(file);
}

static inline const char *io_golden(const char *name)
{
    static char path[1024];
    snprintf(path, sizeof path, "%s/tests/golden/%s", HADALENS_SOURCE_DIR, name);
    return path;
}

/* Of a small model. */
static inline hada_model_info io_model_info(int depths, const double *distances_mm)
{
    return (hada_model_info){.depths = depths,
                             .channels = 1,
                             .form = HADA_FORM_COMPLEX,
                             .boundary = HADA_BOUNDARY_CIRCULAR,
                             .raw_rows = 6,
                             .raw_cols = 8,
                             .grid_rows = 6,
                             .grid_cols = 8,
                             .window_rows = 4,
                             .window_cols = 4,
                             .distances_mm = distances_mm};
}

static inline int io_exists(const char *path)
{
    return access(path, F_OK) == 0;
}

/* Number of files in the folder. */
static inline int io_count(void)
{
    int count = 0;
    DIR *folder = opendir(io_folder);
    for (struct dirent *entry; folder && (entry = readdir(folder));)
        count += entry->d_name[0] != '.';
    if (folder)
        closedir(folder);
    return count;
}

static inline unsigned char *io_read_bytes(const char *path, size_t *bytes)
{
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    fseek(file, 0, SEEK_END);
    *bytes = (size_t)ftell(file);
    rewind(file);
    unsigned char *data = malloc(*bytes + 1);
    assert_int_equal(fread(data, 1, *bytes, file), *bytes);
    fclose(file);
    return data;
}

static inline void io_write_bytes(const char *path, const void *data, size_t bytes)
{
    unlink(path); /* quicker than truncating: ext4 would write the new content out at once */
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    if (bytes)
        assert_int_equal(fwrite(data, 1, bytes, file), bytes);
    assert_int_equal(fclose(file), 0);
}

/* Puts a little-endian number into a file's bytes; returns what comes behind it. */
static inline unsigned char *io_put(unsigned char *to, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        *to++ = (unsigned char)(value >> 8 * i);
    return to;
}

/* Sets the inline value of a tag in the first directory of a classic file, in this machine's order. */
static inline void io_set_tag(unsigned char *data, size_t bytes, unsigned tag, uint16_t type, uint32_t value)
{
    uint32_t at;
    uint16_t entries, number;
    memcpy(&at, data + 4, 4);
    memcpy(&entries, data + at, 2);
    for (unsigned i = 0; i < entries && at + 14 + 12 * i <= bytes; i++) {
        unsigned char *entry = data + at + 2 + 12 * i;
        memcpy(&number, entry, 2);
        if (number == tag) {
            memcpy(entry + 2, &type, 2);
            memcpy(entry + 8, &value, 4);
            return;
        }
    }
    fail_msg("tag %u is not in the file", tag);
}

/* A small fixed generator, so that failures repeat. */
static inline uint32_t io_random(uint64_t *state)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(*state >> 33);
}

/* Reading the file fails, with words and its path in the message. */
static inline void expect_refusal(const char *path, hada_status status, const char *word, const char *more)
{
    hada_error err = {0};
    SCOPED(hada_image) image;
    hada_status got = hada_tiff_load(path, 0, &image, &err);
    if (got != status || !strstr(err.message, word) || !strstr(err.message, more) || !strstr(err.message, path))
        fail_msg("%s: status %d, \"%s\"; expected %d with \"%s\" and \"%s\"", path, got, err.message, status, word,
                 more);
}

#endif
