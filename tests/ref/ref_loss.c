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

#define SIZE 11

static void gaussian(double window[SIZE][SIZE])
{
    double sum = 0.0;
    for (int i = 0; i < SIZE; i++)
        for (int k = 0; k < SIZE; k++)
            sum += window[i][k] = exp(-((i - 5) * (i - 5) + (k - 5) * (k - 5)) / (2.0 * 1.5 * 1.5));
    for (int i = 0; i < SIZE; i++)
        for (int k = 0; k < SIZE; k++)
            window[i][k] /= sum;
}

/* S of one window (equation 13 of the paper), and scale * its gradient. */
static double similarity(double window[SIZE][SIZE], int cols, double peak, double scale, const double *x,
                         const double *y, double *dx)
{
    const double c1 = 0.01 * peak * 0.01 * peak, c2 = 0.03 * peak * 0.03 * peak;
    double mx = 0.0, my = 0.0, vx = 0.0, vy = 0.0, vxy = 0.0;
    for (int i = 0; i < SIZE; i++)
        for (int k = 0; k < SIZE; k++) {
            mx += window[i][k] * x[i * cols + k];
            my += window[i][k] * y[i * cols + k];
        }
    for (int i = 0; i < SIZE; i++)
        for (int k = 0; k < SIZE; k++) {
            const double a = x[i * cols + k] - mx, b = y[i * cols + k] - my;
            vx += window[i][k] * a * a;
            vy += window[i][k] * b * b;
            vxy += window[i][k] * a * b;
        }
    const double a1 = 2.0 * mx * my + c1, a2 = 2.0 * vxy + c2, b1 = mx * mx + my * my + c1, b2 = vx + vy + c2;
    const double s = a1 * a2 / (b1 * b2);
    for (int i = 0; dx && i < SIZE; i++)
        for (int k = 0; k < SIZE; k++) {
            /* mx, vxy and vx change by w, w (y - my) and 2 w (x - mx) */
            const double a = x[i * cols + k] - mx, b = y[i * cols + k] - my;
            const double by_x = 2.0 * my / a1 - 2.0 * mx / b1 + 2.0 * b / a2 - 2.0 * a / b2;
            dx[i * cols + k] += scale * window[i][k] * s * by_x;
        }
    return s;
}

double hada_ref_ssim(const hada_ref_shape *shape, double peak, double weight, const double *x, const double *t,
                     double *dx)
{
    double window[SIZE][SIZE], sum = 0.0;
    gaussian(window);
    const double windows =
        (double)shape->images * shape->channels * (shape->rows - SIZE + 1) * (shape->cols - SIZE + 1);
    for (int n = 0; n < shape->images; n++)
        for (int c = 0; c < shape->channels; c++)
            for (int r = 0; r + SIZE <= shape->rows; r++)
                for (int k = 0; k + SIZE <= shape->cols; k++) {
                    const size_t at = hada_ref_at(shape, n, c, r, k);
                    sum +=
                        similarity(window, shape->cols, peak, -weight / windows, x + at, t + at, dx ? dx + at : NULL);
                }
    return weight * (1.0 - sum / windows);
}
