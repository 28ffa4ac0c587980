/* Writing a tuning file: what it says of other devices and shapes stays. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "core/input.h"
#include "core/outfile.h"
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

static hada_status put(hada_outfile *to, const char *text, hada_error *err)
{
    return hada_outfile_write(to, text, strlen(text), err);
}

/* Copies what stays of a file's text. */
static hada_status copy_rest(const char *text, hada_outfile *to, const news *now, hada_error *err)
{
    while (*text) {
        char head[HADA_TUNING_LINE];
        const size_t length = strcspn(text, "\n");
        snprintf(head, sizeof head, "%.*s", (int)(length < sizeof head ? length : sizeof head - 1), text);
        if (!superseded(head, now)) {
            HADA_TRY(hada_outfile_write(to, text, length, err));
            HADA_TRY(put(to, "\n", err));
        }
        text += length + (text[length] == '\n');
    }
    return HADA_OK;
}

static hada_status write_rows(hada_outfile *to, const news *now, hada_error *err)
{
    for (size_t i = 0; i < now->count; i++) {
        const char *const words[] = {now->operation, " ", now->kind, " ", now->shapes[i], " ", now->choices[i], "\n"};
        for (size_t w = 0; w < sizeof words / sizeof *words; w++)
            HADA_TRY(put(to, words[w], err));
    }
    return HADA_OK;
}

/* Held from reading the old file until the new one stands: two tuners at once must not lose each other's rows. The
 * folder is locked, since the file is replaced. -1 where the file system has no locks: then there is none. */
static int lock_folder(const char *path)
{
    const char *slash = strrchr(path, '/');
    char *folder = slash ? strndup(path, slash == path ? 1 : (size_t)(slash - path)) : strdup(".");
    const int fd = folder ? open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    while (fd >= 0 && flock(fd, LOCK_EX) && errno == EINTR)
        ;
    free(folder);
    return fd;
}

static hada_status write_new(const char *path, const news *now, hada_error *err)
{
    hada_outfile file = {.fd = -1};
    char *old = NULL;
    size_t bytes;
    int code = 0;
    hada_status status = hada_input_read(&old, &bytes, path, HADA_TUNING_BYTES, &code, err);
    if (status && code != ENOENT) {
        hada_error_prefix(err, "%s is not changed: ", path);
        goto done;
    }
    HADA_TRY_OR_DONE(hada_outfile_open(&file, path, err));
    HADA_TRY_OR_DONE(old ? copy_rest(old, &file, now, err)
                         : put(&file, "# Hadalens: which of several ways serves a shape (docs/devices.md)\n", err));
    HADA_TRY_OR_DONE(write_rows(&file, now, err));
    HADA_TRY_OR_DONE(hada_outfile_commit(&file, err));
done:
    hada_outfile_abandon(&file);
    free(old);
    return status;
}

hada_status hada_tuning_write(const hada_context *context, const char *path, const char *operation,
                              const char *const *shapes, const char *const *choices, size_t count, hada_error *err)
{
    const news now = {operation, hada_device_kind_name(context->info.kind), shapes, choices, count};
    const int lock = lock_folder(path);
    const hada_status status = write_new(path, &now, err);
    if (lock >= 0)
        close(lock); /* and unlocked */
    return status;
}
