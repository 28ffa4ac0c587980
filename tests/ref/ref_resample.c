/* Resizing by its definition: the weights of the taps along each axis, one value of the output after the other. */
#include <math.h>

#include "ref/ref_layers.h"

typedef struct taps {
    int count, index[4]; /* inputs, edges repeated */
    double weight[4];
} taps;

/* W. Keys' cubic convolution (1981), equation 4, with a = -0.75. */
static double cubic(double distance)
{
    const double a = -0.75, d = fabs(distance);
    if (d <= 1.0)
        return (a + 2.0) * d * d * d - (a + 3.0) * d * d + 1.0;
    return d < 2.0 ? a * d * d * d - 5.0 * a * d * d + 8.0 * a * d - 4.0 * a : 0.0;
}

static int inside(int index, int in)
{
    return index < 0 ? 0 : index >= in ? in - 1 : index;
}

static taps taps_of(int i, int in, int out, int count, int aligned)
{
    taps t = {.count = count};
    if (count == 1) {
        t.index[0] = (int)((long long)i * in / out);
        t.weight[0] = 1.0;
        return t;
    }
    const double place = aligned ? (out > 1 ? (double)i * (in - 1) / (out - 1) : 0.0) : (i + 0.5) * in / out - 0.5;
    const int floored = (int)floor(place);
    for (int k = 0; k < count; k++) {
        const int index = floored + k - (count == 4);
        t.index[k] = inside(index, in);
        t.weight[k] = count == 4 ? cubic(place - index) : 1.0 - fabs(place - index);
    }
    return t;
}

#define EACH_VALUE(shape)                                                                                              \
    for (int n = 0; n < (shape)->images; n++)                                                                          \
        for (int c = 0; c < (shape)->channels; c++)                                                                    \
            for (int row = 0; row < (shape)->rows; row++)                                                              \
                for (int col = 0; col < (shape)->cols; col++)

void hada_ref_resize(const hada_ref_shape *in, int rows, int cols, int taps_count, int aligned, const double *x,
                     double *y)
{
    const hada_ref_shape out = {in->images, in->channels, rows, cols};
    EACH_VALUE(&out)
    {
        const taps down = taps_of(row, in->rows, rows, taps_count, aligned);
        const taps right = taps_of(col, in->cols, cols, taps_count, aligned);
        double sum = 0.0;
        for (int i = 0; i < taps_count; i++)
            for (int k = 0; k < taps_count; k++)
                sum += down.weight[i] * right.weight[k] * x[hada_ref_at(in, n, c, down.index[i], right.index[k])];
        y[hada_ref_at(&out, n, c, row, col)] = sum;
    }
}

void hada_ref_resize_backward(const hada_ref_shape *in, int rows, int cols, int taps_count, int aligned,
                              const double *dy, double *dx)
{
    const hada_ref_shape out = {in->images, in->channels, rows, cols};
    EACH_VALUE(&out)
    {
        const taps down = taps_of(row, in->rows, rows, taps_count, aligned);
        const taps right = taps_of(col, in->cols, cols, taps_count, aligned);
        const double g = dy[hada_ref_at(&out, n, c, row, col)];
        for (int i = 0; i < taps_count; i++)
            for (int k = 0; k < taps_count; k++)
                dx[hada_ref_at(in, n, c, down.index[i], right.index[k])] += down.weight[i] * right.weight[k] * g;
    }
}
