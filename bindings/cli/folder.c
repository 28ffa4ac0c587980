#include "folder.h"

#include <dirent.h>
#include <errno.h>
#include <ftw.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

char *hada_cli_text(const char *format, ...)
{
    char *text = NULL;
    va_list arguments;
    va_start(arguments, format);
    int length = vasprintf(&text, format, arguments);
    va_end(arguments);
    return length < 0 ? NULL : text;
}

char *hada_cli_stem(const char *path)
{
    const char *slash = strrchr(path, '/');
    const char *base = slash ? slash + 1 : path;
    const char *dot = strrchr(base, '.');
    return strndup(base, dot && dot > base ? (size_t)(dot - base) : strlen(base));
}

int hada_cli_is_folder(const char *path)
{
    struct stat what;
    return !stat(path, &what) && S_ISDIR(what.st_mode);
}

int hada_cli_is_file(const char *path)
{
    struct stat what;
    return !stat(path, &what) && !S_ISDIR(what.st_mode);
}

int hada_cli_is_vacant(const char *path)
{
    struct stat what;
    if (lstat(path, &what))
        return 1;
    DIR *open = S_ISDIR(what.st_mode) ? opendir(path) : NULL;
    int entries = 0;
    while (open && entries < 3 && readdir(open))
        entries++;
    if (open)
        closedir(open);
    return open && entries < 3; /* "." and ".." */
}

hada_status hada_cli_make_folder(const char *path, hada_error *err)
{
    char *whole = strdup(path);
    if (!whole)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    int failed = 0;
    for (char *at = whole + 1; !failed && *at; at++)
        if (*at == '/') {
            *at = '\0';
            failed = mkdir(whole, 0777) && errno != EEXIST;
            *at = '/';
        }
    failed = failed || (mkdir(whole, 0777) && errno != EEXIST);
    if (failed)
        hada_cli_error(err, HADA_ERROR_FILE_WRITE, "the folder %s cannot be made: %s", path, strerror(errno));
    free(whole);
    if (failed)
        return err->status;
    if (!hada_cli_is_folder(path))
        return hada_cli_error(err, HADA_ERROR_FILE_WRITE, "%s is a file; a folder is needed here", path);
    /* Tried rather than asked: permissions, read-only mounts and full disks all show. */
    char *probe = hada_cli_text("%s/.hadalens-XXXXXX", path);
    int file = probe ? mkstemp(probe) : -1;
    int code = errno;
    if (file >= 0) {
        close(file);
        unlink(probe);
    }
    free(probe);
    return file >= 0 ? HADA_OK
                     : hada_cli_error(err, HADA_ERROR_FILE_WRITE,
                                      "nothing can be written in the folder %s: %s; choose another with -o", path,
                                      strerror(code));
}

hada_status hada_cli_check_output(const char *path, hada_error *err)
{
    if (hada_cli_is_folder(path))
        return hada_cli_error(err, HADA_ERROR_FILE_WRITE, "%s is a folder; give the name of a file", path);
    const char *slash = strrchr(path, '/');
    char *folder = slash ? strndup(path, slash == path ? 1 : (size_t)(slash - path)) : strdup(".");
    if (!folder)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    hada_status status = HADA_OK;
    if (!hada_cli_is_folder(folder))
        status =
            hada_cli_error(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: there is no folder %s", path, folder);
    else
        status = hada_cli_make_folder(folder, err);
    free(folder);
    return status;
}

hada_status hada_cli_write_text(const char *path, const char *text, size_t size, hada_error *err)
{
    char *beside = hada_cli_text("%s.part-%ld", path, (long)getpid());
    FILE *out = beside ? fopen(beside, "w") : NULL;
    hada_status status = HADA_OK;
    int failed = !out || fwrite(text, 1, size, out) != size;
    if (out)
        failed |= fclose(out) != 0;
    if (!beside)
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    else if (failed || rename(beside, path))
        status = hada_cli_error(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s", path, strerror(errno));
    if (status && out)
        unlink(beside);
    free(beside);
    return status;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static int is_tiff(const char *name)
{
    const char *dot = strrchr(name, '.');
    return name[0] != '.' && dot && (!strcasecmp(dot, ".tif") || !strcasecmp(dot, ".tiff"));
}

hada_status hada_cli_list_tiffs(const char *folder, char ***names, int *count, hada_error *err)
{
    *names = NULL;
    *count = 0;
    DIR *open = opendir(folder);
    if (!open)
        return hada_cli_error(err, HADA_ERROR_FILE_OPEN, "the folder %s cannot be read: %s", folder, strerror(errno));
    struct dirent *entry;
    int room = 0, failed = 0;
    while (!failed && (entry = readdir(open))) {
        if (!is_tiff(entry->d_name))
            continue;
        if (*count == room) {
            room = room ? 2 * room : 32;
            char **more = realloc(*names, (size_t)room * sizeof *more);
            failed = !more;
            *names = more ? more : *names;
        }
        if (!failed && !((*names)[(*count)++] = strdup(entry->d_name)))
            failed = 1;
    }
    closedir(open);
    if (failed) {
        hada_cli_free_names(names, count);
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    if (*count)
        qsort(*names, (size_t)*count, sizeof **names, by_name);
    return HADA_OK;
}

void hada_cli_free_names(char ***names, int *count)
{
    for (int i = 0; i < *count; i++)
        free((*names)[i]);
    free(*names);
    *names = NULL;
    *count = 0;
}

static int remove_one(const char *path, const struct stat *what, int flag, struct FTW *where)
{
    (void)what;
    (void)flag;
    (void)where;
    return remove(path);
}

void hada_cli_remove_tree(const char *path)
{
    nftw(path, remove_one, 16, FTW_DEPTH | FTW_PHYS);
}

hada_status hada_cli_write_folder(const char *path,
                                  hada_status (*fill)(void *user, const char *folder, hada_error *err), void *user,
                                  hada_error *err)
{
    size_t length = strlen(path);
    while (length > 1 && path[length - 1] == '/')
        length--;
    char *target = strndup(path, length);
    char *beside = target ? hada_cli_text("%s.part-%ld", target, (long)getpid()) : NULL;
    hada_status status = HADA_OK;
    if (!beside)
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    else if (!hada_cli_is_vacant(target))
        status = hada_cli_error(err, HADA_ERROR_FILE_WRITE,
                                "%s is there already and not an empty folder; choose another name with -o, or move it "
                                "away",
                                target);
    if (!status && !(status = hada_cli_make_folder(beside, err))) {
        status = fill(user, beside, err);
        if (!status && rename(beside, target))
            status = hada_cli_error(err, HADA_ERROR_FILE_WRITE, "%s cannot be renamed to %s: %s", beside, target,
                                    strerror(errno));
        if (status)
            hada_cli_remove_tree(beside);
    }
    free(beside);
    free(target);
    return status;
}
