/* PoCL's cache after a loss of power. PoCL writes files beside and renames them, but does not wait for the disk: a loss
 * of power leaves some empty or cut, and PoCL ends every process that loads one. Until the machine starts again, no
 * file can be damaged in this way. So the first context after each start looks at the form of all files and removes the
 * damaged ones; PoCL compiles them again. A note in the folder says which start it was. Where anything fails here, the
 * cache stays as it is. */
#include <dirent.h>
#include <fcntl.h>
#include <time.h>
#include <unistd.h>

#include "core/input.h"
#include "runtime/program.h"

/* Folders of the cache: two letters, the rest of a program's hash, a kernel, a work-group size. */
enum { LETTERS, PROGRAM, KERNEL, SIZE, LAST };

/* Files that changed so lately may be in the making. */
enum { FRESH_SECONDS = 10 };

static uint64_t number(const unsigned char *at, size_t bytes)
{
    uint16_t half;
    uint32_t word;
    uint64_t all;
    memcpy(&half, at, sizeof half);
    memcpy(&word, at, sizeof word);
    if (bytes < sizeof all)
        return bytes == sizeof half ? half : word;
    memcpy(&all, at, sizeof all);
    return all;
}

/* LLVM's bitcode: a magic number, then blocks that give their lengths; the table of strings is the last. */
static int bitcode_is_whole(int fd, size_t bytes)
{
    enum { ENTER_BLOCK = 1, STRING_TABLE = 23 };
    unsigned char head[8];
    unsigned block = 0;
    if (bytes < sizeof head || hada_read_at(fd, head, sizeof head, 0) || memcmp(head, "BC\xc0\xde", 4) != 0)
        return 0;
    uint64_t at = 4;
    while (at < bytes) {
        if (bytes - at < sizeof head || hada_read_at(fd, head, sizeof head, at) || (head[0] & 3) != ENTER_BLOCK)
            return 0;
        block = number(head, 2) >> 2 & 0xff;
        at += sizeof head + 4 * number(head + 4, 4);
    }
    return at == bytes && block == STRING_TABLE;
}

/* A shared library, ELF: its table of sections ends the file. Other forms only have to begin with something. */
static int library_is_whole(int fd, size_t bytes)
{
    unsigned char head[64], section[64];
    if (bytes < sizeof head || hada_read_at(fd, head, sizeof head, 0) || !head[0])
        return 0;
    if (memcmp(head, "\177ELF", 4) != 0)
        return 1;
    const int wide = head[4] == 2;
    const uint64_t table = number(head + (wide ? 0x28 : 0x20), wide ? 8 : 4);
    const uint64_t size = number(head + (wide ? 0x3a : 0x2e), 2), count = number(head + (wide ? 0x3c : 0x30), 2);
    if (!table)
        return 1;
    if (size < 8 || size > sizeof section || !count || table > bytes || size * count > bytes - table ||
        hada_read_at(fd, section, size, table + size * (count - 1)))
        return 0;
    return number(section + 4, 4) != 0; /* the kind of the last section; 0 is none */
}

/* Whether a file is the user's own, at rest, and not whole. */
static int is_damaged(const char *path, int (*is_whole)(int fd, size_t bytes))
{
    struct stat what;
    size_t bytes;
    int fd;
    if (lstat(path, &what) || !S_ISREG(what.st_mode) || what.st_uid != geteuid() ||
        llabs((long long)time(NULL) - (long long)what.st_mtime) < FRESH_SECONDS ||
        hada_input_open(&fd, &bytes, path, NULL, NULL))
        return 0;
    const int whole = is_whole(fd, bytes);
    close(fd);
    return !whole;
}

static int is_letters(const char *name, int level)
{
    const size_t count = strspn(name, "ABCDEFGHIJKLMNOP");
    return !name[count] && (level == LETTERS ? count == 2 : count > 30);
}

/* Goes through the folder `path`; returns how many files were removed. */
static int mend(const char *path, int level)
{
    int removed = 0;
    DIR *open = opendir(path);
    if (!open)
        return 0;
    for (const struct dirent *entry; (entry = readdir(open));) {
        char inner[4096];
        const char *name = entry->d_name, *dot = strrchr(name, '.');
        const int n = snprintf(inner, sizeof inner, "%s/%s", path, name);
        if (*name == '.' || n < 0 || (size_t)n >= sizeof inner || (level <= PROGRAM && !is_letters(name, level)))
            continue;
        if (level == LAST)
            removed += dot && !strcmp(dot, ".so") && is_damaged(inner, library_is_whole) && !unlink(inner);
        else if (level == KERNEL && dot)
            removed += !strcmp(name, "program.bc") && is_damaged(inner, bitcode_is_whole) && !unlink(inner);
        else
            removed += mend(inner, level + 1);
    }
    closedir(open);
    return removed;
}

static int cache_folder(char *out, size_t size)
{
    static const char *const places[][2] = {
        {"POCL_CACHE_DIR", ""}, {"XDG_CACHE_HOME", "/pocl/kcache"}, {"HOME", "/.cache/pocl/kcache"}};
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        const char *root = getenv(places[i][0]);
        const int n = root && *root ? snprintf(out, size, "%s%s", root, places[i][1]) : 0;
        if (n > 0)
            return (size_t)n < size;
    }
    return 0;
}

/* The number of this start of the machine, or the one that a note holds; "" where there is none. */
static void read_start(char out[40], const char *path)
{
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    const ssize_t got = fd < 0 ? 0 : read(fd, out, 39);
    out[got > 0 ? got : 0] = '\0';
    if (fd >= 0)
        close(fd);
}

void hada_driver_cache_mend(hada_context *context)
{
    char folder[4000], note[4096], now[40], noted[40];
    if (!strstr(context->info.platform, "Portable Computing Language") || !cache_folder(folder, sizeof folder) ||
        access(folder, W_OK | X_OK))
        return;
    snprintf(note, sizeof note, "%s/hadalens-checked", folder);
    read_start(now, "/proc/sys/kernel/random/boot_id");
    read_start(noted, note);
    if (*now && !strcmp(now, noted))
        return;
    const int removed = mend(folder, LETTERS);
    if (removed)
        hada_log(
            context, HADA_LOG_WARNING,
            "PoCL's cache %s: files that are empty or cut, as after a loss of power, were removed (%d); PoCL compiles "
            "them again",
            folder, removed);
    const int fd = *now ? open(note, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0600) : -1;
    if (fd < 0)
        return;
    (void)!write(fd, now, strlen(now));
    close(fd);
}
