#include "core/outfile.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <hadalens/folder.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "core/input.h"

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
    /* close() reports a write that a network file system could not store */
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

void hada_outfile_remove(const char *path)
{
    struct stat old;
    if (!stat(path, &old) && !hada_input_is_in_use(&old))
        unlink(path);
}

hada_status hada_outfile_save(const char *path, const void *data, size_t bytes, hada_error *err)
{
    hada_outfile out;
    hada_status status = HADA_OK;
    HADA_TRY(hada_outfile_open(&out, path, err));
    HADA_TRY_OR_DONE(hada_outfile_write(&out, data, bytes, err));
    return hada_outfile_commit(&out, err);
done:
    hada_outfile_abandon(&out);
    return status;
}

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
    char *gone = hada_taken(name);
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

/* "FOLDER/.NAME.hadalens-XXXXXXXXXXXXXXXX", without its letters; returns the place of the letters, or NULL. */
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

/* One pass over the entries of a folder. */
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
        return errno == EACCES ? 0 : -1; /* the folder may be written but not read: nothing more can be done */
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
