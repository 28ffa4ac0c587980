#include "io/outfile.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/alloc.h"

static void release(hada_outfile *out)
{
    if (out->fd >= 0)
        close(out->fd);
    free(out->path);
    free(out->temp);
    *out = (hada_outfile){NULL, NULL, -1};
}

hada_status hada_outfile_open(hada_outfile *out, const char *path, hada_error *err)
{
    static atomic_uint serial;
    *out = (hada_outfile){NULL, NULL, -1};
    if (!path || !*path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the name of the output file is empty; give one");
    struct stat info;
    if (!stat(path, &info)) {
        if (!S_ISREG(info.st_mode))
            return hada_fail(err, HADA_ERROR_FILE_WRITE,
                             "%s exists and is not an ordinary file (a folder or a device?); choose another name",
                             path);
        out->path = realpath(path, NULL);
    }
    if (!out->path)
        out->path = hada_string_copy(path);
    size_t bytes = out->path ? strlen(out->path) + 48 : 0;
    out->temp = bytes ? malloc(bytes) : NULL;
    if (!out->temp) {
        release(out);
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for a file name");
    }
    snprintf(out->temp, bytes, "%s.tmp-%ld-%u", out->path, (long)getpid(), atomic_fetch_add(&serial, 1u));
    out->fd = open(out->temp, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (out->fd < 0) {
        int code = errno;
        release(out);
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s; %s", path, strerror(code),
                         code == ENOENT || code == ENOTDIR ? "create its folder first"
                                                           : "check the folder's permissions, or write elsewhere");
    }
    return HADA_OK;
}

hada_status hada_outfile_write(hada_outfile *out, const void *data, size_t bytes, hada_error *err)
{
    const char *from = data;
    while (bytes) {
        ssize_t done = write(out->fd, from, bytes < ((size_t)1 << 30) ? bytes : (size_t)1 << 30);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return hada_fail(err, HADA_ERROR_FILE_WRITE, "writing %s failed: %s; nothing was left behind", out->path,
                             done < 0 ? strerror(errno) : "the disk takes no more");
        from += done;
        bytes -= (size_t)done;
    }
    return HADA_OK;
}

hada_status hada_outfile_commit(hada_outfile *out, hada_error *err)
{
    /* close() reports what a network file system could not store. */
    int bad = close(out->fd);
    out->fd = -1;
    if (bad || rename(out->temp, out->path)) {
        int code = errno;
        hada_status status =
            hada_fail(err, HADA_ERROR_FILE_WRITE, "%s could not be completed: %s; nothing was left behind", out->path,
                      strerror(code));
        hada_outfile_abandon(out);
        return status;
    }
    release(out);
    return HADA_OK;
}

void hada_outfile_abandon(hada_outfile *out)
{
    if (out->temp)
        unlink(out->temp);
    release(out);
}
