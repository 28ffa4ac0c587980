#include "core/outfile.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/alloc.h"
#include "core/input.h"
#include "core/staged.h"
#include "core/sync.h"

/* Modes of new files (less what the umask takes), of those that replace another, until they are whole, and what these
 * take over: bits that give a program another's rights go where its content changes, as with any write. */
enum { NEW_FILE = 0666, HIDDEN_FILE = 0600, PERMISSIONS = 0777 };

static void release(hada_outfile *out)
{
    if (out->fd >= 0)
        close(out->fd);
    free(out->path);
    hada_staged_forget(&out->temp);
    *out = (hada_outfile){.fd = -1};
}

hada_status hada_outfile_check(const char *path, char **real, struct stat *old, hada_error *err)
{
    *real = NULL;
    if (stat(path, old)) {
        struct stat link;
        return !lstat(path, &link)
                   ? hada_fail(err, HADA_ERROR_FILE_WRITE,
                               "%s is a link that leads to no file (%s); remove it, or choose another name", path,
                               strerror(errno))
                   : HADA_OK;
    }
    if (!S_ISREG(old->st_mode))
        return hada_fail(err, HADA_ERROR_FILE_WRITE,
                         "%s exists and is not an ordinary file (a folder or a device?); choose another name", path);
    if (hada_input_is_in_use(old))
        return hada_fail(err, HADA_ERROR_FILE_WRITE,
                         "%s is read by this command and would be overwritten; choose another output", path);
    *real = realpath(path, NULL);
    return *real ? HADA_OK : hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be replaced: %s", path, strerror(errno));
}

hada_status hada_outfile_open(hada_outfile *out, const char *path, hada_error *err)
{
    hada_status status = HADA_OK;
    *out = (hada_outfile){.fd = -1};
    if (!path || !*path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the name of the output file is empty; give one");
    HADA_TRY_OR_DONE(hada_outfile_check(path, &out->path, &out->old, err));
    out->replaces = out->path != NULL;
    if (!out->path)
        out->path = hada_string_copy(path);
    if (!out->path)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for a file name"));
    HADA_TRY_OR_DONE(hada_staged_make(&out->temp, &out->fd, HADA_STAGED_FILE, out->path,
                                      out->replaces ? HIDDEN_FILE : NEW_FILE, path, err));
done:
    if (status)
        release(out);
    return status;
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

/* Owner first: changing it may clear bits of the mode. Who may not give files away keeps at least the group, or else
 * no right that only a group or a user had been given. */
static int take_over(const hada_outfile *out)
{
    mode_t mode = out->old.st_mode & PERMISSIONS;
    struct stat mine;
    if (!out->replaces)
        return 0;
    if (fstat(out->fd, &mine))
        return -1;
    const int same = mine.st_uid == out->old.st_uid && mine.st_gid == out->old.st_gid;
    if (!same && fchown(out->fd, out->old.st_uid, out->old.st_gid) && mine.st_gid != out->old.st_gid &&
        fchown(out->fd, (uid_t)-1, out->old.st_gid))
        mode &= (mode_t)~S_IRWXG | (mode & S_IRWXO) << 3; /* what others may as well */
    return fchmod(out->fd, mode);
}

static int finish(hada_outfile *out, int alone)
{
    int failed = take_over(out) || (alone && hada_sync(out->fd));
    const int code = errno;
    /* close() reports what a network file system could not store */
    const int unclosed = close(out->fd);
    out->fd = -1;
    if (failed)
        errno = code;
    return failed || unclosed || rename(out->temp, out->path);
}

hada_status hada_outfile_commit(hada_outfile *out, hada_error *err)
{
    hada_status status = HADA_OK;
    const int alone = !hada_staged_holds(out->path);
    if (!finish(out, alone)) {
        if (alone && hada_sync_parent(out->path))
            status =
                hada_fail(err, HADA_ERROR_FILE_WRITE, "%s is written, but its name may not outlast a loss of power: %s",
                          out->path, strerror(errno));
    } else {
        status = hada_fail(err, HADA_ERROR_FILE_WRITE, "%s could not be completed: %s; nothing was left behind",
                           out->path, strerror(errno));
        unlink(out->temp);
    }
    release(out);
    return status;
}

void hada_outfile_abandon(hada_outfile *out)
{
    if (out->temp)
        unlink(out->temp);
    release(out);
}

hada_status hada_outfile_save(const char *path, const void *data, size_t bytes, hada_error *err)
{
    hada_outfile out;
    hada_status status = hada_outfile_open(&out, path, err);
    if (status)
        return status;
    HADA_TRY_OR_DONE(hada_outfile_write(&out, data, bytes, err));
    return hada_outfile_commit(&out, err);
done:
    hada_outfile_abandon(&out);
    return status;
}
