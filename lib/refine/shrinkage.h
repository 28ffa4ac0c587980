/* Shrinkage of the cosine transforms of an image's overlapping blocks (kernels/refine_dct.cl): the second half of the
 * proximal step of an image that is a photograph (docs/refinement.md). Internal. */
#ifndef HADA_REFINE_SHRINKAGE_H
#define HADA_REFINE_SHRINKAGE_H

#include "launch/refine_dct.h"
#include "runtime/buffer.h"

/* Thresholds of differences of colour, over that of brightness. */
#define HADA_SHRINKAGE_COLOUR 1.25

/* The last steps of a run, those with shrinkage. */
enum { HADA_SHRINKAGE_STEPS = 3 };

typedef struct hada_shrinkage {
    int channels, rows, cols; /* of the image */
    hada_program_refine_dct program;
    size_t group, tiles;
} hada_shrinkage;

/* Chooses the program and makes it. */
hada_status hada_shrinkage_prepare(hada_shrinkage *shrinkage, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err);

/* Floats that a step needs beside the image. */
static inline size_t hada_shrinkage_floats(int channels, int rows, int cols)
{
    return 2 * (size_t)channels * (size_t)rows * (size_t)cols;
}

/* The step on the image [channel][rows][cols], in place, non-negative afterwards. scratch: hada_shrinkage_floats(). */
hada_status hada_shrinkage_step(const hada_shrinkage *shrinkage, hada_slot *slot, cl_mem image, cl_mem scratch,
                                double threshold, hada_error *err);

#endif
