/* The proximal steps on planes: total variation, shrinkage, crosstalk, the learned regulariser. Internal. */
#ifndef HADA_REFINE_PROXIMAL_H
#define HADA_REFINE_PROXIMAL_H

#include "launch/refine_crosstalk.h"
#include "launch/refine_dct.h"
#include "launch/refine_ridge.h"
#include "launch/refine_tv.h"
#include "launch/refine_tv_rows.h"
#include "launch/refine_tv_tile.h"

/* The proximal step of total variation with non-negativity, on planes of a window with their channels coupled
 * (kernels/refine_tv.cl). Internal. */

/* Of a step: projected gradients on its dual, which goes on from step to step, each of this length. */
enum { HADA_REFINE_TV_STEPS = 6 };
#define HADA_REFINE_TV_LENGTH 0.22

/* Loads reach a vector beyond the last plane and the last dual: floats that both arrays have behind. */
enum { HADA_VARIATION_ROOM = 8 };

typedef struct hada_variation {
    int channels, rows, cols; /* of a plane */
    hada_program_refine_tv program;
    size_t group;
    int tiled; /* 1: some steps a launch, on tiles by work-groups (kernels/refine_tv_tile.cl) */
    hada_program_refine_tv_tile tile_program;
    hada_refine_tv_rows by_rows; /* bands and tiles of kernels/refine_tv_rows.cl; tiles is 0: it is not used */
} hada_variation;

/* Chooses the program for the window and makes it. */
hada_status hada_variation_prepare(hada_variation *variation, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err);

/* Floats of each of the two arrays of duals. */
size_t hada_variation_floats(const hada_context *context, int channels, int rows, int cols, int planes);

/* The step on `count` planes [plane][channel][rows][cols], in place. theta: weight of total variation over that of the
 * distance; colour: weight of differences of colour over those of brightness, from 1. duals[0] is read and holds the
 * new ones in the end; fresh: they are taken as 0. */
hada_status hada_variation_step(const hada_variation *variation, hada_slot *slot, cl_mem planes, const cl_mem duals[2],
                                int count, double theta, double colour, int fresh, hada_error *err);

/* What the step made `count` planes of, given what it left of its duals; not negative, and without what it cut off. */
hada_status hada_variation_before(const hada_variation *variation, hada_slot *slot, cl_mem planes, cl_mem duals,
                                  int count, double theta, hada_error *err);

/* Shrinkage of the cosine transforms of an image's overlapping blocks (kernels/refine_dct.cl): the second half of the
 * proximal step of a surface's texture (docs/explanation/surfaces.md). Internal. */

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

/* Light of one depth in the planes of others, put back where it stands beside them by far brighter
 * (kernels/refine_crosstalk.cl, docs/explanation/refinement.md). Internal. */

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

/* The learned ridge regulariser, as a proximal step on photographs with noise: a few gradient steps with filters that
 * were learned from photographs, the same for every camera (kernels/refine_ridge.cl). */

/* Filters see three channels, or one: of images with another number each channel is an image. */
typedef struct hada_ridge {
    int channels, rows, cols; /* of a plane */
    hada_program_refine_ridge program;
    size_t group, tiles;
} hada_ridge;

/* Chooses the program and makes it. */
hada_status hada_ridge_prepare(hada_ridge *ridge, hada_slot *slot, int channels, int rows, int cols, hada_error *err);

/* Step `number` where noise has this standard deviation; rows, columns and places are 0. */
hada_ridge_step hada_ridge_step_of(int number, double noise);

/* Floats that the steps need beside so many planes. */
static inline size_t hada_ridge_floats(int channels, int rows, int cols, int planes)
{
    return 2 * (size_t)planes * (size_t)channels * (size_t)rows * (size_t)cols;
}

/* All steps on `count` planes [plane][channel][rows][cols], in place, non-negative afterwards. scratch:
 * hada_ridge_floats(). noise above 0. */
hada_status hada_ridge_apply(const hada_ridge *ridge, hada_slot *slot, cl_mem planes, cl_mem scratch, int count,
                             double noise, hada_error *err);

#endif
