#include "core/callers.h"

#include <hadalens/limits.h>
#include <pthread.h>
#include <stdarg.h>

/* The size and one more member. */
#define LEAST_SIZE (2 * sizeof(size_t))
/* How much larger than this library's a newer caller's struct may be: a larger size is taken for memory that was never
 * set up. */
#define MOST_NEWER 4096

static int is_size(size_t size, size_t own_size)
{
    return size >= LEAST_SIZE && size % sizeof size == 0 && size <= own_size + MOST_NEWER;
}

hada_status hada_sized_check(const void *callers, size_t own_size, const char *type, hada_error *err)
{
    size_t size;
    if (!callers)
        return HADA_OK;
    memcpy(&size, callers, sizeof size);
    return is_size(size, own_size)
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_ARGUMENT, "a %s was not set up: set its size to sizeof(%s)", type, type);
}

hada_status hada_sized_take(void *own, size_t own_size, const void *callers, const char *type, hada_error *err)
{
    size_t size;
    if (!callers)
        return HADA_OK;
    memcpy(&size, callers, sizeof size);
    if (!is_size(size, own_size))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a %s was not set up: start from %s_init()", type, type);
    const unsigned char *bytes = callers;
    for (size_t i = own_size; i < size; i++)
        if (bytes[i])
            return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                             "a %s sets something that hadalens " HADALENS_VERSION
                             " does not know: update the library, or leave it as %s_init() sets it",
                             type, type);
    memcpy(own, callers, size < own_size ? size : own_size);
    memcpy(own, &own_size, sizeof own_size);
    return HADA_OK;
}

/* Whether a caller, perhaps an older one, gave that callback. */
#define HAS(monitor, callback)                                                                                         \
    ((monitor) && (monitor)->size >= offsetof(hada_monitor, callback) + sizeof((monitor)->callback) &&                 \
     (monitor)->callback)

hada_status hada_image_check(const hada_image *image, const hada_image *out, const char *function, const char *name,
                             hada_error *err)
{
    if (!image || !image->data || image->channels < 1 || image->rows < 1 || image->cols < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: %s is %s image", function, name,
                         !image                            ? "NULL, and no"
                         : image->data || !image->channels ? "an empty"
                                                           : "without data, and no");
    return image == out ? hada_fail(err, HADA_ERROR_ARGUMENT, "%s: %s and out are the same image", function, name)
                        : HADA_OK;
}

void hada_monitor_tell(const hada_monitor *monitor, hada_message kind, const char *format, ...)
{
    char text[1200];
    if (!HAS(monitor, message))
        return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    monitor->message(monitor->user, kind, text);
}

hada_status hada_monitor_check(const hada_monitor *monitor, hada_error *err)
{
    if (!HAS(monitor, cancelled) || !monitor->cancelled(monitor->user))
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_CANCELLED, "stopped; what was in progress was not finished");
}

static void tell(const hada_progress *progress, const char *what, const char *note)
{
    const hada_monitor *monitor = progress->monitor;
    if (HAS(monitor, progress))
        monitor->progress(monitor->user, what, progress->done, progress->total, note);
}

hada_progress hada_progress_begin(const hada_monitor *monitor, const char *what, long total)
{
    const hada_progress progress = {.monitor = monitor, .what = what, .total = total};
    tell(&progress, what, NULL);
    return progress;
}

hada_status hada_progress_step(hada_progress *progress, const char *note, hada_error *err)
{
    progress->done++;
    tell(progress, progress->what, note);
    return hada_monitor_check(progress->monitor, err);
}

void hada_progress_end(hada_progress *progress)
{
    tell(progress, NULL, NULL);
    *progress = (hada_progress){0};
}

hada_status hada_communicator_check(const hada_communicator *callers, hada_error *err)
{
    hada_communicator own;
    HADA_TRY(HADA_OPTIONS_TAKE(&own, callers, hada_communicator, err));
    if (own.count < 1 || own.rank < 0 || own.rank >= own.count)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "options.communicator: there is no rank %d of %d", own.rank,
                           own.count));
    if (own.count > 1 && (!own.reduce || !own.reduce_floats || !own.broadcast))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.communicator: several ranks need reduce, reduce_floats and broadcast"));
    return HADA_OK;
}

hada_status hada_reduce(const hada_communicator *of, double *values, size_t count, hada_error *err)
{
    return hada_ranks(of) > 1 && count ? of->reduce(of->user, values, count, err) : HADA_OK;
}

hada_status hada_reduce_floats(const hada_communicator *of, float *values, size_t count, hada_error *err)
{
    return hada_ranks(of) > 1 && count ? of->reduce_floats(of->user, values, count, err) : HADA_OK;
}

hada_status hada_broadcast(const hada_communicator *of, int root, void *bytes, size_t count, hada_error *err)
{
    return hada_ranks(of) > 1 && count ? of->broadcast(of->user, root, bytes, count, err) : HADA_OK;
}

static const struct {
    const char *name;
    size_t offset;
} rows[] = {{"pixels", offsetof(hada_limits, pixels)},
            {"pages", offsetof(hada_limits, pages)},
            {"text", offsetof(hada_limits, text)},
            {"parameters", offsetof(hada_limits, parameters)},
            {"seconds", offsetof(hada_limits, seconds)}};
enum { ROWS = sizeof rows / sizeof *rows };

static uint64_t *at(hada_limits *limits, int row)
{
    return (uint64_t *)(void *)((char *)limits + rows[row].offset);
}

/* "3", "20k", "4G": no signs, nothing that overflows. */
static int read_number(const char **text, uint64_t *value)
{
    static const char units[] = "kMG";
    const char *from = *text;
    uint64_t number = 0;
    for (; *from >= '0' && *from <= '9'; from++) {
        if (number > (UINT64_MAX - 9) / 10)
            return 0;
        number = number * 10 + (uint64_t)(*from - '0');
    }
    const char *unit = *from ? strchr(units, *from) : NULL;
    for (long i = unit ? unit - units + 1 : 0; i > 0; i--) {
        if (number > UINT64_MAX / 1000)
            return 0;
        number *= 1000;
    }
    const int any = from > *text && number;
    *text = from + (unit != NULL);
    *value = number;
    return any;
}

/* isolate=WORD */
static int read_isolate(hada_limits *limits, const char **text)
{
    static const char *const words[] = {
        [HADA_ISOLATE_NONE] = "none", [HADA_ISOLATE_SOME] = "some", [HADA_ISOLATE_ALL] = "all"};
    for (size_t i = 0; i < HADA_COUNT(words); i++)
        if (!strncmp(*text, words[i], strlen(words[i]))) {
            limits->isolate = i;
            *text += strlen(words[i]);
            return 1;
        }
    return 0;
}

static int read_row(hada_limits *limits, const char **text)
{
    static const char isolate[] = "isolate=";
    if (!strncmp(*text, isolate, sizeof isolate - 1)) {
        *text += sizeof isolate - 1;
        return read_isolate(limits, text);
    }
    for (int i = 0; i < ROWS; i++) {
        const size_t length = strlen(rows[i].name);
        if (strncmp(*text, rows[i].name, length) || (*text)[length] != '=')
            continue;
        *text += length + 1;
        return read_number(text, at(limits, i));
    }
    return 0;
}

hada_status hada_limits_parse(hada_limits *limits, const char *text, hada_error *err)
{
    HADA_NEED(limits && text, err);
    hada_limits own;
    HADA_TRY(HADA_OPTIONS_TAKE(&own, limits, hada_limits, err));
    for (const char *from = text; *from; from += *from == ',')
        if (!read_row(&own, &from) || (*from && *from != ','))
            return hada_fail(
                err, HADA_ERROR_ARGUMENT,
                "limits are a list such as pixels=4G,pages=1M,text=20M,parameters=1G,isolate=all,seconds=60; '%.100s' is "
                "not",
                text);
    HADA_REPORT_GIVE(limits, &own);
    return HADA_OK;
}

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static hada_limits chosen; /* size 0: the environment's */

hada_status hada_limits_set(const hada_limits *limits, hada_error *err)
{
    hada_limits own = {0};
    if (limits)
        HADA_TRY(HADA_OPTIONS_TAKE(&own, limits, hada_limits, err));
    if (own.isolate > HADA_ISOLATE_ALL)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.limits: isolate is none, some or all (0, 1, 2)");
    pthread_mutex_lock(&lock);
    chosen = own;
    pthread_mutex_unlock(&lock);
    return HADA_OK;
}

hada_status hada_limits_get(hada_limits *limits, hada_error *err)
{
    HADA_NEED(limits, err);
    const char *words = getenv("HADALENS_LIMITS");
    hada_limits own;
    hada_status status = HADA_OK;
    HADA_TRY(HADA_REPORT_CHECK(limits, hada_limits, err));
    pthread_mutex_lock(&lock);
    own = chosen;
    pthread_mutex_unlock(&lock);
    if (!own.size) {
        hada_limits_init(&own);
        status = words ? hada_limits_parse(&own, words, err) : HADA_OK;
        if (status) {
            hada_error_prefix(err, "HADALENS_LIMITS: ");
            return status;
        }
    }
    HADA_REPORT_GIVE(limits, &own);
    return status;
}
