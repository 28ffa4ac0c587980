#include "ref/ref_loss.h"

#include <math.h>

static double sign(double v)
{
    return (double)((v > 0.0) - (v < 0.0));
}

double hada_ref_mse(size_t count, double weight, const double *x, const double *t, double *dx)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += (x[i] - t[i]) * (x[i] - t[i]);
        if (dx)
            dx[i] += weight * 2.0 * (x[i] - t[i]) / (double)count;
    }
    return weight * sum / (double)count;
}

double hada_ref_l1(size_t count, double weight, const double *x, const double *t, double *dx)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += fabs(x[i] - t[i]);
        if (dx)
            dx[i] += weight * sign(x[i] - t[i]) / (double)count;
    }
    return weight * sum / (double)count;
}

double hada_ref_logits(size_t count, double weight, const double *x, const double *t, double *dx)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += fmax(x[i], 0.0) - x[i] * t[i] + log1p(exp(-fabs(x[i])));
        if (dx)
            dx[i] += weight * (1.0 / (1.0 + exp(-x[i])) - t[i]) / (double)count;
    }
    return weight * sum / (double)count;
}

/* One pair of neighbours, the second minus the first. */
static double neighbours(int squared, double scale, const double *x, size_t first, size_t second, double *dx)
{
    const double d = x[second] - x[first], slope = squared ? 2.0 * d : sign(d);
    if (dx) {
        dx[first] -= scale * slope;
        dx[second] += scale * slope;
    }
    return squared ? d * d : fabs(d);
}

double hada_ref_variation(const hada_ref_shape *shape, int squared, double weight, const double *x, double *dx)
{
    const double scale = weight / shape->images;
    double sum = 0.0;
    for (int n = 0; n < shape->images; n++)
        for (int c = 0; c < shape->channels; c++)
            for (int r = 0; r < shape->rows; r++)
                for (int k = 0; k < shape->cols; k++) {
                    const size_t here = hada_ref_at(shape, n, c, r, k);
                    if (r + 1 < shape->rows)
                        sum += neighbours(squared, scale, x, here, hada_ref_at(shape, n, c, r + 1, k), dx);
                    if (k + 1 < shape->cols)
                        sum += neighbours(squared, scale, x, here, hada_ref_at(shape, n, c, r, k + 1), dx);
                }
    return scale * sum;
}
