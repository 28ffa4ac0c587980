#include "runtime/scratch.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

/* Parts begin at multiples of this where the device asks for less: whole vectors, cache lines and bursts. */
enum { LEAST_ALIGNMENT = 256 };

void hada_scratch_steps(hada_scratch *scratch, int first, int last)
{
    scratch->first = first;
    scratch->last = last;
}

hada_status hada_scratch_note(hada_scratch *scratch, size_t bytes, const char *what, hada_error *err)
{
    if (scratch->count == scratch->capacity) {
        hada_piece *more;
        const int capacity = scratch->capacity ? 2 * scratch->capacity : 32;
        hada_status status = hada_allocated(more = hada_alloc((size_t)capacity, sizeof *more, "a memory plan", err));
        if (status)
            return status;
        if (scratch->count)
            memcpy(more, scratch->pieces, (size_t)scratch->count * sizeof *more);
        free(scratch->pieces);
        scratch->pieces = more;
        scratch->capacity = capacity;
    }
    scratch->pieces[scratch->count++] =
        (hada_piece){.what = what, .bytes = bytes ? bytes : 4, .first = scratch->first, .last = scratch->last};
    return HADA_OK;
}

hada_status hada_scratch_plan(hada_scratch *scratch, const hada_context *context, hada_error *err)
{
    const size_t alignment =
        context->info.alignment_bytes > LEAST_ALIGNMENT ? context->info.alignment_bytes : LEAST_ALIGNMENT;
    const uint64_t largest = context->info.max_allocation_bytes;
    hada_arenas_free(&scratch->arenas);
    return hada_lifetimes_plan(scratch->pieces, scratch->count, alignment,
                               largest < SIZE_MAX ? (size_t)largest : SIZE_MAX, &scratch->arenas, err);
}

uint64_t hada_scratch_bytes(const hada_scratch *scratch)
{
    uint64_t bytes = 0;
    for (int i = 0; i < scratch->arenas.count; i++)
        bytes += scratch->arenas.bytes[i];
    return bytes;
}

uint64_t hada_scratch_noted(const hada_scratch *scratch)
{
    uint64_t bytes = 0;
    for (int i = 0; i < scratch->count; i++)
        bytes += scratch->pieces[i].bytes;
    return bytes;
}

hada_status hada_scratch_make(hada_scratch *scratch, hada_context *context, hada_error *err)
{
    const int count = scratch->arenas.count;
    HADA_TRY(
        hada_allocated(scratch->buffers = hada_alloc((size_t)count, sizeof *scratch->buffers, "a memory plan", err)));
    for (int i = 0; i < count; i++)
        HADA_TRY(
            hada_buffer_create(&scratch->buffers[i], context, scratch->arenas.bytes[i], "the working memory", err));
    return HADA_OK;
}

void hada_scratch_free(hada_scratch *scratch)
{
    for (int i = 0; scratch->buffers && i < scratch->arenas.count; i++)
        hada_buffer_destroy(&scratch->buffers[i]);
    free(scratch->buffers);
    free(scratch->pieces);
    hada_arenas_free(&scratch->arenas);
    *scratch = (hada_scratch){0};
}

hada_status hada_scratch_take(hada_buffer *buffer, hada_context *context, hada_scratch *scratch, size_t bytes,
                              const char *what, hada_error *err)
{
    if (!scratch)
        return hada_buffer_create(buffer, context, bytes, what, err);
    *buffer = (hada_buffer){0};
    const hada_piece *piece = scratch->next < scratch->count ? &scratch->pieces[scratch->next] : NULL;
    if (!piece || piece->bytes != (bytes ? bytes : 4))
        return hada_fail(err, HADA_ERROR_STATE, "%s of %zu bytes was not planned in this order", what, bytes);
    scratch->next++;
    return hada_buffer_part(buffer, &scratch->buffers[piece->arena], piece->offset, piece->bytes, what, err);
}

hada_buffer *hada_buffer_of(void *object, const hada_buffer_row *row)
{
    return (hada_buffer *)(void *)((char *)object + row->offset);
}

size_t hada_buffer_rows_bytes(const hada_buffer_row *rows, int count)
{
    size_t bytes = 0;
    for (int i = 0; i < count; i++)
        bytes += rows[i].bytes;
    return bytes;
}

hada_status hada_buffer_rows_take(void *object, hada_context *context, hada_scratch *scratch,
                                  const hada_buffer_row *rows, int count, hada_error *err)
{
    for (int i = 0; i < count; i++)
        if (rows[i].bytes)
            HADA_TRY(hada_scratch_take(hada_buffer_of(object, &rows[i]), context, scratch, rows[i].bytes, rows[i].what,
                                       err));
    return HADA_OK;
}

void hada_buffer_rows_destroy(void *object, const hada_buffer_row *rows, int count)
{
    for (int i = 0; i < count; i++)
        hada_buffer_destroy(hada_buffer_of(object, &rows[i]));
}
