/* Shorthand of tests of all kinds. */
#ifndef HADA_TESTS_HELPERS_H
#define HADA_TESTS_HELPERS_H

#include <hadalens/hadalens.h>
#include <stdlib.h>

/* Declares a struct of options that has its defaults. */
#define DEFAULTS(type, name)                                                                                           \
    type name;                                                                                                         \
    type##_init(&name)

/* Before a declaration: destroys the variables with type_destroy() where their scope ends, the last one first. They
 * need a value by then; a jump out of the scope before they have one is no good. */
#define SCOPED(type) __attribute__((cleanup(type##_destroy))) type

/* The same for pointers to what malloc() gave. */
#define SCOPED_MEMORY __attribute__((cleanup(helpers_free)))

static inline void helpers_free(void *pointer)
{
    free(*(void **)pointer);
}

/* Options of a fit with their defaults, for frames of rows x cols and a square window. */
static inline hada_fit_options helpers_fit(int depths, int channels, const double *distances_mm, int rows, int cols,
                                           int window)
{
    DEFAULTS(hada_fit_options, options);
    options.depths = depths;
    options.channels = channels;
    options.distances_mm = distances_mm;
    options.raw_rows = rows;
    options.raw_cols = cols;
    options.window_rows = options.window_cols = window;
    return options;
}

#endif
