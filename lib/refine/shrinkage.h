/* Shrinkage of the cosine transforms of an image's overlapping blocks (kernels/refine_dct.cl): the second half of the
 * proximal step of an image that is a photograph (docs/explanation/refinement.md). Internal. */
#ifndef HADA_REFINE_SHRINKAGE_H
#define HADA_REFINE_SHRINKAGE_H

#include "launch/refine_dct.h"
#include "refine/variation.h"
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

/* theta, colour: as of hada_variation_step(); the share of theta that total variation keeps, and the threshold in units
 * of theta. */
typedef struct hada_shrinkage_weights {
    double theta, colour, variation, threshold;
} hada_shrinkage_weights;

/* What stays of total variation, then shrinkage: the step of one image as of hada_variation_step(), which has a plane's
 * duals at least. */
hada_status hada_shrinkage_after_variation(const hada_shrinkage *shrinkage, const hada_variation *variation,
                                           hada_slot *slot, cl_mem image, const cl_mem duals[2],
                                           const hada_shrinkage_weights *weights, int fresh, hada_error *err);

#endif
