#include "ref/ref_fit_cropped.h"

#include <math.h>
#include <stdlib.h>

#include "ref/ref_fft.h"

typedef struct work {
    const hada_ref_fit_cropped *fit;
    size_t plane, pixels;
    double *h, *v;     /* spectra: the transfer function, sums of whole frames */
    double *spectrum;  /* of whatever comes */
    double *x, *u, *d; /* images: of h, not negative, the multiplier over its weight */
    double *image;
} work;

static hada_status room(double **to, size_t count, hada_error *err)
{
    return hada_allocated(*to = hada_alloc(count, sizeof **to, "a reference", err));
}

/* h = (v / m + weight F(image)) / (Sxx / m + weight) */
static hada_status divide(work *w, double weight, hada_error *err)
{
    const hada_ref_grid *grid = w->fit->grid;
    const double *scene = w->fit->sums + 3 * w->plane;
    HADA_TRY(hada_ref_fft_forward(w->image, grid->rows, grid->cols, w->spectrum, err));
    for (size_t i = 0; i < 2 * w->plane; i++)
        w->h[i] = (w->v[i] / w->fit->mean + weight * w->spectrum[i]) / (scene[i / 2] / w->fit->mean + weight);
    return HADA_OK;
}

static hada_status step(work *w, double weight, hada_error *err)
{
    const hada_ref_grid *grid = w->fit->grid;
    for (size_t i = 0; i < w->pixels; i++)
        w->image[i] = w->u[i] - w->d[i];
    HADA_TRY(divide(w, weight, err));
    HADA_TRY(hada_ref_fft_inverse(w->h, grid->rows, grid->cols, w->x, err));
    for (size_t i = 0; i < w->pixels; i++) {
        const double relaxed = w->fit->relaxation * w->x[i] + (1.0 - w->fit->relaxation) * w->u[i];
        w->u[i] = fmax(relaxed + w->d[i], 0.0);
        w->d[i] += relaxed - w->u[i];
    }
    return HADA_OK;
}

/* v = Sxx h - length * sum over pairs of conj(X) F(crop F^-1(h X) - b) */
static hada_status fill(work *w, double length, double *left, hada_error *err)
{
    const hada_ref_fit_cropped *fit = w->fit;
    const hada_ref_grid *grid = fit->grid;
    *left = 0.0;
    for (size_t i = 0; i < 2 * w->plane; i++)
        w->v[i] = fit->sums[3 * w->plane + i / 2] * w->h[i];
    for (int k = 0; k < fit->pairs; k++) {
        for (size_t i = 0; i < w->plane; i++) {
            const double *x = fit->x[k] + 2 * i, *h = w->h + 2 * i;
            w->spectrum[2 * i] = x[0] * h[0] - x[1] * h[1];
            w->spectrum[2 * i + 1] = x[0] * h[1] + x[1] * h[0];
        }
        HADA_TRY(hada_ref_fft_inverse(w->spectrum, grid->rows, grid->cols, w->image, err));
        for (int row = 0; row < grid->rows; row++)
            for (int col = 0; col < grid->cols; col++) {
                const int r = row - grid->raw_row, c = col - grid->raw_col;
                double *at = w->image + (size_t)row * (size_t)grid->cols + col;
                const int seen = r >= 0 && r < grid->raw_rows && c >= 0 && c < grid->raw_cols;
                const float weight = !seen ? 0.0f : fit->weights ? fit->weights[r * grid->raw_cols + c] : 1.0f;
                *at = weight == 0.0f ? 0.0 : *at - fit->b[k][r * grid->raw_cols + c];
                *at = weight < 0.0f ? fmin(*at, 0.0) : *at;
                *left += *at * *at;
            }
        HADA_TRY(hada_ref_fft_forward(w->image, grid->rows, grid->cols, w->spectrum, err));
        for (size_t i = 0; i < w->plane; i++) {
            const double *x = fit->x[k] + 2 * i, *g = w->spectrum + 2 * i;
            w->v[2 * i] -= length * (x[0] * g[0] + x[1] * g[1]);
            w->v[2 * i + 1] -= length * (x[0] * g[1] - x[1] * g[0]);
        }
    }
    return HADA_OK;
}

static hada_status iterate(work *w, double *left, hada_error *err)
{
    const hada_ref_fit_cropped *fit = w->fit;
    for (int k = 0; k < fit->iterations; k++) {
        const double weight = fit->first * pow(fit->last / fit->first, k / (fit->iterations - 1.0));
        const double before = fit->first * pow(fit->last / fit->first, (k - 1) / (fit->iterations - 1.0));
        for (size_t i = 0; k && i < w->pixels; i++)
            w->d[i] *= before / weight;
        if (k)
            HADA_TRY(fill(w, fit->length[k], left, err));
        for (int i = 0; i < fit->steps; i++)
            HADA_TRY(step(w, weight, err));
    }
    for (size_t i = 0; i < w->pixels; i++)
        w->image[i] = w->u[i];
    return divide(w, fit->trust, err);
}

hada_status hada_ref_fit_cropped_solve(const hada_ref_fit_cropped *fit, double *otf, double *left, hada_error *err)
{
    const hada_ref_grid *grid = fit->grid;
    work w = {.fit = fit, .h = otf};
    w.plane = (size_t)grid->rows * (size_t)(grid->cols / 2 + 1);
    w.pixels = (size_t)grid->rows * (size_t)grid->cols;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(room(&w.v, 2 * w.plane, err));
    HADA_TRY_OR_DONE(room(&w.spectrum, 2 * w.plane, err));
    HADA_TRY_OR_DONE(room(&w.x, w.pixels, err));
    HADA_TRY_OR_DONE(room(&w.u, w.pixels, err));
    HADA_TRY_OR_DONE(room(&w.d, w.pixels, err));
    HADA_TRY_OR_DONE(room(&w.image, w.pixels, err));
    for (size_t i = 0; i < w.plane; i++) { /* conj(Sxb) */
        w.v[2 * i] = fit->sums[i];
        w.v[2 * i + 1] = -fit->sums[w.plane + i];
    }
    HADA_TRY_OR_DONE(iterate(&w, left, err));
done:
    HADA_FREE(w.v, w.spectrum, w.x, w.u, w.d, w.image);
    return status;
}
