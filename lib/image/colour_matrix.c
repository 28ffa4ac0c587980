#include "image/colour_matrix.h"

#include <math.h>

#include "core/base.h"
#include "image/mosaic.h"

void hada_colours_mix(float *planes, size_t area, const double m[HADA_COLOUR_MATRIX])
{
    float *red = planes, *green = planes + area, *blue = planes + 2 * area;
    float w[HADA_COLOUR_MATRIX];
    for (int i = 0; i < HADA_COLOUR_MATRIX; i++)
        w[i] = (float)m[i];
    for (size_t i = 0; i < area; i++) {
        const float r = red[i], g = green[i], b = blue[i];
        red[i] = w[0] * r + w[1] * g + w[2] * b;
        green[i] = w[3] * r + w[4] * g + w[5] * b;
        blue[i] = w[6] * r + w[7] * g + w[8] * b;
    }
}

static double determinant_of(const double m[HADA_COLOUR_MATRIX])
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

void hada_colours_invert(const double m[HADA_COLOUR_MATRIX], double inverse[HADA_COLOUR_MATRIX])
{
    const double by = 1.0 / determinant_of(m);
    for (int r = 0; r < HADA_COLOURS; r++)
        for (int c = 0; c < HADA_COLOURS; c++) { /* cyclic indices need no signs */
            const int r1 = (c + 1) % HADA_COLOURS, r2 = (c + 2) % HADA_COLOURS;
            const int c1 = (r + 1) % HADA_COLOURS, c2 = (r + 2) % HADA_COLOURS;
            inverse[r * HADA_COLOURS + c] = by * (m[r1 * HADA_COLOURS + c1] * m[r2 * HADA_COLOURS + c2] -
                                                  m[r1 * HADA_COLOURS + c2] * m[r2 * HADA_COLOURS + c1]);
        }
}

int hada_colours_known(const double m[HADA_COLOUR_MATRIX])
{
    for (int i = 0; i < HADA_COLOUR_MATRIX; i++)
        if (m[i] != 0.0)
            return 1;
    return 0;
}

void hada_colours_unmix(float *planes, size_t area, const double m[HADA_COLOUR_MATRIX])
{
    double inverse[HADA_COLOUR_MATRIX];
    if (!hada_colours_known(m))
        return;
    hada_colours_invert(m, inverse);
    hada_colours_mix(planes, area, inverse);
}

/* Whether a pixel of a mosaic, or one around it, knows only a bound of its own colour. */
static int is_bounded(const float *weights, int rows, int cols, hada_mosaic mosaic, int row, int col)
{
    const size_t plane = (size_t)rows * (size_t)cols;
    for (int r = hada_most(row - 1, 0); r <= hada_least(row + 1, rows - 1); r++)
        for (int c = hada_most(col - 1, 0); c <= hada_least(col + 1, cols - 1); c++)
            if (weights[(size_t)hada_mosaic_channel(mosaic, r, c) * plane + (size_t)r * (size_t)cols + (size_t)c] <
                0.0F)
                return 1;
    return 0;
}

static size_t weigh_mosaic(float *weights, int rows, int cols, hada_mosaic mosaic)
{
    const size_t plane = (size_t)rows * (size_t)cols;
    size_t good = 0;
    for (size_t i = 0; i < plane; i++) {
        const int row = (int)(i / (size_t)cols), col = (int)(i % (size_t)cols);
        float *own = &weights[(size_t)hada_mosaic_channel(mosaic, row, col) * plane + i];
        if (*own > 0.0F && is_bounded(weights, rows, cols, mosaic, row, col))
            *own = 0.0F;
        good += *own > 0.0F;
    }
    for (size_t k = 0; k < HADA_COLOURS * plane; k++)
        weights[k] = fmaxf(weights[k], 0.0F);
    return good;
}

size_t hada_colours_weigh(float *weights, int rows, int cols, hada_mosaic mosaic)
{
    const size_t plane = (size_t)rows * (size_t)cols;
    size_t good = 0;
    if (mosaic != HADA_MOSAIC_NONE)
        return weigh_mosaic(weights, rows, cols, mosaic);
    for (size_t i = 0; i < plane; i++) {
        const float least = fmaxf(fminf(fminf(weights[i], weights[plane + i]), weights[2 * plane + i]), 0.0F);
        for (size_t c = 0; c < HADA_COLOURS; c++)
            weights[c * plane + i] = least;
        good += least > 0.0F ? HADA_COLOURS : 0;
    }
    return good;
}

#define MOST 10.0

int hada_colours_usable(const double m[HADA_COLOUR_MATRIX])
{
    double inverse[HADA_COLOUR_MATRIX];
    if (!hada_colours_known(m))
        return 1;
    hada_colours_invert(m, inverse);
    for (int i = 0; i < HADA_COLOUR_MATRIX; i++)
        if (!(fabs(m[i]) <= MOST && fabs(inverse[i]) <= MOST))
            return 0;
    return 1;
}
