#include "ref/ref_filter.h"

#include <stdlib.h>
#include <string.h>

#include "ref/ref_fft.h"

hada_status hada_ref_grid_forward(const hada_ref_grid *grid, const float *image, int row, int col, int rows, int cols,
                                  double *spectrum, hada_error *err)
{
    double *whole;
    hada_status status =
        hada_allocated(whole = hada_alloc((size_t)grid->rows * (size_t)grid->cols, sizeof *whole, "a grid", err));
    if (status)
        return status;
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++)
            whole[(size_t)(row + r) * (size_t)grid->cols + (size_t)(col + c)] =
                image[(size_t)r * (size_t)cols + (size_t)c];
    status = hada_ref_fft_forward(whole, grid->rows, grid->cols, spectrum, err);
    free(whole);
    return status;
}

hada_status hada_ref_hadamard(const hada_ref_grid *grid, const double *spectrum, const float *filter, int split,
                              double *window, hada_error *err)
{
    const size_t count = (size_t)grid->rows * (size_t)(grid->cols / 2 + 1);
    double *product, *whole = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(product = hada_alloc(2 * count, sizeof *product, "a spectrum", err)));
    HADA_TRY_OR_DONE(
        hada_allocated(whole = hada_alloc((size_t)grid->rows * (size_t)grid->cols, sizeof *whole, "a grid", err)));
    for (size_t i = 0; i < count; i++) {
        const double br = spectrum[2 * i], bi = spectrum[2 * i + 1], wr = filter[2 * i], wi = filter[2 * i + 1];
        product[2 * i] = split ? br * wr : br * wr - bi * wi;
        product[2 * i + 1] = split ? bi * wi : br * wi + bi * wr;
    }
    HADA_TRY_OR_DONE(hada_ref_fft_inverse(product, grid->rows, grid->cols, whole, err));
    for (int r = 0; r < grid->window_rows; r++)
        memcpy(window + (size_t)r * (size_t)grid->window_cols,
               whole + (size_t)(grid->window_row + r) * (size_t)grid->cols + (size_t)grid->window_col,
               (size_t)grid->window_cols * sizeof *window);
done:
    HADA_FREE(product, whole);
    return status;
}
