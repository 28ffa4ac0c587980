#include "runtime/room.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

/* Parts begin at multiples of this where the device asks for less: whole vectors, cache lines and bursts. */
enum { LEAST_ALIGNMENT = 256 };

void hada_room_steps(hada_room *room, int first, int last)
{
    room->first = first;
    room->last = last;
}

hada_status hada_room_note(hada_room *room, size_t bytes, const char *what, hada_error *err)
{
    if (room->count == room->capacity) {
        hada_piece *more;
        const int capacity = room->capacity ? 2 * room->capacity : 32;
        hada_status status = hada_alloc((void **)&more, (size_t)capacity, sizeof *more, "a memory plan", err);
        if (status)
            return status;
        if (room->count)
            memcpy(more, room->pieces, (size_t)room->count * sizeof *more);
        free(room->pieces);
        room->pieces = more;
        room->capacity = capacity;
    }
    room->pieces[room->count++] =
        (hada_piece){.what = what, .bytes = bytes ? bytes : 4, .first = room->first, .last = room->last};
    return HADA_OK;
}

hada_status hada_room_plan(hada_room *room, const hada_context *context, hada_error *err)
{
    const size_t alignment =
        context->info.alignment_bytes > LEAST_ALIGNMENT ? context->info.alignment_bytes : LEAST_ALIGNMENT;
    const uint64_t largest = context->info.max_allocation_bytes;
    hada_arenas_free(&room->arenas);
    return hada_lifetimes_plan(room->pieces, room->count, alignment, largest < SIZE_MAX ? (size_t)largest : SIZE_MAX,
                               &room->arenas, err);
}

uint64_t hada_room_bytes(const hada_room *room)
{
    uint64_t bytes = 0;
    for (int i = 0; i < room->arenas.count; i++)
        bytes += room->arenas.bytes[i];
    return bytes;
}

uint64_t hada_room_noted(const hada_room *room)
{
    uint64_t bytes = 0;
    for (int i = 0; i < room->count; i++)
        bytes += room->pieces[i].bytes;
    return bytes;
}

hada_status hada_room_make(hada_room *room, hada_context *context, hada_error *err)
{
    hada_status status =
        hada_alloc((void **)&room->buffers, (size_t)room->arenas.count, sizeof *room->buffers, "a memory plan", err);
    for (int i = 0; !status && i < room->arenas.count; i++)
        status = hada_buffer_create(&room->buffers[i], context, room->arenas.bytes[i], "the working memory", err);
    return status;
}

void hada_room_free(hada_room *room)
{
    for (int i = 0; room->buffers && i < room->arenas.count; i++)
        hada_buffer_destroy(&room->buffers[i]);
    free(room->buffers);
    free(room->pieces);
    hada_arenas_free(&room->arenas);
    *room = (hada_room){0};
}

hada_status hada_scratch_create(hada_buffer *buffer, hada_slot *slot, size_t bytes, const char *what, hada_error *err)
{
    hada_room *room = slot->room;
    if (!room)
        return hada_buffer_create(buffer, slot->context, bytes, what, err);
    *buffer = (hada_buffer){0};
    const hada_piece *piece = room->next < room->count ? &room->pieces[room->next] : NULL;
    if (!piece || piece->bytes != (bytes ? bytes : 4))
        return hada_fail(err, HADA_ERROR_STATE, "%s of %zu bytes was not planned in this order", what, bytes);
    room->next++;
    return hada_buffer_part(buffer, &room->buffers[piece->arena], piece->offset, piece->bytes, what, err);
}
