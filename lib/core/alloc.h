/* Host memory: overflow-checked, with a status instead of a NULL to forget. Internal. */
#ifndef HADA_CORE_ALLOC_H
#define HADA_CORE_ALLOC_H

#include <stddef.h>

#include "core/error.h"

/* Sets *out to count*size zeroed bytes (at least one byte), to be freed with free(). On failure *out is
 * NULL and the message says how much was asked for and what for (`what`, such as "the raw frame"). */
hada_status hada_alloc(void **out, size_t count, size_t size, const char *what, hada_error *err);

/* As hada_alloc, aligned to 64 bytes and not zeroed: for large arrays that are written at once. */
hada_status hada_alloc_raw(void **out, size_t count, size_t size, const char *what, hada_error *err);

/* A copy of a string, NULL when memory is short. */
char *hada_string_copy(const char *text);

/* count*size, or SIZE_MAX where that overflows. */
size_t hada_size_product(size_t count, size_t size);

#endif
