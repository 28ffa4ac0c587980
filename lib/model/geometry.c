/* Sizes: frame and window on the grid. */
#include "core/error.h"
#include "core/fft_factor.h"
#include "model/model.h"

#define LARGEST_SIDE 65536

hada_status hada_geometry_of(const hada_model_info *info, hada_geometry *out, hada_error *err)
{
    if (info->window_rows < 1 || info->window_cols < 1 || info->window_rows > info->raw_rows ||
        info->window_cols > info->raw_cols || info->raw_rows > info->grid_rows || info->raw_cols > info->grid_cols ||
        info->grid_rows > 4 * LARGEST_SIDE || info->grid_cols > 4 * LARGEST_SIDE)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "the model's sizes do not fit: window %d x %d, frame %d x %d, grid %d x %d (each must hold the "
            "one before)",
            info->window_rows, info->window_cols, info->raw_rows, info->raw_cols, info->grid_rows, info->grid_cols);
    if (info->boundary == HADA_BOUNDARY_CIRCULAR &&
        (info->grid_rows != info->raw_rows || info->grid_cols != info->raw_cols))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model's boundary is circular, but its grid %d x %d is not the frame %d x %d",
                         info->grid_rows, info->grid_cols, info->raw_rows, info->raw_cols);
    out->raw_row = (info->grid_rows - info->raw_rows) / 2;
    out->raw_col = (info->grid_cols - info->raw_cols) / 2;
    out->window_row = out->raw_row + (info->raw_rows - info->window_rows) / 2;
    out->window_col = out->raw_col + (info->raw_cols - info->window_cols) / 2;
    return HADA_OK;
}

hada_status hada_model_set_sizes(hada_model_info *info, int raw_rows, int raw_cols, int window_rows, int window_cols,
                                 hada_error *err)
{
    if (raw_rows < 1 || raw_cols < 1 || raw_rows > LARGEST_SIDE || raw_cols > LARGEST_SIDE)
        return hada_fail(err, HADA_ERROR_SIZE, "a frame of %d x %d is not possible (1 to %d pixels a side)", raw_rows,
                         raw_cols, LARGEST_SIDE);
    if (!window_rows && !window_cols) {
        window_rows = raw_rows;
        window_cols = raw_cols;
    }
    if (window_rows < 1 || window_cols < 1 || window_rows > raw_rows || window_cols > raw_cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "a window of %d x %d does not fit into frames of %d x %d; scenes must not be larger than raw "
                         "frames",
                         window_rows, window_cols, raw_rows, raw_cols);
    info->raw_rows = info->grid_rows = raw_rows;
    info->raw_cols = info->grid_cols = raw_cols;
    info->window_rows = window_rows;
    info->window_cols = window_cols;
    if (info->boundary == HADA_BOUNDARY_PADDED) {
        info->grid_rows = hada_fft_good_size(raw_rows + window_rows - 1);
        info->grid_cols = hada_fft_good_size(raw_cols + window_cols - 1);
    }
    return HADA_OK;
}
