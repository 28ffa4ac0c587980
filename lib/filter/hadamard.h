/* From a frame to linear planes: its way to the device, the Hadamard stage, clipping and blending. Internal. */
#ifndef HADA_FILTER_HADAMARD_H
#define HADA_FILTER_HADAMARD_H

#include "fft/fft.h"
#include "filter/bank.h"
#include "image/pixels.h"
#include "model/model.h"
#include "runtime/buffer.h"
#include "runtime/launch.h"

/* Planes clipped at zero, as reconstruction has them: light is not negative. Internal. */

/* The launch over `count` floats from `offset` on of kernels with kernels/inc_values.h. */
hada_range hada_values_range(const hada_slot *slot, size_t offset, size_t count);

/* The first `count` floats of a buffer (enqueued). */
hada_status hada_image_clip(hada_slot *slot, cl_mem planes, size_t count, hada_error *err);

/* `count` floats from `offset` on: share times these, plus the rest times the first floats of `others`, both clipped
 * (enqueued). */
hada_status hada_image_blend(hada_slot *slot, cl_mem planes, size_t offset, cl_mem others, size_t count, double share,
                             hada_error *err);

/* A frame's way to the device: its samples in the form in which they came, made floats there. Internal. */

typedef struct hada_upload {
    hada_slot *slot;
    cl_mem pinned;  /* host memory of the driver, which the device reads by itself; NULL: the device uses host memory */
    void *staged;   /* the same, mapped */
    uint64_t waits; /* of the slot, when the last frame was sent from there; 0: none was */
} hada_upload;

void hada_upload_free(hada_upload *upload); /* the slot's queue is done with it */

/* The second half of its way: samples on the device to floats (enqueued). */
hada_status hada_upload_unpack(hada_slot *slot, const hada_stored *stored, hada_bytes between, cl_mem raw,
                               hada_error *err);

/* The Hadamard stage: a frame's spectrum, once per channel, times each depth's filter, inverted in the window.
 * Internal.
 *
 * Tian and Yang, Optics Express 30(19), 34479 (2022), Eqs. 2 and 3. A stage belongs to a slot and holds one frame. */

/* What of a frame is computed; all zero: everything. Where the channels' lists are given, channel c is computed if
 * list[c] is c, copied from an earlier channel if it is that one's number, and zero if it is HADA_CHANNEL_BLACK. */
enum { HADA_CHANNEL_BLACK = -1 };
typedef struct hada_hadamard_part {
    int band_rows, band_cols; /* frequencies that the planes are made of, as in hada_fft_desc; 0, 0: all */
    const int *spectra;       /* how the channels' spectra come about; NULL: all are computed */
    const int *planes;        /* the same for their planes */
} hada_hadamard_part;

typedef struct hada_hadamard {
    hada_slot *slot;
    hada_geometry geometry;
    hada_spectrum_layout layout;
    int channels, raw_rows, raw_cols, window_rows, window_cols;
    int batch;            /* depths at once */
    int has_dark;         /* a dark frame stands in `dark` */
    hada_buffer raw;      /* channels x raw frame, dark already taken off */
    hada_buffer dark;     /* a frame, empty until one is set */
    hada_buffer spectrum; /* channels x layout.count complex numbers */
    hada_buffer whole;    /* not pruned: a batch's images of the whole grid */
    hada_fft *forward, *inverse;
    hada_upload upload;      /* the way of frames to the device */
    hada_hadamard_part part; /* of the frame in hand; the caller's to set before each call */
} hada_hadamard;

/* The transform of the frames or windows of a model, all channels of some depths at once. */
hada_fft_desc hada_geometry_transform(const hada_model_info *info, const hada_geometry *at,
                                      hada_fft_direction direction, int window, int depths);

/* The layout that banks for this model must have. */
hada_spectrum_layout hada_hadamard_layout(const hada_context *context, const hada_model_info *info);

/* `batch`: depths computed at once, at most. The raw frame is a result of the slot's steps (runtime/memory.h). */
hada_status hada_hadamard_create(hada_hadamard **out, hada_slot *slot, const hada_model_info *info, int batch,
                                 hada_error *err);
void hada_hadamard_destroy(hada_hadamard **stage);

/* From now on the inverse transforms compute the whole grid, from which the window is cut, for comparison. They round
 * differently, since rows are transformed in other pairs. */
hada_status hada_hadamard_unprune(hada_hadamard *stage, hada_error *err);

/* A dark frame (channels x raw size, planar) that every following frame has taken off, beside the level; NULL: none. */
hada_status hada_hadamard_set_dark(hada_hadamard *stage, const float *dark, hada_error *err);

/* Uploads a frame of the model's size (hada_pixels_uploads()), subtracts levels[channel] (NULL: nothing) from every
 * pixel, and transforms it: stage->raw and stage->spectrum are ready. Enqueued: the frame must stay until the slot was
 * waited for. */
hada_status hada_hadamard_frame(hada_hadamard *stage, const hada_pixels *raw, const double *levels, hada_error *err);
/* The same of a frame of floats on the device, `offset` bytes into a buffer. */
hada_status hada_hadamard_frame_from(hada_hadamard *stage, cl_mem raw, size_t offset, const double *levels,
                                     hada_error *err);

/* Windows of depths first ... first + count - 1 of the bank into `planes`, [depth][channel][window rows][window cols]
 * floats from `offset` (in floats) on. Any count; the stage works in batches. Enqueued, not waited for. */
hada_status hada_hadamard_run(hada_hadamard *stage, const hada_bank *bank, int first, int count, cl_mem planes,
                              size_t offset, hada_error *err);

#endif
