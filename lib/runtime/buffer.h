/* Device memory with books: every buffer of a context is counted, so that a plan's stated bytes can be held. Internal.
 *
 * On CPU devices buffers lie in 2 MiB-aligned host memory with huge pages where the system gives them: large
 * transforms run up to 1.6 times faster. */
#ifndef HADA_RUNTIME_BUFFER_H
#define HADA_RUNTIME_BUFFER_H

#include "runtime/slot.h"

/* Device memory by the type of its elements, as launches take it (launch.h). Most arrays hold floats, so a plain cl_mem
 * is one of floats. For other elements it is the same handle as a pointer of another type, so that the compiler refuses
 * one for the other. */
typedef struct hada_ints_memory *hada_ints;
typedef struct hada_bytes_memory *hada_bytes;
typedef struct hada_halves_memory *hada_halves;

typedef struct hada_buffer {
    hada_context *context;
    union { /* the same handle, by what the buffer holds; NULL on a dry context (runtime/memory.h) */
        cl_mem mem;
        hada_ints ints;
        hada_bytes octets;
        hada_halves halves;
    };
    size_t bytes;
    int part; /* 1: a part of another buffer, which is counted */
} hada_buffer;

/* Allocates (uninitialised) and counts. `what` names it in messages ("the filters"). *buffer is zeroed on failure.
 * A buffer larger than the device's largest allocation is refused with a message that says so. */
hada_status hada_buffer_create(hada_buffer *buffer, hada_context *context, size_t bytes, const char *what,
                               hada_error *err);

/* As hada_buffer_create, with the given content. */
hada_status hada_buffer_create_from(hada_buffer *buffer, hada_slot *slot, const void *data, size_t bytes,
                                    const char *what, hada_error *err);

/* A part of another buffer, which it keeps alive; `offset` is aligned as the device needs it. */
hada_status hada_buffer_part(hada_buffer *part, const hada_buffer *whole, size_t offset, size_t bytes, const char *what,
                             hada_error *err);

/* Frees; an empty buffer is fine. Commands that still use it keep its memory until they are done, as they may after a
 * failure in their midst. */
void hada_buffer_destroy(hada_buffer *buffer);
/* Frees each of some buffers: HADA_DESTROY_BUFFERS(&frame, &sums). */
#define HADA_DESTROY_BUFFERS(...)                                                                                      \
    hada_buffers_destroy((hada_buffer *[]){__VA_ARGS__}, HADA_COUNT(((hada_buffer *[]){__VA_ARGS__})))
void hada_buffers_destroy(hada_buffer *const *buffers, size_t count);

/* Blocking transfers on the compute queue (in order with the kernels). */
hada_status hada_buffer_write(hada_buffer *buffer, hada_slot *slot, size_t offset, const void *data, size_t bytes,
                              hada_error *err);
hada_status hada_buffer_read(const hada_buffer *buffer, hada_slot *slot, size_t offset, void *data, size_t bytes,
                             hada_error *err);

/* A read that is enqueued, not waited for: hada_slot_finish() says that it is done, and until then `data` stays. */
hada_status hada_buffer_read_later(const hada_buffer *buffer, hada_slot *slot, size_t offset, void *data, size_t bytes,
                                   hada_error *err);
/* One that can be waited for by itself: the data are there once *event, which is the caller's to release, is complete.
 */
hada_status hada_buffer_read_event(const hada_buffer *buffer, hada_slot *slot, size_t offset, void *data, size_t bytes,
                                   cl_event *event, hada_error *err);
/* The same for a write: `data` stays as it is until a later call waited for the slot. */
hada_status hada_buffer_write_later(hada_buffer *buffer, hada_slot *slot, size_t offset, const void *data, size_t bytes,
                                    hada_error *err);

/* The whole buffer as memory of the host, to read and write, until it is unmapped (enqueued); waits for what is in the
 * queue. On devices whose memory is the host's nothing is copied. */
hada_status hada_buffer_map(const hada_buffer *buffer, hada_slot *slot, void **data, hada_error *err);
hada_status hada_buffer_unmap(const hada_buffer *buffer, hada_slot *slot, void *data, hada_error *err);

/* From one place on the device to another (enqueued); offsets and sizes in bytes. */
hada_status hada_buffer_copy(hada_slot *slot, cl_mem from, size_t from_offset, cl_mem to, size_t to_offset,
                             size_t bytes, hada_error *err);

/* Fills `count` floats with one value (enqueued); `offset` in bytes. */
hada_status hada_buffer_fill(hada_slot *slot, cl_mem mem, size_t offset, float value, size_t count, hada_error *err);

/* Fills with zero bytes (enqueued). */
hada_status hada_buffer_clear(hada_buffer *buffer, hada_slot *slot, size_t offset, size_t bytes, hada_error *err);

#endif
