/* Hadalens: budgets for files that come from elsewhere. A small file can claim to be a large picture or a large net;
 * what it claims beyond these budgets is refused before memory or time is spent, with a message that names the budget
 * ("options.limits pixels=N": hada_limits_set()).
 *
 * Thread-safe. Source: docs/reference/security.md. */
#ifndef HADALENS_LIMITS_H
#define HADALENS_LIMITS_H

#include <hadalens/status.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The defaults, and the text that says the same. */
#define HADA_LIMITS_PIXELS        4194304
#define HADA_LIMITS_PAGES         262144
#define HADA_LIMITS_TEXT          8388608
#define HADA_LIMITS_PARAMETERS    50000000
#define HADA_LIMITS_SECONDS       60
#define HADA_LIMITS_WORD_(number) #number
#define HADA_LIMITS_WORD(number)  HADA_LIMITS_WORD_(number)
#define HADA_LIMITS_DEFAULTS                                                                                                \
    "pixels=" HADA_LIMITS_WORD(HADA_LIMITS_PIXELS) ",pages=" HADA_LIMITS_WORD(HADA_LIMITS_PAGES) ",text=" HADA_LIMITS_WORD( \
        HADA_LIMITS_TEXT) ",parameters=" HADA_LIMITS_WORD(HADA_LIMITS_PARAMETERS)
#define HADA_LIMITS_READER_DEFAULTS "isolate=some,seconds=" HADA_LIMITS_WORD(HADA_LIMITS_SECONDS)

/* Which pictures are decoded in a process of their own, which has no rights to files and networks (Linux). */
typedef enum hada_isolate {
    HADA_ISOLATE_NONE = 0, /* none: all are decoded in this process */
    HADA_ISOLATE_SOME = 1, /* MATLAB 7.3 files, whose library may crash on damaged ones, if the reader's program is
                              installed and the kernel can do it; the default */
    HADA_ISOLATE_ALL = 2   /* TIFF, PNG, JPEG, NumPy, MATLAB and raw files; where it cannot be done, an error */
} hada_isolate;

typedef struct hada_limits {
    size_t size;         /* sizeof(hada_limits) */
    uint64_t pixels;     /* numbers (pixels times samples) of a page and of the piece of it that is read at once; a file
                            may always hold 64 for each of its bytes; a camera file's sensor, eight times as many */
    uint64_t pages;      /* pages of a TIFF file */
    uint64_t text;       /* bytes of a text: TIFF descriptions, headers of safetensors files, lists of layers */
    uint64_t parameters; /* numbers of a net that is described without its weights */
    uint64_t isolate;    /* hada_isolate */
    uint64_t seconds;    /* for opening a file and for each frame, in a process of its own */
} hada_limits;
HADA_INIT(hada_limits, HADA_STRUCT_LIMITS)

/* Changes what a text such as "pixels=4G,pages=1M,isolate=all" names; k, M, G are thousand, million, milliard; isolate
 * is none, some or all. HADA_ERROR_ARGUMENT where it is not understood. */
HADA_API hada_status hada_limits_parse(hada_limits *limits, const char *text, hada_error *err);

/* Sets the budgets of this process; NULL: back to the environment's. */
HADA_API hada_status hada_limits_set(const hada_limits *limits, hada_error *err);

/* The budgets in force: those that were set, else the defaults as the environment variable HADALENS_LIMITS changes them
 * (HADA_ERROR_ARGUMENT where it is not understood). */
HADA_API hada_status hada_limits_get(hada_limits *limits, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
