#include "ref/ref_train.h"

#include <stdlib.h>

#include "ref/ref_fft.h"

static size_t half_count(const hada_ref_grid *grid)
{
    return (size_t)grid->rows * (size_t)(grid->cols / 2 + 1);
}

/* The window's place on the grid. */
static double *pixel(const hada_ref_grid *grid, double *whole, int row, int col)
{
    return whole + (size_t)(grid->window_row + row) * (size_t)grid->cols + (size_t)(grid->window_col + col);
}

static hada_status make(const hada_ref_grid *grid, double **spectrum, double **whole, hada_error *err)
{
    *whole = NULL;
    hada_status status =
        hada_allocated(*spectrum = hada_alloc(2 * half_count(grid), sizeof **spectrum, "a spectrum", err));
    if (!status)
        status =
            hada_allocated(*whole = hada_alloc((size_t)grid->rows * (size_t)grid->cols, sizeof **whole, "a grid", err));
    return status;
}

hada_status hada_ref_train_plane(const hada_ref_grid *grid, const double *spectrum, const double *filter, int split,
                                 double *window, hada_error *err)
{
    double *product, *whole;
    hada_status status = make(grid, &product, &whole, err);
    for (size_t i = 0; !status && i < 2 * half_count(grid); i += 2) {
        const double br = spectrum[i], bi = spectrum[i + 1], wr = filter[i], wi = filter[i + 1];
        product[i] = split ? br * wr : br * wr - bi * wi;
        product[i + 1] = split ? bi * wi : br * wi + bi * wr;
    }
    if (!status)
        status = hada_ref_fft_inverse(product, grid->rows, grid->cols, whole, err);
    for (int r = 0; !status && r < grid->window_rows; r++)
        for (int c = 0; c < grid->window_cols; c++)
            *window++ = *pixel(grid, whole, r, c);
    HADA_FREE(product, whole);
    return status;
}

hada_status hada_ref_train_filter(const hada_ref_grid *grid, const double *spectrum, const double *window_gradient,
                                  int split, double *gradient, hada_error *err)
{
    const int cols = grid->cols / 2 + 1;
    double *g, *whole;
    hada_status status = make(grid, &g, &whole, err);
    for (int r = 0; !status && r < grid->window_rows; r++)
        for (int c = 0; c < grid->window_cols; c++)
            *pixel(grid, whole, r, c) = *window_gradient++;
    if (!status)
        status = hada_ref_fft_forward(whole, grid->rows, grid->cols, g, err);
    for (int ky = 0; !status && ky < grid->rows; ky++)
        for (int kx = 0; kx < cols; kx++) {
            const size_t i = 2 * ((size_t)ky * (size_t)cols + (size_t)kx);
            const double times = (kx == 0 || 2 * kx == grid->cols ? 1.0 : 2.0) / ((double)grid->rows * grid->cols);
            const double br = spectrum[i], bi = spectrum[i + 1];
            gradient[i] += times * (split ? br * g[i] : br * g[i] + bi * g[i + 1]);
            gradient[i + 1] += times * (split ? bi * g[i + 1] : br * g[i + 1] - bi * g[i]);
        }
    HADA_FREE(g, whole);
    return status;
}
