/* Host memory with overflow checks and error messages. Internal. */
#ifndef HADA_CORE_ALLOC_H
#define HADA_CORE_ALLOC_H

#include <stddef.h>

#include "core/error.h"

/* count*size zeroed bytes (at least one byte), to be freed with free(). NULL on failure, and then the message says how
 * much was asked for and what for (`what`, such as "the raw frame"). */
void *hada_alloc(size_t count, size_t size, const char *what, hada_error *err);

/* As hada_alloc, aligned to 64 bytes and not zeroed: for large arrays that are written at once. */
void *hada_alloc_raw(size_t count, size_t size, const char *what, hada_error *err);

/* The status of an allocation: HADA_TRY(hada_allocated(pointer = hada_alloc(...))). */
static inline hada_status hada_allocated(const void *pointer)
{
    return pointer ? HADA_OK : HADA_ERROR_MEMORY;
}

/* A copy of a string, NULL when memory is short. */
char *hada_string_copy(const char *text);

/* count*size, or SIZE_MAX where that overflows. */
size_t hada_size_product(size_t count, size_t size);

#define HADA_COUNT(array) (sizeof(array) / sizeof *(array))

/* How many parts of `part` it takes to hold n. */
static inline size_t hada_divide_up(size_t n, size_t part)
{
    return (n + part - 1) / part;
}

/* n rounded up to a multiple of `part`. */
static inline size_t hada_round_up(size_t n, size_t part)
{
    return hada_divide_up(n, part) * part;
}

#endif
