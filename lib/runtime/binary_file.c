/* Program binaries on disk: magic, checksum, payload. Written beside and renamed. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "core/alloc.h"
#include "runtime/store.h"

typedef struct binary_header {
    char magic[8];
    uint64_t bytes, checksum;
} binary_header;

static const char magic[8] = {'H', 'A', 'D', 'A', 'B', 'I', 'N', '1'};

static int join(char *out, size_t size, const char *folder, const char *name, const char *suffix)
{
    int n = snprintf(out, size, "%s/%s%s", folder, name, suffix);
    return n > 0 && (size_t)n < size;
}

hada_status hada_folder_make(const char *folder, hada_error *err)
{
    char path[4096];
    int n = snprintf(path, sizeof path, "%s", folder);
    if (n <= 0 || (size_t)n >= sizeof path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the folder name is empty or too long");
    for (char *p = path + 1;; p++) {
        char end = *p;
        if (end != '/' && end != '\0')
            continue;
        *p = '\0';
        if (mkdir(path, 0777) && errno != EEXIST)
            return hada_fail(err, HADA_ERROR_FILE_WRITE, "the folder %s cannot be made: %s", path, strerror(errno));
        if (!end)
            return HADA_OK;
        *p = end;
    }
}

hada_status hada_binary_read(const char *folder, const char *name, unsigned char **out, size_t *bytes, hada_error *err)
{
    char path[4096];
    binary_header header;
    *out = NULL;
    *bytes = 0;
    if (!join(path, sizeof path, folder, name, ""))
        return HADA_OK;
    FILE *file = fopen(path, "rb");
    if (!file)
        return HADA_OK;
    struct stat info;
    hada_status status = HADA_OK;
    void *data = NULL;
    if (fread(&header, sizeof header, 1, file) == 1 && !memcmp(header.magic, magic, sizeof magic) &&
        !fstat(fileno(file), &info) && (uint64_t)info.st_size == sizeof header + header.bytes && header.bytes) {
        status = hada_alloc(&data, (size_t)header.bytes, 1, "a program binary", err);
        if (!status && (fread(data, 1, (size_t)header.bytes, file) != header.bytes ||
                        XXH3_64bits(data, (size_t)header.bytes) != header.checksum)) {
            free(data);
            data = NULL;
        }
    }
    fclose(file);
    *out = data;
    *bytes = data ? (size_t)header.bytes : 0;
    return status;
}

hada_status hada_binary_write(const char *folder, const char *name, const unsigned char *data, size_t bytes,
                              hada_error *err)
{
    char path[4096], beside[4096], suffix[64];
    hada_status status = hada_folder_make(folder, err);
    if (status)
        return status;
    /* the address tells threads of one process apart */
    snprintf(suffix, sizeof suffix, ".%ld-%p", (long)getpid(), (const void *)&path);
    if (!join(path, sizeof path, folder, name, "") || !join(beside, sizeof beside, folder, name, suffix))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the folder name %.80s... is too long", folder);
    FILE *file = fopen(beside, "wb");
    if (!file)
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s", beside, strerror(errno));
    binary_header header = {.bytes = bytes, .checksum = XXH3_64bits(data, bytes)};
    memcpy(header.magic, magic, sizeof magic);
    int good = fwrite(&header, sizeof header, 1, file) == 1 && fwrite(data, 1, bytes, file) == bytes;
    good = !fclose(file) && good;
    if (!good || rename(beside, path)) {
        unlink(beside);
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s", path, strerror(errno));
    }
    return HADA_OK;
}

void hada_binary_drop(const char *folder, const char *name)
{
    char path[4096];
    if (join(path, sizeof path, folder, name, ""))
        unlink(path);
}
