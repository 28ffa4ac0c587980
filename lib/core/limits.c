#include <hadalens/limits.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "core/error.h"
#include "core/options.h"

static const struct {
    const char *name;
    size_t offset;
    uint64_t value;
} rows[] = {
    {"pixels", offsetof(hada_limits, pixels), 1u << 22}, /* 16 MiB of float; a fit from a PSF takes 18 times that */
    {"pages", offsetof(hada_limits, pages), 1u << 18},   /* two hours of frames at 30 a second */
    {"text", offsetof(hada_limits, text), 8u << 20},     /* OME-XML of some 30,000 planes */
    {"parameters", offsetof(hada_limits, parameters), 50000000}, /* three times VGG-16's convolutions */
};
enum { ROWS = sizeof rows / sizeof *rows };

static uint64_t *at(hada_limits *limits, int row)
{
    return (uint64_t *)(void *)((char *)limits + rows[row].offset);
}

void hada_limits_defaults(hada_limits *limits, size_t size)
{
    hada_limits own = {.size = sizeof own};
    for (int i = 0; i < ROWS; i++)
        *at(&own, i) = rows[i].value;
    HADA_OPTIONS_GIVE(limits, size, &own);
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

static int read_row(hada_limits *limits, const char **text)
{
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
    hada_limits own;
    hada_limits_init(&own);
    HADA_TRY(HADA_OPTIONS_TAKE(&own, limits, hada_limits, err));
    for (const char *from = text; *from; from += *from == ',')
        if (!read_row(&own, &from) || (*from && *from != ','))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "limits are a list such as pixels=4G,pages=1M,text=20M,parameters=1G; '%.100s' is not",
                             text);
    HADA_REPORT_GIVE(limits, &own);
    return HADA_OK;
}

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static hada_limits chosen; /* size 0: the environment's */

hada_status hada_limits_set(const hada_limits *limits, hada_error *err)
{
    hada_limits own = {0};
    if (limits) {
        hada_limits_init(&own);
        HADA_TRY(HADA_OPTIONS_TAKE(&own, limits, hada_limits, err));
    }
    pthread_mutex_lock(&lock);
    chosen = own;
    pthread_mutex_unlock(&lock);
    return HADA_OK;
}

hada_status hada_limits_get(hada_limits *limits, hada_error *err)
{
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
