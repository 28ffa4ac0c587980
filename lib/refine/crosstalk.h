/* Light of one depth in the planes of others, put back where it stands beside them by far brighter
 * (kernels/refine_crosstalk.cl, docs/explanation/refinement.md). Internal. */
#ifndef HADA_REFINE_CROSSTALK_H
#define HADA_REFINE_CROSSTALK_H

#include "launch/refine_crosstalk.h"

/* Of the brightest plane's light around a pixel, the share at which another plane halves there. Refinement left 0.5 to
 * 4 % where planes are dark, neighbours of many depths more; what overlaps, seen through, has more light than that. */
#define HADA_CROSSTALK 0.12

static inline int hada_crosstalk_known(double share)
{
    return share >= 0.0 && share <= 1.0;
}

typedef struct hada_crosstalk {
    int channels, rows, cols; /* of a plane */
    hada_program_refine_crosstalk program;
    size_t group, width;
} hada_crosstalk;

/* Chooses the program and makes it. */
hada_status hada_crosstalk_prepare(hada_crosstalk *crosstalk, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err);

/* Planes [depth][channel][rows][cols], none negative, in place; share: above 0, at most 1. scratch: floats of depths x
 * rows x cols. */
hada_status hada_crosstalk_fade(const hada_crosstalk *crosstalk, hada_slot *slot, cl_mem planes, cl_mem scratch,
                                int depths, double share, hada_error *err);

#endif
