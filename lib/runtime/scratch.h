/* Scratch memory of modules that work one after the other, in the same place. Internal.
 *
 * First every module notes the pieces that it will ask for, with the steps in which it needs them; then they are given
 * places (lifetimes.h) and the bytes are known; then the memory is made, and modules that are created with it take
 * their pieces as parts of its buffers, in the order in which they noted them. A module created without takes buffers
 * of its own. */
#ifndef HADA_RUNTIME_SCRATCH_H
#define HADA_RUNTIME_SCRATCH_H

#include "runtime/lifetimes.h"

typedef struct hada_scratch {
    int first, last; /* steps of the pieces that are noted now */
    hada_piece *pieces;
    int count, capacity;
    int next; /* piece to be handed out */
    hada_arenas arenas;
    hada_buffer *buffers; /* one for each arena, once the memory is made */
} hada_scratch;

/* The steps in which the pieces noted from now on are needed, both included. */
void hada_scratch_steps(hada_scratch *scratch, int first, int last);
hada_status hada_scratch_note(hada_scratch *scratch, size_t bytes, const char *what, hada_error *err);

/* Gives every piece its place. */
hada_status hada_scratch_plan(hada_scratch *scratch, const hada_context *context, hada_error *err);
uint64_t hada_scratch_bytes(const hada_scratch *scratch); /* that the planned memory takes */
uint64_t hada_scratch_noted(const hada_scratch *scratch); /* that the pieces would take apart */

/* Allocates what was planned. */
hada_status hada_scratch_make(hada_scratch *scratch, hada_context *context, hada_error *err);
void hada_scratch_free(hada_scratch *scratch); /* parts that are in use keep their memory until they are destroyed */

/* The next piece, of so many bytes. `scratch` NULL: a buffer of its own. */
hada_status hada_scratch_take(hada_buffer *buffer, hada_context *context, hada_scratch *scratch, size_t bytes,
                              const char *what, hada_error *err);

/* A buffer of an object that has several: where it stands there, its bytes (0: there is none), what it holds. One list
 * serves the plan of the memory, the allocation and the end. */
typedef struct hada_buffer_row {
    size_t offset, bytes;
    const char *what;
} hada_buffer_row;

hada_buffer *hada_buffer_of(void *object, const hada_buffer_row *row);
size_t hada_buffer_rows_bytes(const hada_buffer_row *rows, int count);
/* As hada_scratch_take(), one after the other; what a failure leaves is for hada_buffer_rows_destroy(). */
hada_status hada_buffer_rows_take(void *object, hada_context *context, hada_scratch *scratch,
                                  const hada_buffer_row *rows, int count, hada_error *err);
void hada_buffer_rows_destroy(void *object, const hada_buffer_row *rows, int count);

#endif
