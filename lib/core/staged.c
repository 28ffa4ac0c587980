#include "core/staged.h"

#include <errno.h>
#include <fcntl.h>
#include <hadalens/folder.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "core/alloc.h"

/* Names on the list at once: more outputs than any program keeps open; those beyond are written all the same, and stay
 * behind when a signal ends the process. */
enum { SLOTS = 1024 };
/* Random letters of a name, 5 bits each, and how often another name is tried. */
enum { LETTERS = 16, ATTEMPTS = 100 };
/* The longest name in a folder on the file systems in use, and how deep folders are removed, and how often one that
 * fills again meanwhile. */
enum { LONGEST_NAME = 255, DEEPEST = 16, PASSES = 100 };

/* Changed under the lock, and read without it by a handler of a signal. */
static _Atomic(char *) slots[SLOTS];
static atomic_int kinds[SLOTS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
/* Set by a signal's handler: names on the list must not be freed any more, and nothing new may begin. */
static atomic_int ending;

static void enlist(char *name, hada_staged_kind kind)
{
    pthread_mutex_lock(&lock);
    for (int i = 0; i < SLOTS; i++)
        if (!atomic_load(&slots[i])) {
            atomic_store(&kinds[i], (int)kind);
            atomic_store(&slots[i], name);
            break;
        }
    pthread_mutex_unlock(&lock);
}

void hada_staged_forget(char **name)
{
    char *gone = *name;
    *name = NULL;
    if (!gone)
        return;
    pthread_mutex_lock(&lock);
    for (int i = 0; i < SLOTS; i++)
        if (atomic_load(&slots[i]) == gone) {
            atomic_store(&slots[i], NULL);
            break;
        }
    pthread_mutex_unlock(&lock);
    if (!atomic_load(&ending)) /* else the handler may be reading it */
        free(gone);
}

int hada_staged_holds(const char *path)
{
    int held = 0;
    pthread_mutex_lock(&lock);
    for (int i = 0; !held && i < SLOTS; i++) {
        const char *name = atomic_load(&kinds[i]) == HADA_STAGED_FOLDER ? atomic_load(&slots[i]) : NULL;
        const size_t length = name ? strlen(name) : 0;
        held = length && !strncmp(path, name, length) && path[length] == '/';
    }
    pthread_mutex_unlock(&lock);
    return held;
}

/* "FOLDER/.NAME.hadalens-XXXXXXXXXXXXXXXX", without its letters: where they go, or NULL. */
static char *begin_name(char **whole, const char *path)
{
    const char *slash = strrchr(path, '/'), *last = slash ? slash + 1 : path;
    const int folder = (int)(last - path), most = LONGEST_NAME - (int)sizeof "..hadalens-" - LETTERS;
    const size_t bytes = strlen(path) + sizeof "..hadalens-" + LETTERS + 2;
    *whole = malloc(bytes);
    if (!*whole)
        return NULL;
    return *whole + snprintf(*whole, bytes, "%.*s.%.*s.hadalens-", folder, path, most, last);
}

static int put_letters(char *to)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyz234567";
    unsigned char random[LETTERS];
    if (getrandom(random, sizeof random, 0) != (ssize_t)sizeof random)
        return -1;
    for (int i = 0; i < LETTERS; i++)
        to[i] = letters[random[i] % 32];
    to[LETTERS] = '\0';
    return 0;
}

static int make(const char *name, int *fd, hada_staged_kind kind, unsigned mode)
{
    if (kind == HADA_STAGED_FOLDER)
        return mkdir(name, mode);
    *fd = open(name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, mode);
    return *fd < 0;
}

hada_status hada_staged_make(char **name, int *fd, hada_staged_kind kind, const char *path, unsigned mode,
                             const char *shown, hada_error *err)
{
    char *letters = begin_name(name, path);
    if (!letters)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for a file name");
    put_letters(letters);
    enlist(*name, kind); /* first, so that a signal between finds it */
    int failed = 1;
    for (int i = 0; i < ATTEMPTS && failed; i++) {
        errno = EINTR;
        failed = atomic_load(&ending) || put_letters(letters) || make(*name, fd, kind, mode);
        if (errno != EEXIST)
            break;
    }
    if (!failed)
        return HADA_OK;
    const int code = errno;
    hada_staged_forget(name);
    return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s; %s", shown, strerror(code),
                     code == ENOENT || code == ENOTDIR ? "create its folder first"
                                                       : "check the folder's permissions, or write elsewhere");
}

/* What getdents64 fills in (man 2 getdents64); the C library's readdir() may not be called in a handler. */
typedef struct entry {
    uint64_t inode;
    int64_t next;
    unsigned short bytes;
    unsigned char kind;
    char name[];
} entry;

static void remove_in(int folder, const char *name, int depth);

/* One pass over what is in a folder. */
static void remove_some(int folder, int depth)
{
    _Alignas(entry) char block[2048];
    for (long got; (got = syscall(SYS_getdents64, folder, block, sizeof block)) > 0;)
        for (long at = 0; at < got;) {
            const entry *one = (const entry *)(const void *)(block + at);
            at += one->bytes;
            if (!strcmp(one->name, ".") || !strcmp(one->name, ".."))
                continue;
            remove_in(folder, one->name, depth);
        }
}

/* Calls nothing but the system. */
static void remove_in(int folder, const char *name, int depth)
{
    if (!unlinkat(folder, name, 0) || depth == DEEPEST)
        return;
    const int open = openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (open < 0)
        return;
    /* again, since other threads may be writing still: they find no place any more once the folder is gone */
    for (int pass = 0; pass < PASSES; pass++) {
        remove_some(open, depth + 1);
        if (!unlinkat(folder, name, AT_REMOVEDIR) || (errno != ENOTEMPTY && errno != EEXIST))
            break;
        lseek(open, 0, SEEK_SET);
    }
    close(open);
}

void hada_outputs_remove(void)
{
    const int code = errno;
    atomic_store(&ending, 1);
    for (int i = 0; i < SLOTS; i++) {
        const char *name = atomic_load(&slots[i]);
        if (name)
            remove_in(AT_FDCWD, name, 0);
    }
    errno = code;
}
