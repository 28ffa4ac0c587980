#include "ref/ref_fit.h"

#include <math.h>
#include <stdlib.h>

#include "ref/ref_fft.h"

/* Filter of one frequency from its six sums. */
static void solve(const double s[HADA_REF_FIT_SUMS], double other, double other_r, double alpha, double ridge,
                  int split, double w[2])
{
    double under[2], over[2] = {s[0], s[1]};
    under[0] = under[1] = s[2] + alpha * other + ridge;
    if (split) {
        over[0] = s[4];
        over[1] = s[0] - s[4];
        under[0] = s[5] + alpha * other_r + 0.5 * ridge;
        under[1] = s[2] - s[5] + alpha * (other - other_r) + 0.5 * ridge;
    }
    for (int k = 0; k < 2; k++)
        w[k] = under[k] > 0.0 ? over[k] / under[k] : 0.0;
}

static void terms(const double *x, const double *b, double out[HADA_REF_FIT_SUMS])
{
    out[0] = x[0] * b[0] + x[1] * b[1];
    out[1] = x[1] * b[0] - x[0] * b[1];
    out[2] = b[0] * b[0] + b[1] * b[1];
    out[3] = x[0] * x[0] + x[1] * x[1];
    out[4] = x[0] * b[0];
    out[5] = b[0] * b[0];
}

void hada_ref_fit_pair(const double *x, const double *b, size_t count, double sign, double *sums)
{
    for (size_t i = 0; i < count; i++) {
        double t[HADA_REF_FIT_SUMS];
        terms(x + 2 * i, b + 2 * i, t);
        for (size_t k = 0; k < HADA_REF_FIT_SUMS; k++)
            sums[k * count + i] += sign * t[k];
    }
}

void hada_ref_fit_filter(const double *sums, const double *other, size_t count, double alpha, double ridge, int split,
                         double *filter)
{
    for (size_t i = 0; i < count; i++) {
        double s[HADA_REF_FIT_SUMS];
        for (size_t k = 0; k < HADA_REF_FIT_SUMS; k++)
            s[k] = sums[k * count + i];
        solve(s, other[i], other[count + i], alpha, ridge, split, filter + 2 * i);
    }
}

void hada_ref_fit_transfer(const double *sums, size_t count, double least, double *otf)
{
    for (size_t i = 0; i < count; i++) {
        const double under = fmax(sums[3 * count + i], least);
        otf[2 * i] = under > 0.0 ? sums[i] / under : 0.0;
        otf[2 * i + 1] = under > 0.0 ? -sums[count + i] / under : 0.0;
    }
}

/* (S + weight G) / (Sxx / mean + weight), S = conj(Sxb) / mean; G may be what is written. */
static void blend(const double *sums, size_t count, double mean, double weight, const double *guess, double *otf)
{
    for (size_t i = 0; i < count; i++) {
        const double under = sums[3 * count + i] / mean + weight;
        otf[2 * i] = (sums[i] / mean + weight * guess[2 * i]) / under;
        otf[2 * i + 1] = (-sums[count + i] / mean + weight * guess[2 * i + 1]) / under;
    }
}

hada_status hada_ref_fit_nonnegative(const double *sums, int rows, int cols, double mean, int steps,
                                     const double *weights, double relaxation, double trust, double *otf,
                                     hada_error *err)
{
    const size_t count = (size_t)rows * (size_t)(cols / 2 + 1), pixels = (size_t)rows * (size_t)cols;
    double *x = NULL, *u = NULL, *d = NULL;
    hada_status status = hada_allocated(x = hada_alloc(pixels, sizeof *x, "an image", err));
    if (!status)
        status = hada_allocated(u = hada_alloc(pixels, sizeof *u, "an image", err));
    if (!status)
        status = hada_allocated(d = hada_alloc(pixels, sizeof *d, "an image", err));
    for (int step = 0; !status && step < steps; step++) {
        for (size_t i = 0; i < pixels; i++) {
            d[i] *= step ? weights[step - 1] / weights[step] : 1.0; /* scaled by the weight */
            x[i] = u[i] - d[i];
        }
        status = hada_ref_fft_forward(x, rows, cols, otf, err);
        if (!status) {
            blend(sums, count, mean, weights[step], otf, otf);
            status = hada_ref_fft_inverse(otf, rows, cols, x, err);
        }
        for (size_t i = 0; !status && i < pixels; i++) {
            const double relaxed = relaxation * x[i] + (1.0 - relaxation) * u[i];
            u[i] = fmax(relaxed + d[i], 0.0);
            d[i] += relaxed - u[i];
        }
    }
    if (!status)
        status = hada_ref_fft_forward(u, rows, cols, otf, err);
    if (!status)
        blend(sums, count, mean, trust, otf, otf);
    HADA_FREE(x, u, d);
    return status;
}

double hada_ref_fit_leave_one_out(const hada_ref_grid *grid, const double *x, const double *b, const double *sums,
                                  const double *other, const double *seen, const double *weights, double alpha,
                                  double ridge, int split, double *leak)
{
    const size_t count = (size_t)grid->rows * (size_t)(grid->cols / 2 + 1);
    double *error = NULL, *pixels = NULL, own = -1.0;
    *leak = 0.0;
    if (hada_allocated(error = hada_alloc(2 * count, sizeof *error, "a spectrum", NULL)) ||
        hada_allocated(pixels = hada_alloc((size_t)grid->rows * (size_t)grid->cols, sizeof *pixels, "a grid", NULL)))
        goto done;
    for (size_t i = 0; i < count; i++) {
        double s[HADA_REF_FIT_SUMS], w[2];
        const double *xi = x + 2 * i, *bi = b + 2 * i;
        terms(xi, bi, s);
        for (size_t k = 0; k < HADA_REF_FIT_SUMS; k++)
            s[k] = sums[k * count + i] - s[k];
        solve(s, other[i], other[count + i], alpha, ridge, split, w);
        error[2 * i] = xi[0] - (split ? w[0] * bi[0] : w[0] * bi[0] - w[1] * bi[1]);
        error[2 * i + 1] = xi[1] - (split ? w[1] * bi[1] : w[0] * bi[1] + w[1] * bi[0]);
        *leak += weights[i] * (split ? w[0] * w[0] * seen[count + i] + w[1] * w[1] * (seen[i] - seen[count + i])
                                     : (w[0] * w[0] + w[1] * w[1]) * seen[i]);
    }
    if (hada_ref_fft_inverse(error, grid->rows, grid->cols, pixels, NULL))
        goto done;
    own = 0.0;
    for (int row = 0; row < grid->window_rows; row++)
        for (int col = 0; col < grid->window_cols; col++) {
            const double value =
                pixels[(size_t)(grid->window_row + row) * (size_t)grid->cols + (size_t)(grid->window_col + col)];
            own += value * value;
        }
done:
    HADA_FREE(error, pixels);
    return own;
}

double hada_ref_fit_unexplained(const double *sums, const double *weights, size_t count, double least)
{
    double total = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double under = fmax(sums[3 * count + i], least), re = sums[i], im = sums[count + i];
        total += weights[i] * (sums[2 * count + i] - (under > 0.0 ? (re * re + im * im) / under : 0.0));
    }
    return total;
}
