#include "ref/ref_spectrum.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>

void hada_ref_crop(const float *in, int in_rows, int in_cols, int channels, int rows, int cols, int parts,
                   double factor, double tapers, int invert, double *out)
{
    const size_t in_half = (size_t)in_cols / 2 + 1, in_values = (size_t)in_rows * in_half;
    for (int row = 0; row < rows; row++) {
        const int ky = 2 * row < rows ? row : row - rows;
        for (int kx = 0; kx <= cols / 2; kx++) {
            const double fy = 2.0 * ky / rows, fx = 2.0 * kx / cols;
            const int nyquist = 2 * kx == cols || 2 * abs(ky) == rows;
            const size_t from = (size_t)((ky + in_rows) % in_rows) * in_half + (size_t)kx;
            for (int part = 0; part < parts; part++, out++) {
                double sum = 0.0;
                for (int c = 0; c < channels && !nyquist; c++)
                    sum += in[((size_t)c * in_values + from) * (size_t)parts + (size_t)part];
                sum *= factor / channels * pow(2.0, -tapers * (fy * fy + fx * fx));
                *out = !invert ? sum : sum > 0.0 ? 1.0 / sum : 0.0;
            }
        }
    }
}

static void product_at(const float *in, const float *filter, int product, size_t at, double out[2])
{
    const double re = in[2 * at], im = in[2 * at + 1];
    const double wr = product ? filter[2 * at] : 1.0, wi = product == 1 ? filter[2 * at + 1] : 0.0;
    out[0] = re * wr - im * wi;
    out[1] = product == 2 ? im * filter[2 * at + 1] : re * wi + im * wr;
}

void hada_ref_product(const float *in, const float *filter, int product, int rows, int cols, int band_rows,
                      int band_cols, double *out)
{
    const size_t half = (size_t)cols / 2 + 1;
    for (int ky = 0; ky < rows; ky++)
        for (int kx = 0; kx <= cols / 2; kx++, out += 2) {
            const int far = ky < rows - ky ? ky : rows - ky;
            double mirrored[2];
            product_at(in, filter, product, (size_t)ky * half + (size_t)kx, out);
            if (kx == 0 || 2 * kx == cols) {
                product_at(in, filter, product, (size_t)((rows - ky) % rows) * half + (size_t)kx, mirrored);
                out[0] = 0.5 * (out[0] + mirrored[0]);
                out[1] = 0.5 * (out[1] - mirrored[1]);
            }
            if (kx > band_cols || far > band_rows)
                out[0] = out[1] = 0.0;
        }
}

double hada_ref_explain(int depths, const double *h, const double *u, const double *b, double *rest)
{
    rest[0] = b[0];
    rest[1] = b[1];
    for (int z = 0; z < depths; z++, h += 2, u += 2) {
        rest[0] -= h[0] * u[0] - h[1] * u[1];
        rest[1] -= h[0] * u[1] + h[1] * u[0];
    }
    return rest[0] * rest[0] + rest[1] * rest[1];
}

double hada_ref_score(int channels, int depths, const double *h, const double *u, const double *b, const double *prior,
                      const double *variance)
{
    double mean[2] = {0.0, 0.0}, cost = 0.0, spread = 0.0;
    for (int c = 0; c < channels; c++) {
        double rest[2];
        hada_ref_explain(depths, h + 2 * c * depths, u + 2 * c * depths, b + 2 * c, rest);
        mean[0] += rest[0] / channels;
        mean[1] += rest[1] / channels;
        for (int z = 0; z < depths; z++) {
            const double *x = u + 2 * (c * depths + z), power = x[0] * x[0] + x[1] * x[1];
            cost += (prior ? prior[c] : 0.0) * power / channels;
            spread += (variance ? variance[c * depths + z] : 0.0) * power / channels;
        }
    }
    return (mean[0] * mean[0] + mean[1] * mean[1] + cost / channels) / (1.0 + spread);
}
