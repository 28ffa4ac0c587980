#include "trees.h"

#include <dirent.h>
#include <errno.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LONGEST = 4096, OPEN_FOLDERS = 16 };

static int remove_one(const char *path, const struct stat *what, int flag, struct FTW *where)
{
    (void)what, (void)flag, (void)where;
    return remove(path);
}

int tree_remove(const char *path)
{
    return nftw(path, remove_one, OPEN_FOLDERS, FTW_DEPTH | FTW_PHYS) && errno != ENOENT ? -1 : 0;
}

/* Calls `work` for each name in a folder until it gives something else than 0, which is returned. */
static int each(const char *folder, int (*work)(const char *name, const char *path, void *user), void *user)
{
    DIR *all = opendir(folder);
    int result = all ? 0 : -1;
    for (const struct dirent *entry; !result && (entry = readdir(all));) {
        char path[LONGEST];
        if (!strcmp(entry->d_name, ".") || !strcmp(entry->d_name, ".."))
            continue;
        result = snprintf(path, sizeof path, "%s/%s", folder, entry->d_name) >= (int)sizeof path;
        if (!result)
            result = work(entry->d_name, path, user);
    }
    if (all)
        closedir(all);
    return result;
}

typedef struct search {
    const char *prefix, *other;
    tree_want want;
} search;

static int link_one(const char *name, const char *path, void *user)
{
    const search *s = user;
    char to[LONGEST];
    if (s->prefix && !strncmp(name, s->prefix, strlen(s->prefix)))
        return 0;
    return snprintf(to, sizeof to, "%s/%s", s->other, name) >= (int)sizeof to ? -1 : symlink(path, to);
}

int tree_link(const char *from, const char *to, const char *but)
{
    search s = {.prefix = but, .other = to};
    return each(from, link_one, &s);
}

static int is_link(const char *path)
{
    struct stat what;
    return !lstat(path, &what) && S_ISLNK(what.st_mode);
}

static int take_one(const char *name, const char *path, void *user)
{
    const search *s = user;
    char to[LONGEST];
    if (strncmp(name, s->prefix, strlen(s->prefix)) || is_link(path))
        return 0;
    return snprintf(to, sizeof to, "%s/%s", s->other, name) >= (int)sizeof to ? -1 : rename(path, to);
}

int tree_take(const char *from, const char *to, const char *prefix)
{
    search s = {.prefix = prefix, .other = to};
    return each(from, take_one, &s);
}

static int has_one(const char *name, const char *path, void *user)
{
    const search *s = user;
    (void)path;
    return !strncmp(name, s->prefix, strlen(s->prefix));
}

int tree_has(const char *folder, const char *prefix)
{
    search s = {.prefix = prefix};
    return each(folder, has_one, &s) == 1;
}

static int same_files(const char *a, const char *b)
{
    FILE *one = fopen(a, "rb"), *other = fopen(b, "rb");
    int same = one && other;
    while (same) {
        char left[LONGEST], right[LONGEST];
        const size_t got = fread(left, 1, sizeof left, one), also = fread(right, 1, sizeof right, other);
        same = got == also && !memcmp(left, right, got);
        if (!got)
            break;
    }
    if (one)
        fclose(one);
    if (other)
        fclose(other);
    return same;
}

static int is_one(const char *name, const char *path, void *user);

/* 0: as wanted. */
static int compare(const char *path, const char *whole, tree_want want)
{
    struct stat what, there;
    if (lstat(path, &what) || stat(whole, &there) || S_ISDIR(what.st_mode) != S_ISDIR(there.st_mode))
        return 1;
    search s = {.prefix = "", .other = whole, .want = want};
    if (!S_ISDIR(what.st_mode))
        return want != TREE_NAMES && !same_files(path, whole);
    if (each(path, is_one, &s))
        return 1;
    search back = {.prefix = "", .other = path, .want = TREE_ANY};
    return want != TREE_PARTS && each(whole, is_one, &back);
}

static int is_one(const char *name, const char *path, void *user)
{
    const search *s = user;
    char other[LONGEST];
    if (strncmp(name, s->prefix, strlen(s->prefix)))
        return 0;
    if (snprintf(other, sizeof other, "%s/%s", s->other, name) >= (int)sizeof other)
        return -1;
    if (s->want == TREE_ANY)
        return access(other, F_OK) != 0;
    return is_link(path) ? 0 : s->want == TREE_NOTHING ? 1 : compare(path, other, s->want);
}

int tree_is(const char *folder, const char *whole, const char *prefix, tree_want want)
{
    search s = {.prefix = prefix, .other = whole, .want = want};
    if (want == TREE_ANY)
        return 1;
    if (each(folder, is_one, &s))
        return 0;
    search back = {.prefix = prefix, .other = folder, .want = TREE_ANY};
    return want == TREE_PARTS || want == TREE_NOTHING || !each(whole, is_one, &back);
}

static char hidden[LONGEST + 40];

static int hidden_one(const char *path, const struct stat *what, int flag, struct FTW *where)
{
    (void)what, (void)flag;
    const char *name = path + where->base;
    if (!where->level || (*name != '.' && strncmp(name, "hadalens-", strlen("hadalens-"))))
        return 0;
    snprintf(hidden, sizeof hidden, "left behind: %s", path);
    return 1;
}

const char *tree_hidden(const char *folder)
{
    return nftw(folder, hidden_one, OPEN_FOLDERS, FTW_PHYS) == 1 ? hidden : NULL;
}
