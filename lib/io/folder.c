#include "io/folder.h"

#include <dirent.h>
#include <errno.h>
#include <ftw.h>
#include <stdarg.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/outfile.h"
#include "io/text.h"

hada_status hada_path_kind(const char *path, hada_stands *out, hada_error *err)
{
    struct stat what;
    *out = HADA_STANDS_NOTHING;
    if (!stat(path, &what))
        *out = S_ISDIR(what.st_mode) ? HADA_STANDS_FOLDER : HADA_STANDS_FILE;
    else if (errno != ENOENT && errno != ENOTDIR)
        return hada_fail(err, HADA_ERROR_FILE_OPEN, "%s cannot be looked at: %s", path, strerror(errno));
    return HADA_OK;
}

hada_status hada_path_finds_file(const char *path, int *out, hada_error *err)
{
    hada_stands kind;
    const hada_status status = hada_path_kind(path, &kind, err);
    *out = kind == HADA_STANDS_FILE;
    return status;
}

int hada_path_is_folder(const char *path)
{
    struct stat what;
    return !stat(path, &what) && S_ISDIR(what.st_mode);
}

int hada_path_is_file(const char *path)
{
    if (!path)
        return 0;
    struct stat what;
    return !stat(path, &what) && !S_ISDIR(what.st_mode);
}

const char *hada_name_of(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

/* The folder that a path's last part is in. */
static hada_status write_parent(hada_path parent, const char *path, hada_error *err)
{
    const int length = (int)(hada_name_of(path) - path) - 1;
    return hada_path_write(parent, err, "%.*s", length > 0 ? length : 1, length < 0 ? "." : path);
}

/* What stands at the folder of a path that leads to nothing, and the name in it. */
static const char *stat_folder(const char *path, struct stat *what)
{
    hada_path folder;
    return write_parent(folder, path, NULL) || stat(folder, what) ? NULL : hada_name_of(path);
}

int hada_path_is_same(const char *one, const char *other)
{
    struct stat a, b;
    const char *name, *others;
    if (!one || !other)
        return 0;
    const int missing = stat(one, &a) != 0;
    if (missing != (stat(other, &b) != 0))
        return 0;
    if (missing && (!(name = stat_folder(one, &a)) || !(others = stat_folder(other, &b)) || strcmp(name, others) != 0))
        return !strcmp(one, other);
    return a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

int hada_path_is_vacant(const char *path)
{
    if (!path)
        return 0;
    struct stat what;
    if (lstat(path, &what))
        return 1;
    DIR *open = opendir(path);
    int entries = 0;
    errno = 0;
    while (open && entries < 3 && readdir(open))
        entries++;
    const int whole = open && !errno;
    if (open)
        closedir(open);
    return whole && entries < 3; /* "." and ".." */
}

hada_status hada_path_format(char **out, hada_error *err, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const int length = vasprintf(out, format, arguments);
    va_end(arguments);
    if (length >= 0)
        return HADA_OK;
    *out = NULL;
    return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the name of a file");
}

hada_status hada_path_write(hada_path out, hada_error *err, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(out, sizeof(hada_path), format, arguments);
    va_end(arguments);
    return length >= 0 && (size_t)length < sizeof(hada_path)
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_FILE_OPEN, "the name of a file is too long: %.200s...", out);
}

size_t hada_name_stem(const char *name)
{
    const char *dot = strrchr(name, '.');
    return dot && dot > name ? (size_t)(dot - name) : strlen(name);
}

double hada_name_distance(const char *name, const char **rest)
{
    const char *end, *number = name + (*name == 'z' || *name == 'Z');
    if (*number < '0' || *number > '9')
        return -1.0;
    const double distance = hada_text_number(number, &end);
    if (strncmp(end, "mm", 2) || !isfinite(distance) || (number == name && end[2] && end[2] != '.'))
        return -1.0;
    *rest = end + 2;
    return distance;
}

hada_status hada_path_stem(char **out, const char *path, hada_error *err)
{
    const char *name = hada_name_of(path);
    return hada_path_format(out, err, "%.*s", (int)hada_name_stem(name), name);
}

void hada_error_prefix_path(hada_error *err, const char *path)
{
    const size_t length = strlen(path);
    if (err && (strncmp(err->message, path, length) || (err->message[length] != ':' && err->message[length] != ',')))
        hada_error_prefix(err, "%s: ", path);
}

hada_status hada_named(hada_status status, const char *path, hada_error *err)
{
    if (status)
        hada_error_prefix_path(err, path);
    return status;
}

/* Tried rather than asked: permissions, read-only mounts and full disks all show. */
static hada_status try_file(const char *folder, hada_error *err)
{
    hada_path probe;
    HADA_TRY(hada_path_write(probe, err, "%s/.hadalens-XXXXXX", folder));
    const int file = mkstemp(probe);
    if (file < 0)
        return hada_fail(err, HADA_ERROR_FILE_WRITE,
                         "nothing can be written in the folder %s: %s; choose another with options.output", folder,
                         strerror(errno));
    close(file);
    unlink(probe);
    return HADA_OK;
}

hada_status hada_folder_ensure(const char *path, hada_error *err)
{
    HADA_NEED(path, err);
    if (hada_folders_make(path, 0777))
        HADA_TRY(hada_fail(err, HADA_ERROR_FILE_WRITE, "the folder %s cannot be made: %s", path, strerror(errno)));
    if (!hada_path_is_folder(path))
        HADA_TRY(hada_fail(err, HADA_ERROR_FILE_WRITE, "%s is a file; a folder is needed here", path));
    return try_file(path, err);
}

hada_status hada_file_check_target(const char *path, hada_error *err)
{
    HADA_NEED(path, err);
    char *real = NULL;
    hada_path folder;
    struct stat old;
    hada_status status = HADA_OK;
    if (hada_path_is_folder(path))
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s is a folder; give the name of a file", path);
    HADA_TRY_OR_DONE(hada_outfile_check(path, &real, &old, err));
    HADA_TRY_OR_DONE(write_parent(folder, path, err));
    if (!hada_path_is_folder(folder))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: there is no folder %s", path, folder));
    HADA_TRY_OR_DONE(hada_folder_ensure(folder, err));
done:
    free(real);
    return status;
}

hada_status hada_file_write(const char *path, const void *data, size_t bytes, hada_error *err)
{
    HADA_NEED(path && (data || !bytes), err);
    return hada_outfile_save(path, data, bytes, err);
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static int is_picture(const char *name)
{
    static const char *const endings[] = {"tif", "tiff", "png", "jpg", "jpeg", "npy", "mat", "dng", "raw"};
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; name[0] != '.' && dot && i < HADA_COUNT(endings); i++)
        if (!strcasecmp(dot + 1, endings[i]))
            return 1;
    return 0;
}

static hada_status add_name(char ***names, int *count, const char *name, hada_error *err)
{
    HADA_TRY(HADA_GROW(*names, (size_t)*count, 1, "the names of a folder's files", err));
    const hada_status status = hada_path_format(&(*names)[*count], err, "%s", name);
    *count += !status;
    return status;
}

/* `what`: the folder's kind, for messages. */
static hada_status list_names(const char *folder, const char *what, int (*is_wanted)(const char *name), char ***names,
                              int *count, hada_error *err)
{
    hada_status status = HADA_OK;
    *names = NULL;
    *count = 0;
    DIR *open = opendir(folder);
    if (!open)
        return hada_fail(err, HADA_ERROR_FILE_OPEN, "the %s %s cannot be read: %s", what, folder, strerror(errno));
    const struct dirent *entry;
    while ((errno = 0, entry = readdir(open)))
        if (is_wanted(entry->d_name))
            HADA_TRY_OR_DONE(add_name(names, count, entry->d_name, err));
    if (errno)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_FILE_READ, "the %s %s cannot be read: %s", what, folder, strerror(errno)));
    if (*count)
        qsort(*names, (size_t)*count, sizeof **names, by_name);
done:
    closedir(open);
    if (status)
        hada_names_free(names, count);
    return status;
}

static int is_depth(const char *name)
{
    const char *rest;
    return hada_name_distance(name, &rest) >= 0.0 && !*rest;
}

hada_status hada_folder_list_tiffs(const char *folder, char ***names, int *count, hada_error *err)
{
    return list_names(folder, "folder", is_picture, names, count, err);
}

hada_status hada_folder_list_depths(const char *folder, const char *what, char ***names, int *count, hada_error *err)
{
    return list_names(folder, what, is_depth, names, count, err);
}

void hada_names_free(char ***names, int *count)
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

void hada_folder_remove(const char *path)
{
    if (!path)
        return;
    nftw(path, remove_one, 16, FTW_DEPTH | FTW_PHYS);
}

/* The folder's path without '/' at its end and, where something is there, without links. */
static hada_status find_target(char **target, const char *path, hada_error *err)
{
    size_t length = strlen(path);
    while (length > 1 && path[length - 1] == '/')
        length--;
    HADA_TRY(hada_path_format(target, err, "%.*s", (int)length, path));
    if (!hada_path_is_vacant(*target))
        HADA_TRY(hada_fail(err, HADA_ERROR_FILE_WRITE,
                           "%s is there already and not an empty folder; choose another name with options.output, or "
                           "move it away",
                           *target));
    char *real = realpath(*target, NULL);
    if (real) {
        free(*target);
        *target = real;
    }
    return HADA_OK;
}

/* Makes the missing folders above a path. */
static hada_status ensure_parent(const char *path, hada_error *err)
{
    hada_path parent;
    HADA_TRY(write_parent(parent, path, err));
    return hada_folder_ensure(parent, err);
}

/* Mode and owner of the empty folder that is replaced. */
static int take_over(const char *from, const char *to)
{
    struct stat old;
    if (stat(from, &old))
        return 0;
    if (chown(to, old.st_uid, old.st_gid) && errno != EPERM)
        return -1;
    return chmod(to, old.st_mode & 07777);
}

hada_status hada_folder_create(const char *path, hada_folder_fill fill, void *user, hada_error *err)
{
    char *target = NULL, *beside = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(find_target(&target, path, err));
    HADA_TRY_OR_DONE(ensure_parent(target, err));
    HADA_TRY_OR_DONE(hada_staged_make(&beside, NULL, HADA_STAGED_FOLDER, target, 0777, path, err));
    HADA_TRY_OR_DONE(fill(user, beside, err));
    if (take_over(target, beside) || hada_sync_tree(beside) || rename(beside, target))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_WRITE, "%s could not be completed: %s; nothing was left behind",
                                   target, strerror(errno)));
    hada_staged_forget(&beside);
    if (hada_sync_parent(target))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_FILE_WRITE, "%s may not outlast a loss of power: %s", target, strerror(errno)));
done:
    if (beside)
        hada_folder_remove(beside);
    hada_staged_forget(&beside);
    free(target);
    return status;
}
