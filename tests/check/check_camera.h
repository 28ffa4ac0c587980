/* A camera and a frame for checks: random transfer functions and data, on the device and for the reference. */
#ifndef HADA_CHECK_CAMERA_H
#define HADA_CHECK_CAMERA_H

#include "check.h"
#include "filter/bank.h"
#include "refine/admm.h"

/* Fills an image of the grid: a point spread function, or the frame of a channel. */
typedef void (*check_camera_fill)(const check_state *state, size_t number, int is_frame, float *out);

typedef struct check_camera {
    /* given */
    int rows, cols, padded; /* the grid; padded: data is known in the frame alone */
    hada_rectangle frame;
    size_t functions, channels; /* transfer functions, channels of the frame */
    check_camera_fill fill;     /* NULL: normal numbers, |OTF|^2 about 1 */
    /* made */
    hada_buffer otf, spectrum, seen; /* the transfer functions, the frame's spectra, the frame, in the layout */
    float *half;                     /* [functions][rows][cols / 2 + 1] complex */
    double *otfs, *image;            /* the same of the reference; [channel][rows][cols]: the frame */
} check_camera;

hada_status check_camera_make(check_state *state, check_camera *camera, hada_error *err);

/* Weights of the frame's pixels: such that are left out, that count half or once, and saturated ones; of the reference
 * [channel][rows][cols] of the grid. */
hada_status check_camera_weights(check_state *state, const check_camera *camera, hada_buffer *weights, double **of_grid,
                                 hada_error *err);

#endif
