/* Writing a tuning file: what it says of other devices and sizes stays. fft_table.c reads it. */
#include <errno.h>
#include <hadalens/tune.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/alloc.h"
#include "fft/fft_internal.h"

/* Whether a line names this kind and one of these sizes, and nothing wider. */
static int superseded(const char *line, const char *kind, const hada_tune_row *rows, size_t count)
{
    char word[32], size[64];
    if (sscanf(line, " fft %31s %63s", word, size) != 2 || strcmp(word, kind))
        return 0;
    for (size_t i = 0; i < count; i++) {
        char wanted[64];
        snprintf(wanted, sizeof wanted, "%dx%d", rows[i].rows, rows[i].cols);
        if (!strcmp(size, wanted))
            return 1;
    }
    return 0;
}

/* Copies what stays. Lines may be of any length: only their head is looked at. */
static int copy_rest(FILE *from, FILE *to, const char *kind, const hada_tune_row *rows, size_t count)
{
    char part[256];
    int first = 1, keep = 1, ended = 1;
    while (fgets(part, sizeof part, from)) {
        if (first)
            keep = !superseded(part, kind, rows, count);
        if (keep && fputs(part, to) < 0)
            return 0;
        first = strchr(part, '\n') != NULL;
        ended = keep ? first : ended;
    }
    return !ferror(from) && (ended || fputc('\n', to) != EOF);
}

static int write_rows(FILE *to, const char *kind, const hada_tune_row *rows, size_t count)
{
    int good = 1;
    for (size_t i = 0; good && i < count; i++)
        good = fprintf(to, "fft %s %dx%d %s\n", kind, rows[i].rows, rows[i].cols,
                       hada_tune_backend_name(rows[i].chosen)) > 0;
    return good;
}

static hada_status failed(const char *path, int code, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s; nothing was left behind", path,
                     strerror(code));
}

static hada_status write_beside(const char *beside, const char *path, const char *kind, const hada_tune_row *rows,
                                size_t count, hada_error *err)
{
    FILE *old = fopen(path, "r");
    if (!old && errno != ENOENT)
        return hada_fail(err, HADA_ERROR_FILE_READ, "%s cannot be read, so it is not changed: %s", path,
                         strerror(errno));
    FILE *file = fopen(beside, "w");
    int good = file != NULL;
    if (good && !old)
        good = fprintf(file, "# Hadalens: which back end serves a transform (docs/fft.md)\n") > 0;
    if (good && old)
        good = copy_rest(old, file, kind, rows, count);
    good = good && write_rows(file, kind, rows, count);
    int code = errno;
    if (file && fclose(file) && good) {
        good = 0;
        code = errno;
    }
    if (old)
        fclose(old);
    if (good && rename(beside, path)) {
        good = 0;
        code = errno;
    }
    if (!good && file)
        unlink(beside);
    return good ? HADA_OK : failed(path, code, err);
}

hada_status hada_tune_save(const hada_context *context, const char *path, const hada_tune_row *rows, size_t count,
                           hada_error *err)
{
    if (!context || !path || !*path || (count && !rows))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_tune_save: a context, a file name and rows are needed");
    struct stat info;
    if (!stat(path, &info) && !S_ISREG(info.st_mode))
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s is not an ordinary file: choose another name", path);
    const size_t bytes = strlen(path) + 48;
    char *beside;
    hada_status status = hada_alloc((void **)&beside, bytes, 1, "a file name", err);
    if (status)
        return status;
    snprintf(beside, bytes, "%s.tmp-%ld-%p", path, (long)getpid(), (const void *)&info);
    status = write_beside(beside, path, hada_device_kind_name(context->info.kind), rows, count, err);
    free(beside);
    return status;
}
