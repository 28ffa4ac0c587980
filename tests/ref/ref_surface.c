#include "ref/ref_surface.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ref/ref_fft.h"

#define TURN 6.283185307179586476925286766559

double hada_ref_b_spline(double x)
{
    static const double binomial[7] = {1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0};
    double sum = 0.0;
    for (int k = 0; k < 7; k++)
        sum += binomial[k] * pow(fmax(x + 3.0 - k, 0.0), 5.0);
    return fabs(x) >= 3.0 ? 0.0 : sum / 120.0;
}

static double gain(int k, int n)
{
    double sum = hada_ref_b_spline(0.0);
    for (int i = 1; i < 3; i++)
        sum += 2.0 * hada_ref_b_spline(i) * cos(TURN * k * i / n);
    return sum;
}

hada_status hada_ref_spline(const double *spectrum, int rows, int cols, double *coefficients, hada_error *err)
{
    const size_t width = (size_t)cols / 2 + 1;
    double *divided;
    hada_status status =
        hada_allocated(divided = hada_alloc((size_t)rows * width, 2 * sizeof *divided, "a reference", err));
    if (status)
        return status;
    for (size_t ky = 0; ky < (size_t)rows; ky++)
        for (size_t kx = 0; kx < width; kx++)
            for (size_t part = 0; part < 2; part++)
                divided[2 * (ky * width + kx) + part] =
                    spectrum[2 * (ky * width + kx) + part] / (gain((int)ky, rows) * gain((int)kx, cols));
    status = hada_ref_fft_inverse(divided, rows, cols, coefficients, err);
    free(divided);
    return status;
}

static double from_origin(int i, int n)
{
    return i < (n + 1) / 2 ? i : i - n;
}

static double value(const double *coefficients, int rows, int cols, double y, double x)
{
    double sum = 0.0;
    if (fabs(y) > rows / 2 || fabs(x) > cols / 2)
        return 0.0;
    for (int i = (int)floor(y) - 3; i <= (int)floor(y) + 4; i++)
        for (int j = (int)floor(x) - 3; j <= (int)floor(x) + 4; j++)
            sum += hada_ref_b_spline(y - i) * hada_ref_b_spline(x - j) *
                   coefficients[(size_t)((i + 2 * rows) % rows) * (size_t)cols + (size_t)((j + 2 * cols) % cols)];
    return sum;
}

void hada_ref_magnify(const double *coefficients, int rows, int cols, double scale, double row, double col,
                      double weight, double *out)
{
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < cols; x++)
            out[(size_t)y * (size_t)cols + (size_t)x] +=
                weight / (scale * scale) *
                value(coefficients, rows, cols, (from_origin(y, rows) - row) / scale,
                      (from_origin(x, cols) - col) / scale);
}
