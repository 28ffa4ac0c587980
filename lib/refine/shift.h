/* How far a scene moved as a whole, from images of it, on the host. Internal. */
#ifndef HADA_REFINE_SHIFT_H
#define HADA_REFINE_SHIFT_H

#include <stddef.h>

#include "core/base.h"
#include "kernels/shared_refine.h"

/* Weights of Lanczos' window of three lobes (C. Duchon, J. Applied Meteorology 18, 1979) by which an image moves by
 * `shift` pixels to larger numbers. Returns where the first of the pixels is that they are for, seen from a pixel. */
int hada_shift_weights(double shift, float weights[HADA_REFINE_MOVE_TAPS]);

/* Planes of a window are compared by cells, sums over squares of so many pixels a side; floats that `planes` planes
 * have before and now; cells at the border where what is beyond it counts. Tiny windows say nothing. */
int hada_shift_scale(int rows, int cols);
size_t hada_shift_floats(int planes, int rows, int cols);
int hada_shift_border(int scale);
int hada_shift_possible(int rows, int cols);

/* What is found: the shift in pixels, down and across; how unevenly tiles differ beyond it, mean square over squared
 * mean, and the most over the mean; and by how much planes' own shifts differ from it. */
typedef struct hada_shift {
    double by[2], spread, most, apart;
} hada_shift;

/* `planes` images of rows x cols pixels, before and now, which move alike: their sum does, so that edges between depths
 * do not count. It may be brighter now. border: pixels that are left out at
 * each side. far: 1: by more than a pixel or two, else by less. found->by is where the search begins. Least squares (B.
 * Lucas, T. Kanade, "An iterative image registration technique", IJCAI 1981) in which tiles that differ count little,
 * so that objects that move by themselves do not draw the rest along. 0 where there are edges in one direction alone.
 */
hada_status hada_shift_find(const float *before, const float *now, int planes, int rows, int cols, int border, int far,
                            hada_shift *found, hada_error *err);

#endif
