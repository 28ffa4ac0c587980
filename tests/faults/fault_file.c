/* Wrappers of the calls that reach files: a full disk, a lost server, a folder without permission. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <sys/stat.h>
#include <sys/types.h>

#include "fault.h"

int __real_open(const char *path, int flags, ...);
int __real_close(int fd);
ssize_t __real_write(int fd, const void *data, size_t bytes);
ssize_t __real_pwrite(int fd, const void *data, size_t bytes, off_t at);
ssize_t __real_pread(int fd, void *data, size_t bytes, off_t at);
off_t __real_lseek(int fd, off_t at, int whence);
ssize_t __real_read(int fd, void *data, size_t bytes);
int __real_fsync(int fd);
int __real_fstat(int fd, struct stat *what);
int __real_fchmod(int fd, mode_t mode);
char *__real_realpath(const char *path, char *out);
DIR *__real_opendir(const char *path);
struct dirent *__real_readdir(DIR *folder);
ssize_t __real_getrandom(void *out, size_t bytes, unsigned flags);
int __real_rename(const char *from, const char *to);
int __real_mkdir(const char *path, mode_t mode);
FILE *__real_fopen(const char *path, const char *mode);
int __real_fclose(FILE *file);
size_t __real_fread(void *data, size_t size, size_t count, FILE *file);
size_t __real_fwrite(const void *data, size_t size, size_t count, FILE *file);

int __wrap_open(const char *path, int flags, ...);
int __wrap_close(int fd);
ssize_t __wrap_write(int fd, const void *data, size_t bytes);
ssize_t __wrap_pwrite(int fd, const void *data, size_t bytes, off_t at);
ssize_t __wrap_pread(int fd, void *data, size_t bytes, off_t at);
off_t __wrap_lseek(int fd, off_t at, int whence);
ssize_t __wrap_read(int fd, void *data, size_t bytes);
int __wrap_fsync(int fd);
int __wrap_fstat(int fd, struct stat *what);
int __wrap_fchmod(int fd, mode_t mode);
char *__wrap_realpath(const char *path, char *out);
DIR *__wrap_opendir(const char *path);
struct dirent *__wrap_readdir(DIR *folder);
ssize_t __wrap_getrandom(void *out, size_t bytes, unsigned flags);
int __wrap_rename(const char *from, const char *to);
int __wrap_mkdir(const char *path, mode_t mode);
FILE *__wrap_fopen(const char *path, const char *mode);
int __wrap_fclose(FILE *file);
size_t __wrap_fread(void *data, size_t size, size_t count, FILE *file);
size_t __wrap_fwrite(const void *data, size_t size, size_t count, FILE *file);

static int fails(const char *name, int code)
{
    if (!fault_here(FAULT_FILE, name))
        return 0;
    errno = code;
    return 1;
}

int __wrap_open(const char *path, int flags, ...)
{
    va_list arguments;
    va_start(arguments, flags);
    const unsigned mode = flags & O_CREAT ? va_arg(arguments, unsigned) : 0;
    va_end(arguments);
    return fails("open", EACCES) ? -1 : __real_open(path, flags, mode);
}

/* A failed close has closed all the same. */
int __wrap_close(int fd)
{
    const int result = __real_close(fd);
    return fails("close", EIO) ? -1 : result;
}

ssize_t __wrap_write(int fd, const void *data, size_t bytes)
{
    return fails("write", ENOSPC) ? -1 : __real_write(fd, data, bytes);
}

ssize_t __wrap_pwrite(int fd, const void *data, size_t bytes, off_t at)
{
    return fails("pwrite", ENOSPC) ? -1 : __real_pwrite(fd, data, bytes, at);
}

ssize_t __wrap_pread(int fd, void *data, size_t bytes, off_t at)
{
    return fails("pread", EIO) ? -1 : __real_pread(fd, data, bytes, at);
}

off_t __wrap_lseek(int fd, off_t at, int whence)
{
    return fails("lseek", EINVAL) ? -1 : __real_lseek(fd, at, whence);
}

ssize_t __wrap_read(int fd, void *data, size_t bytes)
{
    return fails("read", EIO) ? -1 : __real_read(fd, data, bytes);
}

int __wrap_fsync(int fd)
{
    return fails("fsync", EIO) ? -1 : __real_fsync(fd);
}

int __wrap_fstat(int fd, struct stat *what)
{
    return fails("fstat", EIO) ? -1 : __real_fstat(fd, what);
}

int __wrap_fchmod(int fd, mode_t mode)
{
    return fails("fchmod", EPERM) ? -1 : __real_fchmod(fd, mode);
}

char *__wrap_realpath(const char *path, char *out)
{
    return fails("realpath", EACCES) ? NULL : __real_realpath(path, out);
}

DIR *__wrap_opendir(const char *path)
{
    return fails("opendir", EACCES) ? NULL : __real_opendir(path);
}

struct dirent *__wrap_readdir(DIR *folder)
{
    return fails("readdir", EIO) ? NULL : __real_readdir(folder);
}

ssize_t __wrap_getrandom(void *out, size_t bytes, unsigned flags)
{
    return fails("getrandom", ENOSYS) ? -1 : __real_getrandom(out, bytes, flags);
}

int __wrap_rename(const char *from, const char *to)
{
    return fails("rename", EACCES) ? -1 : __real_rename(from, to);
}

int __wrap_mkdir(const char *path, mode_t mode)
{
    return fails("mkdir", EACCES) ? -1 : __real_mkdir(path, mode);
}

FILE *__wrap_fopen(const char *path, const char *mode)
{
    return fails("fopen", EACCES) ? NULL : __real_fopen(path, mode);
}

int __wrap_fclose(FILE *file)
{
    const int result = __real_fclose(file);
    return fails("fclose", ENOSPC) ? EOF : result;
}

size_t __wrap_fread(void *data, size_t size, size_t count, FILE *file)
{
    return fails("fread", EIO) ? 0 : __real_fread(data, size, count, file);
}

size_t __wrap_fwrite(const void *data, size_t size, size_t count, FILE *file)
{
    return fails("fwrite", ENOSPC) ? 0 : __real_fwrite(data, size, count, file);
}
