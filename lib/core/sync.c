#include "core/sync.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/staged.h"

/* Folders open at once while a tree is walked. */
enum { OPEN_FOLDERS = 16 };

int hada_sync(int fd)
{
    int failed;
    do
        failed = fsync(fd);
    while (failed && errno == EINTR);
    return failed && errno != EINVAL && errno != ENOTSUP && errno != EROFS ? -1 : 0;
}

static int sync_path(const char *path)
{
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0)
        return errno == EACCES ? 0 : -1; /* a folder that may be written to and not read: nobody can do more */
    const int failed = hada_sync(fd), code = errno;
    close(fd);
    errno = code;
    return failed;
}

int hada_sync_parent(const char *path)
{
    const char *slash = strrchr(path, '/');
    char *parent = slash ? strndup(path, slash == path ? 1 : (size_t)(slash - path)) : strdup(".");
    if (!parent)
        return -1;
    /* the folder itself, also where a link leads to it */
    const int fd = open(parent, O_RDONLY | O_CLOEXEC | O_DIRECTORY);
    int failed = fd < 0 ? errno != EACCES : hada_sync(fd);
    const int code = errno;
    if (fd >= 0)
        close(fd);
    free(parent);
    errno = code;
    return failed ? -1 : 0;
}

/* Lets the disk begin with all files before any is waited for. */
static int begin_one(const char *path, const struct stat *what, int flag, struct FTW *where)
{
    (void)what;
    (void)where;
    const int fd = flag == FTW_F ? open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW) : -1;
    if (fd < 0)
        return 0;
    (void)sync_file_range(fd, 0, 0, SYNC_FILE_RANGE_WRITE);
    close(fd);
    return 0;
}

static int sync_one(const char *path, const struct stat *what, int flag, struct FTW *where)
{
    (void)what;
    (void)where;
    return flag == FTW_F || flag == FTW_DP || flag == FTW_D ? sync_path(path) : 0;
}

int hada_sync_tree(const char *path)
{
    nftw(path, begin_one, OPEN_FOLDERS, FTW_PHYS);
    return nftw(path, sync_one, OPEN_FOLDERS, FTW_PHYS | FTW_DEPTH) ? -1 : 0;
}

static int make_folder(const char *path, unsigned mode)
{
    if (mkdir(path, mode))
        return errno == EEXIST ? 0 : -1;
    return hada_staged_holds(path) ? 0 : hada_sync_parent(path);
}

int hada_folders_make(const char *path, unsigned mode)
{
    char *part = strdup(path);
    int failed = !part || !*path;
    for (char *at = part ? part + 1 : NULL; !failed && *at; at++)
        if (*at == '/') {
            *at = '\0';
            failed = make_folder(part, mode);
            *at = '/';
        }
    failed = failed || make_folder(part, mode);
    const int code = errno;
    free(part);
    errno = code;
    return failed ? -1 : 0;
}
