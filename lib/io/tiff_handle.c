#include "io/tiff_handle.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* More than any single buffer that libtiff needs of its own for a sound file. */
#define LIBTIFF_ALLOCATION ((tmsize_t)1 << 31)

static int keep_error(TIFF *tif, void *user, const char *module, const char *format, va_list arguments)
{
    (void)tif;
    (void)module;
    hada_tiff_handle *handle = user;
    if (!*handle->message)
        vsnprintf(handle->message, sizeof handle->message, format, arguments);
    return 1;
}

static int drop_warning(TIFF *tif, void *user, const char *module, const char *format, va_list arguments)
{
    (void)tif;
    (void)user;
    (void)module;
    (void)format;
    (void)arguments;
    return 1;
}

/* libtiff opens at the first directory that the header names. Naming another one there makes every page as quick to
 * open as the first; libtiff itself walks from the first page on. */
static void redirect(const hada_tiff_handle *handle, unsigned char *data, uint64_t begin, uint64_t end)
{
    uint64_t at = handle->big ? 8 : 4, bytes = handle->big ? 8 : 4;
    const uint16_t one = 1;
    int little = *(const unsigned char *)&one != (handle->swapped != 0);
    for (uint64_t i = 0; i < bytes; i++) {
        uint64_t place = at + i;
        if (place >= begin && place < end)
            data[place - begin] = (unsigned char)(handle->first >> 8 * (little ? i : bytes - 1 - i));
    }
}

static tmsize_t on_read(thandle_t user, void *data, tmsize_t bytes)
{
    hada_tiff_handle *handle = user;
    tmsize_t total = 0;
    while (total < bytes) {
        ssize_t done =
            pread(handle->fd, (char *)data + total, (size_t)(bytes - total), (off_t)handle->position + total);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            break;
        total += done;
    }
    if (handle->first && total > 0)
        redirect(handle, data, handle->position, handle->position + (uint64_t)total);
    handle->position += (uint64_t)total;
    return total;
}

static tmsize_t on_write(thandle_t user, void *data, tmsize_t bytes)
{
    hada_tiff_handle *handle = user;
    tmsize_t total = 0;
    while (total < bytes) {
        ssize_t done =
            pwrite(handle->fd, (char *)data + total, (size_t)(bytes - total), (off_t)handle->position + total);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0) {
            if (!handle->write_code)
                handle->write_code = done < 0 ? errno : ENOSPC;
            break;
        }
        total += done;
    }
    handle->position += (uint64_t)total;
    return total;
}

static toff_t file_size(thandle_t user)
{
    hada_tiff_handle *handle = user;
    struct stat info;
    if (!fstat(handle->fd, &info))
        return (toff_t)info.st_size;
    handle->write_code = errno; /* libtiff would write over the beginning, and not say so */
    return 0;
}

static toff_t on_seek(thandle_t user, toff_t offset, int whence)
{
    hada_tiff_handle *handle = user;
    uint64_t base = whence == SEEK_CUR ? handle->position : whence == SEEK_END ? file_size(user) : 0;
    if (base + offset > INT64_MAX)
        return (toff_t)-1;
    return handle->position = base + offset;
}

static int on_close(thandle_t user)
{
    (void)user;
    return 0;
}

TIFF *hada_tiff_attach(hada_tiff_handle *handle, const char *name, const char *mode)
{
    handle->position = 0;
    handle->message[0] = 0;
    TIFFOpenOptions *options = TIFFOpenOptionsAlloc();
    if (!options) {
        snprintf(handle->message, sizeof handle->message, "out of memory");
        return NULL;
    }
    TIFFOpenOptionsSetErrorHandlerExtR(options, keep_error, handle);
    TIFFOpenOptionsSetWarningHandlerExtR(options, drop_warning, handle);
    TIFFOpenOptionsSetMaxSingleMemAlloc(options, LIBTIFF_ALLOCATION);
    TIFF *tif =
        TIFFClientOpenExt(name, mode, handle, on_read, on_write, on_seek, on_close, file_size, NULL, NULL, options);
    TIFFOpenOptionsFree(options);
    return tif;
}
