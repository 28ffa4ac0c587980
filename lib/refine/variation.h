/* The proximal step of total variation with non-negativity, on planes of a window with their channels coupled
 * (kernels/refine_tv.cl). Internal. */
#ifndef HADA_REFINE_VARIATION_H
#define HADA_REFINE_VARIATION_H

#include "launch/refine_tv.h"
#include "launch/refine_tv_tile.h"
#include "runtime/buffer.h"

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

#endif
