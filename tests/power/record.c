/* LD_PRELOAD: writes what a program does to files, in order, as lines of the file that POWER_LOG names: what was
 * written to, synchronised, renamed, made, removed. judge.py says what a loss of power would have left. */
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Seen by the linker of whatever is recorded, although these tests hide what they can. */
#pragma GCC visibility push(default)

enum { LONGEST = 4096 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

#define TRUE_ONE(name) ((__typeof__(&name))(uintptr_t)dlsym(RTLD_NEXT, #name))

/* The absolute path of a name, or of what is open. */
static const char *whole(char *out, const char *path)
{
    char folder[LONGEST / 2];
    if (*path == '/' || !getcwd(folder, sizeof folder))
        snprintf(out, LONGEST, "%s", path);
    else
        snprintf(out, LONGEST, "%s/%s", folder, path);
    return out;
}

static const char *opened(char *out, int fd)
{
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    const ssize_t length = readlink(link, out, LONGEST - 1);
    out[length < 0 ? 0 : length] = '\0';
    return out;
}

static void note(const char *what, const char *path, const char *other)
{
    static int log = -2;
    char line[3 * LONGEST];
    pthread_mutex_lock(&lock);
    if (log == -2) {
        const char *name = getenv("POWER_LOG");
        log = name ? TRUE_ONE(open)(name, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600) : -1;
    }
    const int length = snprintf(line, sizeof line, "%s\t%s\t%s\n", what, path, other ? other : "");
    if (log >= 0 && TRUE_ONE(write)(log, line, (size_t)length) != length)
        abort();
    pthread_mutex_unlock(&lock);
}

static void note_open(const char *path, int flags, int fd)
{
    char name[LONGEST];
    if (fd >= 0 && flags & (O_CREAT | O_TRUNC))
        note("write", whole(name, path), NULL);
}

#define RECORDED(open)                                                                                                 \
    int open(const char *path, int flags, ...)                                                                         \
    {                                                                                                                  \
        va_list rest;                                                                                                  \
        va_start(rest, flags);                                                                                         \
        const mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;                                                \
        va_end(rest);                                                                                                  \
        const int fd = TRUE_ONE(open)(path, flags, mode);                                                              \
        note_open(path, flags, fd);                                                                                    \
        return fd;                                                                                                     \
    }
RECORDED(open)
RECORDED(open64)

/* Whatever goes through a stream is taken to be written when it is opened, and once more when it is flushed. */
FILE *fopen(const char *path, const char *mode)
{
    char name[LONGEST];
    FILE *file = TRUE_ONE(fopen)(path, mode);
    if (file && *mode != 'r')
        note("write", whole(name, path), NULL);
    return file;
}

static void note_stream(FILE *file)
{
    char name[LONGEST];
    const int flags = file ? fcntl(fileno(file), F_GETFL) : -1;
    if (flags >= 0 && (flags & O_ACCMODE) != O_RDONLY)
        note("write", opened(name, fileno(file)), NULL);
}

int fflush(FILE *file)
{
    note_stream(file);
    return TRUE_ONE(fflush)(file);
}

ssize_t write(int fd, const void *data, size_t bytes)
{
    char name[LONGEST];
    note("write", opened(name, fd), NULL);
    return TRUE_ONE(write)(fd, data, bytes);
}

ssize_t pwrite(int fd, const void *data, size_t bytes, off_t at)
{
    char name[LONGEST];
    note("write", opened(name, fd), NULL);
    return TRUE_ONE(pwrite)(fd, data, bytes, at);
}

int fsync(int fd)
{
    char name[LONGEST];
    const int failed = TRUE_ONE(fsync)(fd);
    if (!failed)
        note("sync", opened(name, fd), NULL);
    return failed;
}

int rename(const char *from, const char *to)
{
    char one[LONGEST], other[LONGEST];
    const int failed = TRUE_ONE(rename)(from, to);
    if (!failed)
        note("rename", whole(one, from), whole(other, to));
    return failed;
}

int linkat(int from_fd, const char *from, int to_fd, const char *to, int flags)
{
    char one[LONGEST], other[LONGEST];
    const int failed = TRUE_ONE(linkat)(from_fd, from, to_fd, to, flags);
    if (!failed)
        note("link", whole(one, from), whole(other, to));
    return failed;
}

int mkdir(const char *path, mode_t mode)
{
    char name[LONGEST];
    const int failed = TRUE_ONE(mkdir)(path, mode);
    if (!failed)
        note("mkdir", whole(name, path), NULL);
    return failed;
}

int unlink(const char *path)
{
    char name[LONGEST];
    const int failed = TRUE_ONE(unlink)(path);
    if (!failed)
        note("unlink", whole(name, path), NULL);
    return failed;
}
