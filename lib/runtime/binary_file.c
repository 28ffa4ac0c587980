/* Program binaries on disk: magic, checksum, payload. Whole or not there. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "core/input.h"
#include "core/outfile.h"
#include "core/sync.h"
#include "runtime/store.h"

typedef struct binary_header {
    char magic[8];
    uint64_t bytes, checksum;
} binary_header;

static const char magic[8] = {'H', 'A', 'D', 'A', 'B', 'I', 'N', '1'};

/* Far above any program of any device. */
#define MOST_BYTES ((size_t)1 << 30)

static int join(char *out, size_t size, const char *folder, const char *name)
{
    int n = snprintf(out, size, "%s/%s", folder, name);
    return n > 0 && (size_t)n < size;
}

hada_status hada_folder_make(const char *folder, unsigned mode, hada_error *err)
{
    return hada_folders_make(folder, mode)
               ? hada_fail(err, HADA_ERROR_FILE_WRITE, "the folder %s cannot be made: %s", folder, strerror(errno))
               : HADA_OK;
}

int hada_folder_is_ours(const char *folder)
{
    struct stat what;
    if (stat(folder, &what))
        return errno == ENOENT;
    return (what.st_uid == geteuid() || !what.st_uid) && !(what.st_mode & (S_IWGRP | S_IWOTH));
}

hada_status hada_binary_read(const char *folder, const char *name, unsigned char **out, size_t *bytes, hada_error *err)
{
    char path[4096];
    binary_header header;
    *out = NULL;
    *bytes = 0;
    if (!join(path, sizeof path, folder, name))
        return HADA_OK;
    char *text = NULL;
    size_t length = 0;
    const hada_status status = hada_input_read(&text, &length, path, MOST_BYTES, NULL, err);
    if (status == HADA_ERROR_MEMORY)
        return status;
    if (status)
        return HADA_OK;
    if (length > sizeof header)
        memcpy(&header, text, sizeof header);
    if (length > sizeof header && !memcmp(header.magic, magic, sizeof magic) &&
        header.bytes == length - sizeof header &&
        XXH3_64bits(text + sizeof header, length - sizeof header) == header.checksum) {
        *bytes = length - sizeof header;
        memmove(text, text + sizeof header, *bytes);
        *out = (unsigned char *)text;
        text = NULL;
    }
    free(text);
    return HADA_OK;
}

hada_status hada_binary_write(const char *folder, const char *name, const unsigned char *data, size_t bytes,
                              hada_error *err)
{
    char path[4096];
    hada_outfile file = {.fd = -1};
    binary_header header = {.bytes = bytes, .checksum = XXH3_64bits(data, bytes)};
    memcpy(header.magic, magic, sizeof magic);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_folder_make(folder, HADA_OURS_ALONE, err));
    if (!join(path, sizeof path, folder, name))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "the folder name %.80s... is too long", folder));
    HADA_TRY_OR_DONE(hada_outfile_open(&file, path, err));
    HADA_TRY_OR_DONE(hada_outfile_write(&file, &header, sizeof header, err));
    HADA_TRY_OR_DONE(hada_outfile_write(&file, data, bytes, err));
    return hada_outfile_commit(&file, err);
done:
    hada_outfile_abandon(&file);
    return status;
}

void hada_binary_drop(const char *folder, const char *name)
{
    char path[4096];
    if (join(path, sizeof path, folder, name))
        unlink(path);
}
