#include "core/base.h"

size_t hada_size_product(size_t count, size_t size)
{
    return size && count > SIZE_MAX / size ? SIZE_MAX : count * size;
}

static void *no_memory(size_t bytes, const char *what, hada_error *err)
{
    hada_fail(err, HADA_ERROR_MEMORY, "no memory for %s (%.1f MiB); close other programs or work on smaller frames",
              what, (double)bytes / (1024.0 * 1024.0));
    return NULL;
}

void *hada_alloc(size_t count, size_t size, const char *what, hada_error *err)
{
    const size_t bytes = hada_size_product(count, size);
    void *out = bytes > SIZE_MAX / 2 ? NULL : calloc(bytes ? bytes : 1, 1);
    return out ? out : no_memory(bytes, what, err);
}

void *hada_alloc_raw(size_t count, size_t size, const char *what, hada_error *err)
{
    const size_t bytes = hada_size_product(count, size);
    void *out = NULL;
    if (bytes <= SIZE_MAX / 2) {
        const size_t whole = (bytes + 63) / 64 * 64;
        out = aligned_alloc(64, whole ? whole : 64);
    }
    return out ? out : no_memory(bytes, what, err);
}

char *hada_string_copy(const char *text)
{
    size_t bytes = strlen(text) + 1;
    char *copy = malloc(bytes);
    if (copy)
        memcpy(copy, text, bytes);
    return copy;
}

void hada_free_each(void *const *pointers, size_t count)
{
    for (size_t i = 0; i < count; i++)
        free(pointers[i]);
}
