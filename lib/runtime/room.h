/* A room: scratch of modules that work one after the other, in the same memory. Internal.
 *
 * First every module notes the pieces that it will ask for, with the steps in which it needs them; then the room is
 * planned (lifetimes.h) and its bytes are known; then it is made, and modules that are created on a slot with that room
 * get their scratch as parts of its buffers. They must ask in the order in which they noted. */
#ifndef HADA_RUNTIME_ROOM_H
#define HADA_RUNTIME_ROOM_H

#include "runtime/lifetimes.h"

typedef struct hada_room {
    int first, last; /* steps of the pieces that are noted now */
    hada_piece *pieces;
    int count, capacity;
    int next; /* piece to be handed out */
    hada_arenas arenas;
    hada_buffer *buffers; /* one for each arena, once the room is made */
} hada_room;

/* The steps in which the pieces noted from now on are needed, both included. */
void hada_room_steps(hada_room *room, int first, int last);
hada_status hada_room_note(hada_room *room, size_t bytes, const char *what, hada_error *err);

/* Gives every piece its place. */
hada_status hada_room_plan(hada_room *room, const hada_context *context, hada_error *err);
uint64_t hada_room_bytes(const hada_room *room); /* that the planned room holds */
uint64_t hada_room_noted(const hada_room *room); /* that the pieces would hold apart */

/* Allocates what was planned. */
hada_status hada_room_make(hada_room *room, hada_context *context, hada_error *err);
void hada_room_free(hada_room *room); /* parts that are in use keep their memory until they are destroyed */

/* Scratch: a part of the slot's room where it has one, else a buffer of its own. */
hada_status hada_scratch_create(hada_buffer *buffer, hada_slot *slot, size_t bytes, const char *what, hada_error *err);

#endif
