#include "core/options.h"

#include <string.h>

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

void hada_sized_give(void *callers, size_t size, const void *own, size_t own_size)
{
    const size_t known = size < own_size ? size : own_size;
    if (known < sizeof size)
        return;
    memcpy(callers, own, known);
    memset((unsigned char *)callers + known, 0, size - known);
    memcpy(callers, &size, sizeof size);
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
