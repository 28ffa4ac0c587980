#include "ref/ref_tv.h"

#include <math.h>
#include <stdlib.h>

/* max(0, w + theta div p), of one channel */
static void plane(const double *w, const double *p, int rows, int cols, double theta, double *u)
{
    const double *pi = p, *pj = p + (size_t)rows * (size_t)cols;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            const size_t at = (size_t)i * (size_t)cols + (size_t)j;
            const double up = i ? pi[at - (size_t)cols] : 0.0, left = j ? pj[at - 1] : 0.0;
            const double down = i + 1 < rows ? pi[at] : 0.0, right = j + 1 < cols ? pj[at] : 0.0;
            u[at] = fmax(w[at] + theta * (down - up + right - left), 0.0);
        }
}

/* p + factor grad u, of one channel */
static void climb(const double *u, double *p, int rows, int cols, double factor)
{
    double *pi = p, *pj = p + (size_t)rows * (size_t)cols;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            const size_t at = (size_t)i * (size_t)cols + (size_t)j;
            pi[at] += i + 1 < rows ? factor * (u[at + (size_t)cols] - u[at]) : 0.0;
            pj[at] += j + 1 < cols ? factor * (u[at + 1] - u[at]) : 0.0;
        }
}

/* The multiplier of the nearest point of the ellipsoid mean + rest / colour^2 <= 1 (squares), by bisection; 0 within.
 */
static double multiplier(double mean, double rest, double colour)
{
    const double per = 1.0 / (colour * colour);
    double low = 0.0, high = 1.0;
    if (mean + per * rest <= 1.0)
        return 0.0;
    while (mean / pow(1.0 + high, 2) + per * rest / pow(1.0 + per * high, 2) > 1.0)
        high *= 2.0;
    for (int k = 0; k < 100; k++) {
        const double middle = 0.5 * (low + high);
        if (mean / pow(1.0 + middle, 2) + per * rest / pow(1.0 + per * middle, 2) > 1.0)
            low = middle;
        else
            high = middle;
    }
    return high;
}

static void shorten(double *duals, int channels, size_t area, double colour)
{
    const size_t parts = (size_t)channels;
    for (size_t i = 0; i < area; i++) {
        double common[2] = {0.0, 0.0}, mean = 0.0, rest = 0.0;
        for (size_t k = 0; k < 2 * parts; k++)
            common[k % 2] += duals[k * area + i] / (double)parts;
        for (size_t k = 0; k < 2 * parts; k++) {
            mean += common[k % 2] * common[k % 2];
            rest += pow(duals[k * area + i] - common[k % 2], 2);
        }
        const double mu = multiplier(mean, rest, colour);
        for (size_t k = 0; k < 2 * parts; k++)
            duals[k * area + i] =
                common[k % 2] / (1.0 + mu) + (duals[k * area + i] - common[k % 2]) / (1.0 + mu / (colour * colour));
    }
}

hada_status hada_ref_tv_coupled(const double *w, int channels, int rows, int cols, double theta, double colour,
                                double length, int steps, double *duals, double *u, hada_error *err)
{
    const size_t area = (size_t)rows * (size_t)cols;
    double *now;
    const hada_status status =
        hada_allocated(now = hada_alloc(area, sizeof *now, "the reference of total variation", err));
    if (status)
        return status;
    for (int k = 0; k < steps; k++) {
        for (size_t c = 0; c < (size_t)channels; c++) {
            plane(w + c * area, duals + 2 * c * area, rows, cols, theta, now);
            climb(now, duals + 2 * c * area, rows, cols, length / theta);
        }
        shorten(duals, channels, area, colour);
    }
    for (size_t c = 0; c < (size_t)channels; c++)
        plane(w + c * area, duals + 2 * c * area, rows, cols, theta, u + c * area);
    free(now);
    return HADA_OK;
}
