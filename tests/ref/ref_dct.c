#include "ref/ref_dct.h"

#include <math.h>
#include <stdlib.h>

enum { SIDE = 8 };

static double basis(int k, int i, int n)
{
    return sqrt((k ? 2.0 : 1.0) / n) * cos(acos(-1.0) * (2 * i + 1) * k / (2.0 * n));
}

static int at_edge(int i, int count)
{
    return i < 0 ? 0 : i < count ? i : count - 1;
}

/* `count` images of `area` pixels through the transform over them. */
static void mix(const double *in, int count, size_t area, int back, double *out)
{
    for (size_t i = 0; i < area; i++)
        for (int k = 0; k < count; k++) {
            double sum = 0;
            for (int c = 0; c < count; c++)
                sum += (back ? basis(c, k, count) : basis(k, c, count)) * in[(size_t)c * area + i];
            out[(size_t)k * area + i] = sum;
        }
}

static void transform(const double in[SIDE][SIDE], int back, double out[SIDE][SIDE])
{
    for (int k = 0; k < SIDE; k++)
        for (int l = 0; l < SIDE; l++) {
            out[k][l] = 0;
            for (int i = 0; i < SIDE; i++)
                for (int j = 0; j < SIDE; j++)
                    out[k][l] += in[i][j] *
                                 (back ? basis(i, k, SIDE) * basis(j, l, SIDE) : basis(k, i, SIDE) * basis(l, j, SIDE));
        }
}

static void add_block(const double *image, int rows, int cols, int row, int col, double threshold, double *sum)
{
    double pixels[SIDE][SIDE], spectrum[SIDE][SIDE];
    for (int i = 0; i < SIDE; i++)
        for (int j = 0; j < SIDE; j++)
            pixels[i][j] = image[at_edge(row + i, rows) * cols + at_edge(col + j, cols)];
    transform((const double(*)[SIDE])pixels, 0, spectrum);
    for (int i = 0; i < SIDE; i++)
        for (int j = 0; j < SIDE; j++)
            if (i + j)
                spectrum[i][j] =
                    fabs(spectrum[i][j]) > threshold ? spectrum[i][j] - threshold * threshold / spectrum[i][j] : 0.0;
    transform((const double(*)[SIDE])spectrum, 1, pixels);
    for (int i = 0; i < SIDE; i++)
        for (int j = 0; j < SIDE; j++)
            if (row + i >= 0 && row + i < rows && col + j >= 0 && col + j < cols)
                sum[(row + i) * cols + col + j] += pixels[i][j] / 16.0;
}

hada_status hada_ref_dct_shrink(const double *image, int channels, int rows, int cols, double threshold, double colour,
                                double *out, hada_error *err)
{
    const size_t area = (size_t)rows * (size_t)cols, all = (size_t)channels * area;
    double *parts = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(parts = hada_alloc(2 * all, sizeof *parts, "the reference of shrinkage", err)));
    mix(image, channels, area, 0, parts);
    for (int c = 0; c < channels; c++)
        for (int row = 2 - SIDE; row < rows; row += 2)
            for (int col = 2 - SIDE; col < cols; col += 2)
                add_block(parts + (size_t)c * area, rows, cols, row, col, c ? threshold * colour : threshold,
                          parts + all + (size_t)c * area);
    mix(parts + all, channels, area, 1, out);
    for (size_t i = 0; i < all; i++)
        out[i] = fmax(out[i], 0.0);
done:
    free(parts);
    return status;
}
