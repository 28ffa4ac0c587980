#ifndef HADA_REF_RECT_H
#define HADA_REF_RECT_H

#include "refine/admm.h"

/* A rectangle of the grid. */
typedef hada_rectangle hada_ref_rect;

/* Whether a pixel of a grid of so many columns is in the rectangle. */
static inline int hada_ref_inside(const hada_ref_rect *rect, int cols, size_t pixel)
{
    const int row = (int)(pixel / (size_t)cols) - rect->row0, col = (int)(pixel % (size_t)cols) - rect->col0;
    return row >= 0 && row < rect->rows && col >= 0 && col < rect->cols;
}

/* The pixel of the grid that a pixel of the rectangle is. */
static inline size_t hada_ref_on_grid(const hada_ref_rect *rect, int cols, size_t pixel)
{
    const size_t row = pixel / (size_t)rect->cols, col = pixel % (size_t)rect->cols;
    return ((size_t)rect->row0 + row) * (size_t)cols + (size_t)rect->col0 + col;
}

#endif
