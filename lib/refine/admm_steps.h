/* The refinement's kernels and their order. Internal to lib/refine. */
#ifndef HADA_REFINE_ADMM_STEPS_H
#define HADA_REFINE_ADMM_STEPS_H

#include "launch/refine.h"
#include "launch/refine_tv.h"
#include "refine/admm.h"

enum {
    HADA_REFINE_BATCH = 48,  /* images that one transform call takes */
    HADA_REFINE_PAD = 512,   /* floats: work-group of the proximal step times its vector */
    HADA_REFINE_SLICE = 2048 /* frequencies or pixels of one work-group: fixes the order of sums on every device */
};

struct hada_refiner {
    hada_slot *slot;
    hada_refine_shape shape;
    hada_spectrum_layout layout;
    hada_fft *forward, *inverse;             /* planes of the window */
    hada_fft *frame_forward, *frame_inverse; /* padded: of the frame */
    hada_buffer now_u, now_w, planes, list, partial;
    hada_buffer split_a, split_e, dual; /* padded: the split at the frame */
    hada_buffer rest, rest_frame;       /* padded: what the planes do not explain */
    size_t partials;                    /* partial sums of one step, at most */
    float *host_partial;
    double *energy;              /* [step][set] */
    hada_buffer tv[2];           /* total variation: its duals, and where the next ones go */
    hada_program_refine program; /* in the shape that fits the device and the layout */
    hada_program_refine_tv tv_program;
    size_t group; /* work-items of a group in the kernels with sums */
    size_t window_area, frame_area;
    size_t transforms;
};

/* Chooses the programs and makes them. */
hada_status hada_refine_prepare(hada_refiner *refiner, hada_error *err);
hada_status hada_refine_tv_prepare(hada_refiner *refiner, hada_error *err);

/* The proximal step of total variation and non-negativity on the planes, sets x depths in number. theta: weight over
 * rho. fresh: its duals are not those of a step before. */
hada_status hada_refine_tv_step(hada_refiner *refiner, int planes, double theta, int fresh, hada_error *err);

#endif
