#include <unistd.h>

#include "core/clock.h"
#include "io/folder.h"
#include "tasks/live.h"

/* The folder is looked at this often, less often where a look takes long. */
#define LOOK_SECONDS 0.05
/* A file is whole when it has not changed for so long. */
#define STILL_SECONDS 0.2

static int is_later(struct timespec one, struct timespec other)
{
    return one.tv_sec > other.tv_sec || (one.tv_sec == other.tv_sec && one.tv_nsec > other.tv_nsec);
}

static int is_alike(const hada_live_file *file, const struct stat *info)
{
    return file->bytes == info->st_size && !is_later(info->st_mtim, file->changed) &&
           !is_later(file->changed, info->st_mtim);
}

/* Seconds since a file was changed, by the clock of files. */
static double age_of(const struct stat *info)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    return (double)(now.tv_sec - info->st_mtim.tv_sec) + 1e-9 * (double)(now.tv_nsec - info->st_mtim.tv_nsec);
}

/* Files and names are sorted: what was known of a name before. */
static const hada_live_file *known(const hada_live_folder *folder, const char *name)
{
    for (int low = 0, high = folder->count; low < high;) {
        const int middle = (low + high) / 2, order = strcmp(name, folder->files[middle].name);
        if (!order)
            return &folder->files[middle];
        low = order > 0 ? middle + 1 : low;
        high = order > 0 ? high : middle;
    }
    return NULL;
}

static void free_files(hada_live_file *files, int count)
{
    for (int i = 0; i < count; i++)
        free(files[i].name);
    free(files);
}

/* What the folder holds now. */
static hada_status look(hada_live_folder *folder, hada_error *err)
{
    const double now = hada_seconds();
    char **names = NULL;
    int count = 0, kept = 0;
    hada_live_file *files = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_folder_list_tiffs(folder->path, &names, &count, err));
    HADA_TRY_OR_DONE(HADA_NEW(files, (size_t)count + 1, "the files of a folder", err));
    for (int i = 0; i < count; i++) {
        struct stat info;
        hada_path path;
        HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s", folder->path, names[i]));
        if (stat(path, &info) || !S_ISREG(info.st_mode) || !info.st_size)
            continue; /* gone again, or nothing yet */
        const hada_live_file *before = known(folder, names[i]);
        const int same = before && is_alike(before, &info);
        files[kept++] = (hada_live_file){.name = names[i],
                                         .bytes = info.st_size,
                                         .changed = info.st_mtim,
                                         .still_since = same ? before->still_since : now - fmax(age_of(&info), 0.0),
                                         .done = same && before->done};
        names[i] = NULL;
    }
    free_files(folder->files, folder->count);
    folder->files = files;
    folder->count = kept;
    files = NULL;
    kept = 0;
    folder->next_look = hada_seconds() + fmax(LOOK_SECONDS, 10.0 * (hada_seconds() - now));
done:
    free_files(files, kept);
    hada_names_free(&names, &count);
    return status;
}

static hada_live_file *newest(const hada_live_folder *folder)
{
    const double now = hada_seconds();
    hada_live_file *best = NULL;
    for (int i = 0; i < folder->count; i++) {
        hada_live_file *file = &folder->files[i];
        if (!file->done && now - file->still_since >= STILL_SECONDS &&
            (!best || !is_later(best->changed, file->changed)))
            best = file;
    }
    return best;
}

static void pass_over(hada_live_folder *folder, const hada_live_file *than)
{
    for (int i = 0; i < folder->count; i++) {
        hada_live_file *file = &folder->files[i];
        if (file != than && !file->done && !is_later(file->changed, than->changed)) {
            file->done = 1;
            folder->passed_over++;
        }
    }
}

hada_status hada_live_folder_take(hada_live_folder *folder, double seconds, const char **name, hada_error *err)
{
    const double until = hada_seconds() + seconds;
    *name = NULL;
    for (;;) {
        if (hada_seconds() >= folder->next_look)
            HADA_TRY(look(folder, err));
        hada_live_file *file = newest(folder);
        if (file) {
            file->done = 1;
            if (folder->newest_only)
                pass_over(folder, file);
            *name = file->name;
            return HADA_OK;
        }
        if (hada_seconds() >= until)
            return HADA_OK;
        usleep((useconds_t)(1e6 * LOOK_SECONDS / 2));
    }
}

void hada_live_folder_end(hada_live_folder *folder)
{
    free_files(folder->files, folder->count);
    *folder = (hada_live_folder){0};
}
