/* Counts. Internal. */
#ifndef HADA_CORE_ROUND_H
#define HADA_CORE_ROUND_H

#include <stddef.h>

#define HADA_COUNT(array) (sizeof(array) / sizeof *(array))

/* How many parts of `part` it takes to hold n. */
static inline size_t hada_divide_up(size_t n, size_t part)
{
    return (n + part - 1) / part;
}

/* The next multiple of `part`, n itself where it is one. */
static inline size_t hada_round_up(size_t n, size_t part)
{
    return hada_divide_up(n, part) * part;
}

#endif
