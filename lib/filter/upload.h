/* A frame's way up to a device with memory of its own: as few bytes as give the same floats, from memory that the
 * device reads by itself while the host goes on. Internal. */
#ifndef HADA_FILTER_UPLOAD_H
#define HADA_FILTER_UPLOAD_H

#include "image/stored.h"
#include "runtime/buffer.h"

typedef struct hada_upload {
    hada_slot *slot;
    cl_mem pinned; /* the driver's own memory of the host, which nothing is paged out of; NULL: there is none */
    void *staged;  /* the same, mapped */
    size_t values;
    hada_stored stored; /* how the frame before was */
    uint64_t waits;     /* of the slot, when the last frame was sent from there; 0: none was */
} hada_upload;

/* For frames of `values` floats. Nothing is made where the device works in the host's memory: hada_upload_stages(). */
hada_status hada_upload_make(hada_upload *upload, hada_slot *slot, size_t values, hada_error *err);
void hada_upload_free(hada_upload *upload); /* the slot's queue is done with it */

static inline int hada_upload_stages(const hada_upload *upload)
{
    return upload->staged != NULL;
}

/* The floats of a frame into `raw`, by way of `between`, a buffer of at least half its size that is free until then.
 * `frame` is read before it returns; the rest is enqueued. Waits where the frame before may still be on its way. */
hada_status hada_upload_frame(hada_upload *upload, const float *frame, hada_buffer *raw, hada_buffer *between,
                              hada_error *err);

/* What that comes to on the device: numbers as upload->stored says, to floats (enqueued). */
hada_status hada_upload_unpack(const hada_upload *upload, hada_bytes between, cl_mem raw, hada_error *err);

#endif
