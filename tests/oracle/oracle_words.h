/* What the oracles' programs share: words of the command line, raw doubles from standard input and to standard output.
 */
#ifndef HADA_ORACLE_WORDS_H
#define HADA_ORACLE_WORDS_H

#include <stdio.h>
#include <stdlib.h>

#include "core/base.h"

static char **words;

static void quit(const char *why)
{
    fprintf(stderr, "%s\n", why);
    exit(1);
}

static double number(void)
{
    if (!*words)
        quit("too few words");
    return strtod(*words++, NULL);
}

static int whole(void)
{
    return (int)number();
}

static double *room(size_t count)
{
    double *values = calloc(count + 1, sizeof *values);
    if (!values)
        quit("no memory");
    return values;
}

static double *take(size_t count)
{
    double *values = room(count);
    if (fread(values, sizeof *values, count, stdin) != count)
        quit("too little input");
    return values;
}

/* Values that are floats, as devices have them. */
static inline float *take_floats(size_t count)
{
    SCOPED_MEMORY double *values = take(count);
    float *floats = calloc(count + 1, sizeof *floats);
    if (!floats)
        quit("no memory");
    for (size_t i = 0; i < count; i++)
        floats[i] = (float)values[i];
    return floats;
}

static void give(const double *values, size_t count)
{
    if (fwrite(values, sizeof *values, count, stdout) != count)
        quit("cannot write");
}

static inline void check(hada_status status, const hada_error *error)
{
    if (status)
        quit(error->message);
}

#endif
