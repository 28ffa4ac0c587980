/* A frame's way to the device: its samples in the form in which they came, made floats there. Internal. */
#ifndef HADA_FILTER_UPLOAD_H
#define HADA_FILTER_UPLOAD_H

#include "image/pixels.h"
#include "runtime/buffer.h"

typedef struct hada_upload {
    hada_slot *slot;
    cl_mem pinned;  /* host memory of the driver, which the device reads by itself; NULL: the device uses host memory */
    void *staged;   /* the same, mapped */
    uint64_t waits; /* of the slot, when the last frame was sent from there; 0: none was */
} hada_upload;

/* For frames of `values` values. Pinned memory is made where the device has memory of its own. */
hada_status hada_upload_make(hada_upload *upload, hada_slot *slot, size_t values, hada_error *err);
void hada_upload_free(hada_upload *upload); /* the slot's queue is done with it */

/* A frame (hada_pixels_uploads()) as planar floats into `raw`, through `between`, a buffer of at least the bytes of the
 * floats that is free until then. Enqueued: the frame must stay until the slot was waited for. Waits first if the
 * previous frame may still be on its way from pinned memory. */
hada_status hada_upload_frame(hada_upload *upload, const hada_pixels *frame, hada_buffer *raw, hada_buffer *between,
                              hada_error *err);

/* The second half of this: samples on the device to floats (enqueued). */
hada_status hada_upload_unpack(hada_slot *slot, const hada_stored *stored, hada_bytes between, cl_mem raw,
                               hada_error *err);

#endif
