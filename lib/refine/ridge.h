/* The learned ridge regulariser, as a proximal step on photographs with noise: a few gradient steps with filters that
 * were learned from photographs, the same for every camera (kernels/refine_ridge.cl). Internal. */
#ifndef HADA_REFINE_RIDGE_H
#define HADA_REFINE_RIDGE_H

#include "launch/refine_ridge.h"

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
