/* Reading, searching and writing tuning files. */
#include "runtime/tuning.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "core/input.h"
#include "core/outfile.h"

static int word_among(const char *word, const char *const *words)
{
    for (int i = 0; words[i]; i++)
        if (!strcmp(word, words[i]))
            return i;
    return -1;
}

static int number(const char *text, char **end)
{
    if (*text < '0' || *text > '9')
        return -1;
    errno = 0;
    const long value = strtol(text, end, 10);
    return errno || value > 1 << 24 ? -1 : (int)value;
}

/* A shape is of the form NxN, or begins as one and ends with "*". */
static int is_shape(const char *shape)
{
    for (const char *form = "nxn"; *form; form++) {
        char *end;
        if (!strcmp(shape, "*"))
            return 1;
        if (*form == 'n') {
            if (number(shape, &end) < 1)
                return 0;
            shape = end;
        } else if (*shape++ != *form) {
            return 0;
        }
    }
    return !*shape;
}

/* NULL, or the error in a line. */
static const char *read_row(hada_tuning_row *row, char *line)
{
    static const char *const kinds[] = {"*", "cpu", "gpu", "accelerator", "other", NULL};
    static const char *const choices[] = {"own", "clfft", NULL};
    int used = 0;
    char operation[HADA_TUNING_WORD];
    if (sscanf(line, "%63s %63s %63s %63s %n", operation, row->kind, row->shape, row->choice, &used) != 4)
        return "is not OPERATION KIND SHAPE CHOICE";
    if (strcmp(operation, "fft"))
        return "is about an unknown operation: there is fft";
    if (word_among(row->kind, kinds) < 0)
        return "names a kind of device that there is not; there are cpu, gpu, accelerator and *";
    if (!is_shape(row->shape))
        return "has a shape of another form";
    if (word_among(row->choice, choices) < 0)
        return "names an unknown choice";
    return line[used] ? "has a word too many" : NULL;
}

static hada_status add(hada_tuning *tuning, const hada_tuning_row *row, hada_error *err)
{
    HADA_TRY(HADA_GROW(tuning->rows, tuning->count, 1, "the rows of a tuning file", err));
    tuning->rows[tuning->count++] = *row;
    return HADA_OK;
}

static hada_status read_lines(hada_tuning *tuning, const char *text, hada_error *err)
{
    char line[HADA_TUNING_LINE], shown[HADA_TUNING_LINE];
    for (int n = 1; *text; n++) {
        const char *wrong = NULL;
        const size_t length = strcspn(text, "\n"), first = strspn(text, " \t\r");
        hada_tuning_row row = {.line = n};
        snprintf(line, sizeof line, "%.*s", (int)(length < sizeof line ? length : sizeof line - 1), text);
        const int empty = first >= length || text[first] == '#'; /* remarks may be of any length */
        text += length + (text[length] == '\n');
        if (empty)
            continue;
        snprintf(shown, sizeof shown, "%.*s", (int)strcspn(line, "\r"), line);
        wrong = length >= sizeof line ? "is too long" : read_row(&row, line);
        HADA_TRY(wrong ? hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s, line %d %s: %s (docs/reference/devices.md)",
                                   tuning->path, n, wrong, shown)
                       : add(tuning, &row, err));
    }
    return HADA_OK;
}

hada_status hada_tuning_read(hada_tuning **out, const char *path, hada_error *err)
{
    hada_tuning *tuning = NULL;
    char *text = NULL;
    size_t bytes;
    int code = 0;
    *out = NULL;
    hada_status status = hada_input_read(&text, &bytes, path, HADA_TUNING_BYTES, &code, err);
    if (status && code == ENOENT)
        return HADA_OK;
    if (status) {
        hada_error_prefix(err, "the tuning file %s ", path);
        return status;
    }
    HADA_TRY_OR_DONE(HADA_NEW(tuning, 1, "a tuning file", err));
    tuning->path = hada_string_copy(path);
    if (!tuning->path)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for a tuning file"));
    if (strlen(text) != bytes)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_FORMAT, "the tuning file %s is no text", path));
    HADA_TRY_OR_DONE(read_lines(tuning, text, err));
    *out = tuning;
    tuning = NULL;
done:
    free(text);
    hada_tuning_destroy(&tuning);
    return status;
}

void hada_tuning_destroy(hada_tuning **pointer)
{
    hada_tuning *tuning = hada_taken(pointer);
    if (tuning)
        HADA_FREE(tuning->path, tuning->rows, tuning);
}

static int same_shape(const char *mine, const char *shape)
{
    const size_t n = strlen(mine);
    return n && mine[n - 1] == '*' ? !strncmp(mine, shape, n - 1) : !strcmp(mine, shape);
}

const hada_tuning_row *hada_tuning_find(const hada_context *context, const char *shape)
{
    const char *kind = hada_enum_name(HADA_ENUM_DEVICE_KIND, (int)context->info.kind);
    for (size_t i = context->tuning ? context->tuning->count : 0; i-- > 0;) {
        const hada_tuning_row *row = &context->tuning->rows[i];
        if ((!strcmp(row->kind, "*") || !strcmp(row->kind, kind)) && same_shape(row->shape, shape))
            return row;
    }
    return NULL;
}

/* Writing a tuning file: rows of other devices and shapes stay. */

typedef struct news {
    const char *kind;
    const char *const *shapes, *const *choices;
    size_t count;
} news;

/* Whether a line is about this operation and kind and one of these shapes, and nothing wider. */
static int superseded(const char *line, const news *now)
{
    char operation[HADA_TUNING_WORD], kind[HADA_TUNING_WORD], shape[HADA_TUNING_WORD];
    if (sscanf(line, " %63s %63s %63s", operation, kind, shape) != 3 || strcmp(operation, "fft") ||
        strcmp(kind, now->kind))
        return 0;
    for (size_t i = 0; i < now->count; i++)
        if (!strcmp(shape, now->shapes[i]))
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
        const char *const words[] = {"fft ", now->kind, " ", now->shapes[i], " ", now->choices[i], "\n"};
        for (size_t w = 0; w < sizeof words / sizeof *words; w++)
            HADA_TRY(put(to, words[w], err));
    }
    return HADA_OK;
}

/* Held from reading the old file until the new one is in place: two tuners at once must not lose each other's rows. The
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
    HADA_TRY_OR_DONE(
        old ? copy_rest(old, &file, now, err)
            : put(&file, "# Hadalens: the implementation for each shape (docs/reference/devices.md)\n", err));
    HADA_TRY_OR_DONE(write_rows(&file, now, err));
    HADA_TRY_OR_DONE(hada_outfile_commit(&file, err));
done:
    hada_outfile_abandon(&file);
    free(old);
    return status;
}

hada_status hada_tuning_write(const hada_context *context, const char *path, const char *const *shapes,
                              const char *const *choices, size_t count, hada_error *err)
{
    const news now = {hada_enum_name(HADA_ENUM_DEVICE_KIND, (int)context->info.kind), shapes, choices, count};
    const int lock = lock_folder(path);
    const hada_status status = write_new(path, &now, err);
    if (lock >= 0)
        close(lock); /* and unlocked */
    return status;
}
