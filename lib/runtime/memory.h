/* One list of memory: the code that makes an object also says how much device memory it takes. Internal.
 *
 * With a dry context nothing is allocated on the device, compiled, sent, launched or waited for. Buffers stay empty,
 * but count in the books of the context: hada_context_bytes() after a dry create is what the object holds, and
 * hada_context_peak_bytes() what it took at most while it was made. Code that would read results, or fill large tables,
 * asks for context->dry and returns early.
 *
 * Buffers that need not keep their content from one run to the next may share memory with those of other steps. They
 * come from a slot's scratch: a dry run lists them with the steps in which they are in use, a plan gives them places,
 * and a second run, which makes the same objects in the same order, takes the places. A slot without scratch gives each
 * of them a buffer of its own. */
#ifndef HADA_RUNTIME_MEMORY_H
#define HADA_RUNTIME_MEMORY_H

#include "runtime/buffer.h"

/* A dry context for the device of another one, which must outlive it, and a slot of it. Objects made with them are
 * destroyed before it ends; it must not be copied. */
typedef struct hada_dry {
    hada_context context;
    hada_slot slot;
} hada_dry;
void hada_dry_begin(hada_dry *dry, const hada_context *of);
void hada_dry_end(hada_dry *dry);

/* Work runs in steps 0, 1, 2, ... on one in-order queue. A piece of memory is in use from its first to its last step,
 * both included; pieces whose steps do not overlap may share a place. */
typedef struct hada_piece {
    const char *what; /* for messages */
    size_t bytes;
    int first, last; /* steps */
    int arena;       /* out: which buffer */
    size_t offset;   /* out: bytes into it, aligned as sub-buffers need it */
} hada_piece;

typedef struct hada_arenas {
    int count;
    size_t *bytes; /* of each buffer; hada_arenas_free() */
} hada_arenas;

/* Gives every piece a place: largest first, each at the lowest place that is free during its steps. No buffer becomes
 * larger than `largest` (the device's largest allocation). HADA_ERROR_DEVICE_MEMORY where one piece alone is. */
hada_status hada_lifetimes_plan(hada_piece *pieces, int count, size_t alignment, size_t largest, hada_arenas *arenas,
                                hada_error *err);
void hada_arenas_free(hada_arenas *arenas);

/* Memory that the objects of a slot share: slot->scratch. */
struct hada_scratch {
    int first, last, result_last; /* steps of the buffers that are asked for now */
    hada_piece *pieces;
    int count;
    int next; /* piece to be handed out */
    hada_arenas arenas;
    hada_buffer *buffers; /* one for each arena, once the memory is made */
};

/* The steps in which buffers asked for from now on are in use, both included; results up to another step. Nothing where
 * scratch is NULL. */
void hada_scratch_steps(hada_scratch *scratch, int first, int last, int result_last);

/* Gives every piece listed in a dry run its place. */
hada_status hada_scratch_plan(hada_scratch *scratch, const hada_context *context, hada_error *err);
uint64_t hada_scratch_bytes(const hada_scratch *scratch); /* of the planned memory */
uint64_t hada_scratch_apart(const hada_scratch *scratch); /* that the pieces would take apart */

/* Allocates what was planned. */
hada_status hada_scratch_make(hada_scratch *scratch, hada_context *context, hada_error *err);
void hada_scratch_free(hada_scratch *scratch); /* parts that are in use keep their memory until they are destroyed */

/* What a buffer of an object holds: results, which others read in later steps; what only the object's own steps need;
 * what stays from run to run. */
typedef enum hada_lifetime { HADA_OWN_STEPS = 0, HADA_RESULT = 1, HADA_LASTING = 2 } hada_lifetime;

/* A buffer of the slot's scratch; one of its own for what lasts, or where the slot has no scratch. */
hada_status hada_buffer_take(hada_buffer *buffer, hada_slot *slot, hada_lifetime lifetime, size_t bytes,
                             const char *what, hada_error *err);

/* A buffer of an object that has several: where it is in the object, its bytes (0: there is none), what it holds, for
 * how long. */
typedef struct hada_buffer_row {
    size_t offset, bytes;
    const char *what;
    hada_lifetime lifetime;
} hada_buffer_row;

hada_buffer *hada_buffer_of(void *object, const hada_buffer_row *row);
/* hada_buffer_take() for each row in turn; after a failure hada_buffer_rows_destroy() frees those that were taken. */
hada_status hada_buffer_rows_take(void *object, hada_slot *slot, const hada_buffer_row *rows, int count,
                                  hada_error *err);
void hada_buffer_rows_destroy(void *object, const hada_buffer_row *rows, int count);

#endif
