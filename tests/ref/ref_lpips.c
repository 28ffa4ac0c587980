#include "ref/ref_lpips.h"

#include <math.h>

static double length(const hada_ref_shape *shape, const double *x, int row, int col)
{
    double sum = 0.0;
    for (int k = 0; k < shape->channels; k++) {
        const double v = x[hada_ref_at(shape, 0, k, row, col)];
        sum += v * v;
    }
    return sqrt(sum) + 1e-10;
}

void hada_ref_lpips(const hada_ref_shape *shape, const double *a, const double *b, const double *w, double *out)
{
    for (int r = 0; r < shape->rows; r++)
        for (int c = 0; c < shape->cols; c++) {
            const double of_a = length(shape, a, r, c), of_b = length(shape, b, r, c);
            double sum = 0.0;
            for (int k = 0; k < shape->channels; k++) {
                const size_t at = hada_ref_at(shape, 0, k, r, c);
                const double d = a[at] / of_a - b[at] / of_b;
                sum += w[k] * d * d;
            }
            out[(size_t)r * (size_t)shape->cols + (size_t)c] = sum;
        }
}
