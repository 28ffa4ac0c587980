#include "ref/ref_fit_window.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ref/ref_fft.h"

static size_t plane(const hada_ref_fit_window *fit)
{
    return (size_t)fit->grid->rows * ((size_t)fit->grid->cols / 2 + 1);
}

/* Sbb and D of part k (0: real, 1: imaginary) at frequency i. */
static double own(const hada_ref_fit_window *fit, size_t i, int k)
{
    const size_t n = plane(fit);
    const double all = fit->sums[2 * n + i], real = fit->sums[5 * n + i];
    return fit->split ? (k ? all - real : real) : all;
}

static double extra(const hada_ref_fit_window *fit, size_t i, int k)
{
    const size_t n = plane(fit);
    const double all = fit->other[i], real = fit->other[n + i];
    return fit->split ? fit->alpha * (k ? all - real : real) + 0.5 * fit->ridge : fit->alpha * all + fit->ridge;
}

static void multiply(const double *b, const double *w, size_t count, int split, int conjugate, double *out)
{
    const double sign = conjugate ? -1.0 : 1.0;
    for (size_t i = 0; i < count; i++) {
        const double br = b[2 * i], bi = b[2 * i + 1], wr = w[2 * i], wi = w[2 * i + 1];
        out[2 * i] = split ? br * wr : br * wr - sign * bi * wi;
        out[2 * i + 1] = split ? bi * wi : br * wi + sign * bi * wr;
    }
}

/* The spectrum of the part of an inverse transform that is in the window. */
static hada_status crop(const hada_ref_grid *grid, double *spectrum, double *pixels, hada_error *err)
{
    HADA_TRY(hada_ref_fft_inverse(spectrum, grid->rows, grid->cols, pixels, err));
    for (int row = 0; row < grid->rows; row++)
        for (int col = 0; col < grid->cols; col++)
            if (row < grid->window_row || row >= grid->window_row + grid->window_rows || col < grid->window_col ||
                col >= grid->window_col + grid->window_cols)
                pixels[(size_t)row * (size_t)grid->cols + (size_t)col] = 0.0;
    return hada_ref_fft_forward(pixels, grid->rows, grid->cols, spectrum, err);
}

hada_status hada_ref_fit_window_apply(const hada_ref_fit_window *fit, const double *w, double *out, hada_error *err)
{
    const size_t n = plane(fit);
    double *spectrum = NULL, *pixels = NULL;
    hada_status status = hada_allocated(spectrum = hada_alloc(4 * n, sizeof *spectrum, "the reference", err));
    if (!status)
        status = hada_allocated(pixels = hada_alloc((size_t)fit->grid->rows * (size_t)fit->grid->cols, sizeof *pixels,
                                                    "the reference", err));
    for (size_t i = 0; !status && i < 2 * n; i++)
        out[i] = (fit->outside * own(fit, i / 2, i % 2) + extra(fit, i / 2, i % 2)) * w[i];
    for (int p = 0; !status && p < fit->pairs; p++) {
        multiply(fit->b[p], w, n, fit->split, 0, spectrum);
        status = crop(fit->grid, spectrum, pixels, err);
        multiply(fit->b[p], spectrum, n, fit->split, 1, spectrum + 2 * n);
        for (size_t i = 0; !status && i < 2 * n; i++)
            out[i] += (1.0 - fit->outside) * spectrum[2 * n + i];
    }
    HADA_FREE(spectrum, pixels);
    return status;
}

/* Half spectra hold one of each two values that belong together, except in the columns that stand for themselves. */
static double inner(const hada_ref_fit_window *fit, const double *u, const double *v)
{
    const size_t cols = (size_t)fit->grid->cols, half = cols / 2 + 1, n = plane(fit);
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) {
        const size_t col = i % half;
        sum += (col == 0 || 2 * col == cols ? 1.0 : 2.0) * (u[2 * i] * v[2 * i] + u[2 * i + 1] * v[2 * i + 1]);
    }
    return sum;
}

hada_status hada_ref_fit_window_solve(const hada_ref_fit_window *fit, double *w, hada_error *err)
{
    const size_t n = plane(fit);
    double *room;
    hada_status status = hada_allocated(room = hada_alloc(8 * n, sizeof *room, "the reference", err));
    if (status)
        return status;
    double *r = room, *z = r + 2 * n, *p = z + 2 * n, *t = p + 2 * n, square = 0.0;
    memset(w, 0, 2 * n * sizeof *w);
    for (size_t i = 0; i < n; i++) {
        r[2 * i] = fit->split ? fit->sums[4 * n + i] : fit->sums[i];
        r[2 * i + 1] = fit->split ? fit->sums[i] - fit->sums[4 * n + i] : fit->sums[n + i];
    }
    const double least = 1e-20 * inner(fit, r, r);
    for (int round = 0; !status && inner(fit, r, r) > least && round < 2000; round++) {
        for (size_t i = 0; i < 2 * n; i++) {
            const double under = own(fit, i / 2, i % 2) + extra(fit, i / 2, i % 2);
            z[i] = under > 0.0 ? r[i] / under : 0.0;
        }
        const double before = square;
        square = inner(fit, r, z);
        for (size_t i = 0; i < 2 * n; i++)
            p[i] = z[i] + (round ? square / before * p[i] : 0.0);
        status = hada_ref_fit_window_apply(fit, p, t, err);
        const double step = status ? 0.0 : square / inner(fit, p, t);
        for (size_t i = 0; i < 2 * n; i++) {
            w[i] += step * p[i];
            r[i] -= step * t[i];
        }
    }
    free(room);
    return status;
}
