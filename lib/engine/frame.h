/* A frame on its way: what goes in, what was found on the host, and where the result goes. Internal.
 */
#ifndef HADA_ENGINE_FRAME_H
#define HADA_ENGINE_FRAME_H

#include <hadalens/opencl.h>
#include <stdatomic.h>

#include "engine/setup.h"
#include "planes/maker.h"

/* What a result holds besides its public members, which point here. */
typedef struct hada_result_memory {
    hada_report report;
    hada_skip_report skipped;
    unsigned char *occupied;
    float *stack;                          /* of all planes; NULL where the caller has an array for it */
    hada_image all_in_focus, distance_map; /* empty where the caller has arrays for them */
    hada_image confidence;                 /* empty until a frame is a surface */
    int has_confidence;                    /* of this frame */
    hada_result_arrays arrays;             /* the caller's, on the host and on the device */
    hada_cl_arrays device;
} hada_result_memory;

/* Whether it is written into buffers on the device as well. */
int hada_result_on_device(const hada_result *result);

/* Makes the result fit a model and a number of depths; images that fit already are kept. Empty on failure. */
hada_status hada_result_fit(hada_result *result, const hada_model_info *info, int depths, hada_error *err);

/* An empty report, to be filled. */
hada_report *hada_result_renew(hada_result *result);

/* Room for the confidence of this frame; hada_result_renew() removes it. */
hada_status hada_result_make_confidence(hada_result *result, hada_error *err);

/* Empties a result; arrays of the caller's stay in use. */
void hada_result_clear(hada_result *result);
/* Whether `bytes` from `data` on overlap the arrays that a result is written into. */
int hada_result_overlaps(const hada_result *result, const void *data, size_t bytes);

/* Makes `to` a copy of `from`, which is of the model, report included. Empty on failure. */
hada_status hada_result_copy(hada_result *to, const hada_result *from, const hada_model_info *info, hada_error *err);

/* The exponent on planes and all-in-focus image. */
void hada_result_apply_gamma(hada_result *result, double gamma);

typedef struct hada_frame hada_frame;

/* Who computes which depths on the linear path: the pipeline that has the frame asks, dispatch answers, and lets
 * pipelines of other devices have some. */
typedef struct hada_batches {
    /* All depths with wanted[z] are free to be taken; the others are not computed. */
    void (*open)(hada_frame *frame, const unsigned char *wanted);
    /* Takes depths *first ... *first + result - 1 from the near end, `most` at most; 0: none is free. */
    int (*take)(hada_frame *frame, int most, int *first);
    /* Their planes are in the result, or, not `done`, they are free again. */
    void (*put)(hada_frame *frame, int first, int count, int done);
    /* How many depths from `first` on have their planes in the result. `wait`: where another pipeline has the first in
     * hand, until it is done with it; then 0 means that it is free again. */
    int (*arrived)(hada_frame *frame, int first, int wait);
    /* Nothing can be taken any more; waits until no other pipeline is at the frame. */
    void (*close)(hada_frame *frame);
} hada_batches;

/* What a frame does not need (docs/explanation/speed-and-accuracy.md). All pipelines that work on it read the same. */
typedef struct hada_frame_skip {
    int *spectra, *planes;    /* per channel, as in hada_hadamard_part */
    int channels;             /* number of channels without planes of their own */
    int band_rows, band_cols; /* of the inverse transforms; 0, 0: all */
    double change;            /* of the stack, at most, under max_error: absolute L2 over all pixels */
    double band_change;       /* the same for the band that the caller chose */
    int limited;              /* 1: max_error left frequencies out */
    int exact;                /* 1: bounded kinds are off, since their bound was not kept */
} hada_frame_skip;

struct hada_frame {
    const hada_setup *setup;
    hada_frame_exposure exposure; /* the pixels */
    int examined, hashed;         /* 1: hada_frame_examine() was there; it computes the hash as well */
    cl_mem device; /* the same values on the device, device_offset bytes into a buffer; NULL: they are not */
    size_t device_offset;
    hada_result *result;
    double *stray;               /* room for stray light, [channel][HADA_SMOOTH_TERMS] */
    double kept_tv;              /* weight of total variation that an earlier frame found; 0: none is kept */
    uint64_t serial;             /* no two frames of a plan have the same; from 1 on */
    const hada_batches *batches; /* with `owner` for it to find its way back */
    void *owner;
    atomic_int cancelled; /* asked to end; launches look at it */
    int work;             /* to do: uploading, a unit for each depth or refinement step, ... */
    atomic_int progress;  /* of HADA_PROGRESS */

    /* hada_frame_prepare() */
    double start, lap; /* seconds */
    hada_frame_skip skip;
    atomic_int enhanced, tiles, tiles_left_out; /* planes and tiles of the net, by all pipelines */
};

enum {
    HADA_PROGRESS = 1000000,
    HADA_WORK_PURSUIT = 8 /* units: it takes about as long as so many refinement steps */
};

/* Checks the frame's size; its pixels must stay until the end. After a failure there is nothing to end. */
hada_status hada_frame_begin(hada_frame *frame, const hada_setup *setup, const hada_pixels *raw, hada_result *result,
                             hada_error *err);

/* Checks the pixels and finds dark levels and energy; done once. */
hada_status hada_frame_examine(hada_frame *frame, hada_error *err);

/* The host's part, in the thread of the pipeline: the result is made to fit, with an empty report, the frame examined.
 * May be called again, when a pipeline failed and another one starts over. */
hada_status hada_frame_prepare(hada_frame *frame, hada_error *err);

/* So much of frame->work is done; the progress never falls. */
void hada_frame_progress(hada_frame *frame, int done);

/* HADA_ERROR_CANCELLED when it was asked to end. */
hada_status hada_frame_check(hada_frame *frame, hada_error *err);

/* The one place where a finished result is looked at: HADA_ERROR_NUMERIC where it holds NaN or infinite values, or
 * nothing but 0 while the frame shows more than noise. For devices that take NaN for 0 the latter is all that is left
 * of numbers that broke down. */
hada_status hada_frame_check_result(const hada_frame *frame, hada_error *err);

/* Frees what the frame holds; a result that failed is emptied. */
void hada_frame_end(hada_frame *frame, hada_status status);

#endif
