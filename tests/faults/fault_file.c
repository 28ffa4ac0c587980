/* Wrappers of the calls that reach files: a full disk, a lost server, a folder without permission. Removing is not
 * among them: what cannot be removed stays behind, whatever a program does. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <sys/types.h>

#include "fault.h"

static int fails(const char *name, int code)
{
    if (!fault_here(FAULT_FILE, name))
        return 0;
    errno = code;
    return 1;
}

/* A call that fails before anything is done. Every wrapper has two prototypes: the true function, and the one that the
 * library reaches. */
#define CALLS(type, name, failure, code, parameters, ...)                                                              \
    type __real_##name parameters;                                                                                     \
    type __wrap_##name parameters;                                                                                     \
    type __wrap_##name parameters                                                                                      \
    {                                                                                                                  \
        return fails(#name, code) ? (failure) : __real_##name(__VA_ARGS__);                                            \
    }

/* A call that has done its work, and fails all the same: what is closed is closed. */
#define CLOSES(type, name, failure, code, parameters, ...)                                                             \
    type __real_##name parameters;                                                                                     \
    type __wrap_##name parameters;                                                                                     \
    type __wrap_##name parameters                                                                                      \
    {                                                                                                                  \
        const type result = __real_##name(__VA_ARGS__);                                                                \
        return fails(#name, code) ? (failure) : result;                                                                \
    }

CALLS(ssize_t, write, -1, ENOSPC, (int fd, const void *data, size_t bytes), fd, data, bytes)
CALLS(ssize_t, pwrite, -1, ENOSPC, (int fd, const void *data, size_t bytes, off_t at), fd, data, bytes, at)
CALLS(ssize_t, pread, -1, EIO, (int fd, void *data, size_t bytes, off_t at), fd, data, bytes, at)
CALLS(ssize_t, read, -1, EIO, (int fd, void *data, size_t bytes), fd, data, bytes)
CALLS(off_t, lseek, -1, EINVAL, (int fd, off_t at, int whence), fd, at, whence)
CALLS(int, fsync, -1, EIO, (int fd), fd)
CALLS(int, fstat, -1, EIO, (int fd, struct stat *what), fd, what)
CALLS(int, stat, -1, EACCES, (const char *path, struct stat *what), path, what)
CALLS(int, lstat, -1, EACCES, (const char *path, struct stat *what), path, what)
CALLS(int, fchmod, -1, EPERM, (int fd, mode_t mode), fd, mode)
CALLS(int, fchown, -1, EPERM, (int fd, uid_t user, gid_t group), fd, user, group)
CALLS(int, chmod, -1, EPERM, (const char *path, mode_t mode), path, mode)
CALLS(int, chown, -1, EPERM, (const char *path, uid_t user, gid_t group), path, user, group)
CALLS(int, flock, -1, EINTR, (int fd, int what), fd, what)
CALLS(char *, realpath, NULL, EACCES, (const char *path, char *out), path, out)
CALLS(DIR *, opendir, NULL, EACCES, (const char *path), path)
CALLS(struct dirent *, readdir, NULL, EIO, (DIR * folder), folder)
CALLS(ssize_t, getrandom, -1, ENOSYS, (void *out, size_t bytes, unsigned flags), out, bytes, flags)
CALLS(int, rename, -1, EACCES, (const char *from, const char *to), from, to)
CALLS(int, linkat, -1, EXDEV, (int from, const char *path, int to, const char *name, int flags), from, path, to, name,
      flags)
CALLS(int, mkdir, -1, EACCES, (const char *path, mode_t mode), path, mode)
CALLS(int, mkstemp, -1, EACCES, (char *path), path)
CALLS(char *, mkdtemp, NULL, EACCES, (char *path), path)
CALLS(FILE *, fopen, NULL, EACCES, (const char *path, const char *mode), path, mode)
CALLS(FILE *, fdopen, NULL, ENOMEM, (int fd, const char *mode), fd, mode)
CALLS(size_t, fread, 0, EIO, (void *data, size_t size, size_t count, FILE *file), data, size, count, file)
CALLS(size_t, fwrite, 0, ENOSPC, (const void *data, size_t size, size_t count, FILE *file), data, size, count, file)
CLOSES(int, close, -1, EIO, (int fd), fd)
CLOSES(int, fclose, EOF, ENOSPC, (FILE * file), file)
CLOSES(int, fflush, EOF, ENOSPC, (FILE * file), file)

int __real_open(const char *path, int flags, ...);
int __wrap_open(const char *path, int flags, ...);
int __wrap_open(const char *path, int flags, ...)
{
    va_list arguments;
    va_start(arguments, flags);
    const unsigned mode = flags & O_CREAT ? va_arg(arguments, unsigned) : 0;
    va_end(arguments);
    return fails("open", EACCES) ? -1 : __real_open(path, flags, mode);
}
