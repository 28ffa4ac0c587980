#include "refine/rect.h"

#include <math.h>

size_t hada_rect_area(const hada_refine_rect *rect)
{
    return (size_t)rect->rows * (size_t)rect->cols;
}

int hada_rect_inside(const hada_refine_rect *rect, int rows, int cols)
{
    return rect->row0 >= 0 && rect->col0 >= 0 && rect->rows > 0 && rect->cols > 0 && rect->row0 + rect->rows <= rows &&
           rect->col0 + rect->cols <= cols;
}

int hada_rect_grid_size(int size, double shrink)
{
    return shrink == 1.0 ? size : hada_fft_good_size(2 * (int)lround(size / shrink / 2.0));
}

static void shrink_span(int first, int size, int full, int small, int outward, int margin, int *to_first, int *to_size)
{
    const double scale = (double)small / full;
    int from = outward ? (int)floor(first * scale) - margin : (int)ceil(first * scale) + margin;
    int end = outward ? (int)ceil((first + size) * scale) + margin : (int)floor((first + size) * scale) - margin;
    from = from < 0 ? 0 : from;
    end = end > small ? small : end;
    *to_first = from;
    *to_size = end - from;
}

hada_refine_rect hada_rect_shrink(const hada_refine_rect *rect, int rows, int cols, int small_rows, int small_cols,
                                  int outward, int margin)
{
    hada_refine_rect out;
    shrink_span(rect->row0, rect->rows, rows, small_rows, outward, margin, &out.row0, &out.rows);
    shrink_span(rect->col0, rect->cols, cols, small_cols, outward, margin, &out.col0, &out.cols);
    return out;
}

hada_fft_desc hada_rect_transform(const hada_refine_rect *rect, int rows, int cols, int images,
                                  hada_fft_direction direction)
{
    return (hada_fft_desc){.direction = direction,
                           .rows = rows,
                           .cols = cols,
                           .batch = images,
                           .row0 = rect->row0,
                           .col0 = rect->col0,
                           .real_rows = rect->rows,
                           .real_cols = rect->cols,
                           .real_pitch = (size_t)rect->cols,
                           .real_distance = hada_rect_area(rect)};
}
