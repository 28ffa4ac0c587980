/* Reference of volumes: the planes, or the one texture, near a surface that explain a frame, by accelerated proximal
 * gradients on the whole grid, in double precision. It shares no shortcut with lib/surface. Internal. */
#ifndef HADA_REF_VOLUME_H
#define HADA_REF_VOLUME_H

#include "ref/ref_rect.h"

typedef struct hada_ref_volume {
    int rows, cols;       /* grid */
    hada_ref_rect window; /* where planes may be bright */
    int padded;           /* 0: data everywhere (circular) */
    hada_ref_rect frame;  /* padded: where data is known */
    int planes, channels;
    const double *otf;     /* [plane][channel][rows][cols / 2 + 1] complex, row-major */
    const double *image;   /* [channel][rows][cols]: the data, zero outside the frame */
    const double *weights; /* [channel][rows][cols], of the data; below 0: of values that are so bright or brighter, its
                              size their weight; NULL: all 1 */
    const double *allowed; /* [plane][channel][window], or NULL: everywhere */
    const double *depth;   /* [window]: of a texture, in planes; NULL: the planes are free */
    double floor, variation, bound;
    double colour; /* as ref_tv.h; 0: 1 */
    double tv_length;
    int tv_steps, steps;
    /* of a texture, in the last steps: shrinkage (ref_dct.h) after a share of variation, its threshold in units of it
     */
    double shrink, shrink_tv, shrink_colour;
    int shrink_steps;
} hada_ref_volume;

/* values: the planes [plane][channel][window], or the texture [channel][window]; where the run starts and what it
 * finds. */
hada_status hada_ref_volume_run(const hada_ref_volume *problem, double *values, hada_error *err);

#endif
