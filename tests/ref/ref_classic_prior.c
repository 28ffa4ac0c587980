/* Proximal steps of total variation and of Haar wavelets. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "ref/ref_classic.h"

static double clip(double value, double limit)
{
    return fmax(-limit, fmin(limit, value));
}

/* max(0, image - gradient^T dual), forward differences that end at the edges. */
static void planes_of(const double *image, const double *dual, int rows, int cols, double *out)
{
    const double *down = dual, *right = dual + (size_t)rows * (size_t)cols;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            const size_t at = (size_t)i * (size_t)cols + (size_t)j;
            double adjoint = 0.0;
            adjoint += (i ? down[at - (size_t)cols] : 0.0) - (i < rows - 1 ? down[at] : 0.0);
            adjoint += (j ? right[at - 1] : 0.0) - (j < cols - 1 ? right[at] : 0.0);
            out[at] = fmax(0.0, image[at] - adjoint);
        }
}

/* A. Beck and M. Teboulle, IEEE TIP 18(11), 2009: FGP for anisotropic TV, non-negative images. */
hada_status hada_ref_tv(double *image, double *p, int rows, int cols, double weight, int inner, hada_error *err)
{
    const size_t pixels = (size_t)rows * (size_t)cols;
    double *r, t = 1.0;
    hada_status status = hada_allocated(r = hada_alloc(3 * pixels, sizeof *r, "the reference", err));
    if (status)
        return status;
    double *x = r + 2 * pixels;
    memcpy(r, p, 2 * pixels * sizeof *r);
    for (int k = 0; k < inner; k++) {
        const double t_next = (1.0 + sqrt(1.0 + 4.0 * t * t)) / 2.0;
        planes_of(image, r, rows, cols, x);
        for (size_t at = 0; at < pixels; at++) {
            const int row = (int)(at / (size_t)cols), col = (int)(at % (size_t)cols);
            const double slope[2] = {row < rows - 1 ? x[at + (size_t)cols] - x[at] : 0.0,
                                     col < cols - 1 ? x[at + 1] - x[at] : 0.0};
            for (size_t way = 0; way < 2; way++) {
                const size_t place = way * pixels + at;
                const double next = clip(r[place] + slope[way] / 8.0, weight);
                r[place] = next + (t - 1.0) / t_next * (next - p[place]);
                p[place] = next;
            }
        }
        t = t_next;
    }
    planes_of(image, p, rows, cols, x);
    memcpy(image, x, pixels * sizeof *x);
    free(r);
    return HADA_OK;
}

static int before(int i, int s, int plain)
{
    return plain ? i & ~s : i > s ? i - s : 0;
}

static int after(int i, int s, int n, int plain)
{
    const int k = plain ? i | s : i + s;
    return k < n - 1 ? k : n - 1;
}

/* What thresholding the block (i0, i1) x (j0, j1) changes at a pixel which is its first or second row and column. */
static double block(const double *a, int cols, int i0, int i1, int j0, int j1, int second_row, int second_col,
                    double limit)
{
    const double p = a[(size_t)i0 * (size_t)cols + (size_t)j0], q = a[(size_t)i0 * (size_t)cols + (size_t)j1];
    const double r = a[(size_t)i1 * (size_t)cols + (size_t)j0], t = a[(size_t)i1 * (size_t)cols + (size_t)j1];
    const double h = second_col ? -1.0 : 1.0, v = second_row ? -1.0 : 1.0;
    /* soft(d) - d = -clip(d) */
    return -(h * clip((p - q + r - t) / 4.0, limit) + v * clip((p + q - r - t) / 4.0, limit) +
             h * v * clip((p - q - r + t) / 4.0, limit));
}

/* out = what the levels from `level` on change in a. */
static hada_status changes(const double *a, int rows, int cols, double weight, int level, int levels, int plain,
                           double *out, hada_error *err)
{
    const size_t pixels = (size_t)rows * (size_t)cols;
    const int s = 1 << level;
    double *mean = NULL, *coarse = NULL;
    hada_status status = HADA_OK;
    if (level + 1 < levels) {
        status = hada_allocated(mean = hada_alloc(2 * pixels, sizeof *mean, "the reference", err));
        if (status)
            return status;
        coarse = mean + pixels;
        for (int i = 0; i < rows; i++)
            for (int j = 0; j < cols; j++) {
                const size_t i0 = (size_t)(plain ? before(i, s, 1) : i), i1 = (size_t)after(i, s, rows, plain);
                const size_t j0 = (size_t)(plain ? before(j, s, 1) : j), j1 = (size_t)after(j, s, cols, plain);
                const size_t n = (size_t)cols;
                mean[(size_t)i * n + (size_t)j] =
                    (a[i0 * n + j0] + a[i0 * n + j1] + a[i1 * n + j0] + a[i1 * n + j1]) / 4.0;
            }
        status = changes(mean, rows, cols, weight, level + 1, levels, plain, coarse, err);
    }
    const double limit = weight / (2.0 * s);
    for (int i = 0; !status && i < rows; i++)
        for (int j = 0; j < cols; j++) {
            const int is[3] = {before(i, s, plain), i, after(i, s, rows, plain)};
            const int js[3] = {before(j, s, plain), j, after(j, s, cols, plain)};
            double sum = 0.0;
            if (plain) {
                sum = block(a, cols, is[0], is[2], js[0], js[2], i != is[0], j != js[0], limit);
                sum += coarse ? coarse[(size_t)i * (size_t)cols + (size_t)j] : 0.0;
            } else {
                for (int u = 0; u < 2; u++)
                    for (int v = 0; v < 2; v++) {
                        sum += block(a, cols, is[u], is[u + 1], js[v], js[v + 1], u == 0, v == 0, limit) / 4.0;
                        sum += coarse ? coarse[(size_t)is[u] * (size_t)cols + (size_t)js[v]] / 4.0 : 0.0;
                    }
            }
            out[(size_t)i * (size_t)cols + (size_t)j] = sum;
        }
    free(mean);
    return status;
}

hada_status hada_ref_haar(double *image, int rows, int cols, double weight, int levels, int plain, hada_error *err)
{
    const size_t pixels = (size_t)rows * (size_t)cols;
    double *out;
    hada_status status = hada_allocated(out = hada_alloc(pixels, sizeof *out, "the reference", err));
    if (status)
        return status;
    status = changes(image, rows, cols, weight, 0, levels, plain, out, err);
    for (size_t i = 0; !status && i < pixels; i++)
        image[i] += out[i];
    free(out);
    return status;
}
