/* Writing a tuning file: what it says of other devices and shapes stays. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/alloc.h"
#include "runtime/tuning.h"

typedef struct news {
    const char *operation, *kind;
    const char *const *shapes, *const *choices;
    size_t count;
} news;

/* The value of "block=" among the words behind a shape, 0 where it is not given. */
static int block_of(const char *words)
{
    const char *at = strstr(words, " block=");
    return at ? atoi(at + strlen(" block=")) : 0;
}

/* Whether a line is about this operation and kind and one of these shapes, and nothing wider. */
static int superseded(const char *line, const news *now)
{
    char operation[HADA_TUNING_WORD], kind[HADA_TUNING_WORD], shape[HADA_TUNING_WORD];
    if (sscanf(line, " %63s %63s %63s", operation, kind, shape) != 3 || strcmp(operation, now->operation) ||
        strcmp(kind, now->kind))
        return 0;
    for (size_t i = 0; i < now->count; i++)
        if (!strcmp(shape, now->shapes[i]) && block_of(line) == block_of(now->choices[i]))
            return 1;
    return 0;
}

/* Copies what stays. Lines may be of any length: only their head is looked at. */
static int copy_rest(FILE *from, FILE *to, const news *now)
{
    char part[HADA_TUNING_LINE];
    int first = 1, keep = 1, ended = 1;
    while (fgets(part, sizeof part, from)) {
        if (first)
            keep = !superseded(part, now);
        if (keep && fputs(part, to) < 0)
            return 0;
        first = strchr(part, '\n') != NULL;
        ended = keep ? first : ended;
    }
    return !ferror(from) && (ended || fputc('\n', to) != EOF);
}

static int write_rows(FILE *to, const news *now)
{
    int good = 1;
    for (size_t i = 0; good && i < now->count; i++)
        good = fprintf(to, "%s %s %s %s\n", now->operation, now->kind, now->shapes[i], now->choices[i]) > 0;
    return good;
}

static hada_status failed(const char *path, int code, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s; nothing was left behind", path,
                     strerror(code));
}

static hada_status write_beside(const char *beside, const char *path, const news *now, hada_error *err)
{
    FILE *old = fopen(path, "r");
    if (!old && errno != ENOENT)
        return hada_fail(err, HADA_ERROR_FILE_READ, "%s cannot be read, so it is not changed: %s", path,
                         strerror(errno));
    FILE *file = fopen(beside, "w");
    int good = file != NULL;
    if (good && !old)
        good = fprintf(file, "# Hadalens: which of several ways serves a shape (docs/devices.md)\n") > 0;
    if (good && old)
        good = copy_rest(old, file, now);
    good = good && write_rows(file, now);
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

hada_status hada_tuning_write(const hada_context *context, const char *path, const char *operation,
                              const char *const *shapes, const char *const *choices, size_t count, hada_error *err)
{
    const news now = {operation, hada_device_kind_name(context->info.kind), shapes, choices, count};
    struct stat info;
    if (!stat(path, &info) && !S_ISREG(info.st_mode))
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "%s is not an ordinary file: choose another name", path);
    const size_t bytes = strlen(path) + 48;
    char *beside;
    hada_status status = hada_alloc((void **)&beside, bytes, 1, "a file name", err);
    if (status)
        return status;
    snprintf(beside, bytes, "%s.tmp-%ld-%p", path, (long)getpid(), (const void *)&info);
    status = write_beside(beside, path, &now, err);
    free(beside);
    return status;
}
