/* Rectangles of a grid: areas, the same on a coarser grid, transforms of the images in them. Internal. */
#ifndef HADA_REFINE_RECT_H
#define HADA_REFINE_RECT_H

#include "fft/fft.h"

/* Top left pixel and size. */
typedef struct hada_refine_rect {
    int row0, col0, rows, cols;
} hada_refine_rect;

size_t hada_rect_area(const hada_refine_rect *rect);

/* Whether it is not empty and lies within a grid of rows x cols. */
int hada_rect_inside(const hada_refine_rect *rect, int rows, int cols);

/* The size of a coarser grid, `shrink` times smaller or a little more; 1: the size itself. */
int hada_rect_grid_size(int size, double shrink);

/* On a grid of small_rows x small_cols, the rectangle round (outward, wider by `margin` pixels on every side) or within
 * (narrower by it) one of a grid of rows x cols; it does not leave the small grid, but may be empty. */
hada_refine_rect hada_rect_shrink(const hada_refine_rect *rect, int rows, int cols, int small_rows, int small_cols,
                                  int outward, int margin);

/* Transforms between spectra of a grid of rows x cols and `images` dense images of the rectangle. */
hada_fft_desc hada_rect_transform(const hada_refine_rect *rect, int rows, int cols, int images,
                                  hada_fft_direction direction);

#endif
