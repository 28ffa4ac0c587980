/* Constants and structs of convolutions, for kernels and host. "Coarse" and "fine": lib/net/conv_plan.h. */
#ifndef SHARED_CONV_H
#define SHARED_CONV_H

#include "shared_net.h"

/* Work-items of a group: of a pass, and of the gradient of the weights, which takes so many channels, coarse and
 * fine. */
#define HADA_CONV_GROUP_ITEMS    128
#define HADA_CONV_GRADIENT_ITEMS 64
#define HADA_CONV_GRADIENT_LANES 32

/* What is done with a finished sum. */
enum {
    HADA_CONV_HAS_BIAS = 1,
    HADA_CONV_HAS_MASK = 2,    /* zero where the mask, the output of a ReLU, is not above zero */
    HADA_CONV_ACCUMULATES = 4, /* added to the values there */
    HADA_CONV_POOLS = 8,       /* the 2 x 2 maxima are written too */
    HADA_CONV_STREAMS = 16     /* the output is large and aligned to whole blocks: written past the caches (CPUs) */
};
typedef struct hada_conv_epilogue {
    hada_ulong bias; /* where it begins */
    hada_ulong mask, mask_image, pooled, pooled_image;
    int flags, activation; /* hada_activation */
    float slope;
    int unused;
} hada_conv_epilogue;
HADA_SHARED_SIZE(hada_conv_epilogue, 56)

/* One pass over images: `out` from `in`. */
typedef struct hada_conv_problem {
    hada_tensor_layout in, out;
    hada_tensor_layout low; /* conv_winograd: the channels behind those of `in`, at half its size; no blocks: none */
    hada_conv_epilogue epilogue;
    int kernel_rows, kernel_cols;
    int pad_rows, pad_cols; /* as hada_conv_taps_of() counts it; conv_plain: the convolution's own */
    int in_step, step;      /* pixels of the input and of the output from one place of the kernel to the next */
    int to_coarse;
    int rows_each; /* conv_direct: rows of a work-item; flat: tiles */
    int flat;      /* conv_direct: rows one after the other with the halo between them, as one long row */
    int unused;
    int tiles; /* conv_winograd: tiles of a work-item */
    int parts; /* conv_group: groups that share the steps of a tile */
} hada_conv_problem;
HADA_SHARED_SIZE(hada_conv_problem, 200)

/* The gradient of the weights. */
typedef struct hada_conv_correlation {
    hada_tensor_layout coarse, fine;
    int images;
    int kernel_cols, places; /* of a kernel */
    int pad_rows, pad_cols, stride;
    int strip_rows;  /* rows of `coarse` in a strip */
    int fine_groups; /* tiles of fine channels */
    int tiles;       /* conv_winograd_weights: at a time */
    int unused;
} hada_conv_correlation;
HADA_SHARED_SIZE(hada_conv_correlation, 104)

/* Partial sums of it: partial[part][coarse block][fine, filled up][place][coarse]. */
typedef struct hada_conv_partials {
    int parts, blocks, fine_filled, places;
    int coarse_channels, fine_channels;
    int swapped; /* coarse and fine are swapped, and kernels mirrored: lanes only */
    int unused;
} hada_conv_partials;
HADA_SHARED_SIZE(hada_conv_partials, 32)

/* The taps of a kernel that meet the pixels of one phase. Output pixel R = step * r + phase takes input r + first + t
 * with taps t = 0 ... count - 1; tap t is place u = u0 - step * t of the kernel, where `pad` is counted as for a
 * transposed convolution. */
typedef struct hada_conv_taps {
    int count, first, u0;
} hada_conv_taps;

static inline hada_conv_taps hada_conv_taps_of(int kernel_size, int pad, int step, int phase)
{
    const int over = (kernel_size - 1 - phase - pad) % step;
    hada_conv_taps taps;
    taps.u0 = kernel_size - 1 - (over < 0 ? over + step : over);
    taps.count = taps.u0 < 0 ? 0 : taps.u0 / step + 1;
    taps.first = (phase + pad - taps.u0) / step;
    return taps;
}

#endif
