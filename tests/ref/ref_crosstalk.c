#include "ref/ref_crosstalk.h"

#include <math.h>
#include <stdlib.h>

enum { REACH = 2 };

static double light(const double *plane, int channels, int rows, int cols, int row, int col)
{
    double sum = 0.0;
    for (int c = 0; c < channels; c++)
        for (int i = row - REACH; i <= row + REACH; i++)
            for (int j = col - REACH; j <= col + REACH; j++)
                if (i >= 0 && i < rows && j >= 0 && j < cols)
                    sum += plane[((size_t)c * (size_t)rows + (size_t)i) * (size_t)cols + (size_t)j];
    return sum;
}

void hada_ref_crosstalk(double *planes, int depths, int channels, int rows, int cols, double share)
{
    const size_t area = (size_t)rows * (size_t)cols, plane = (size_t)channels * area;
    double *m = calloc((size_t)depths * area, sizeof *m);
    if (!m)
        abort();
    for (int z = 0; z < depths; z++)
        for (size_t i = 0; i < area; i++)
            m[(size_t)z * area + i] =
                light(planes + (size_t)z * plane, channels, rows, cols, (int)i / cols, (int)i % cols);
    for (size_t i = 0; i < area; i++) {
        double most = 0.0;
        size_t brightest = 0;
        for (int z = 0; z < depths; z++)
            if (m[(size_t)z * area + i] > most) {
                most = m[(size_t)z * area + i];
                brightest = (size_t)z;
            }
        for (int c = 0; c < channels && most > 0.0; c++) {
            double moved = 0.0;
            for (int z = 0; z < depths; z++) {
                const double r4 = pow(m[(size_t)z * area + i] / most, 4.0), k4 = pow(share, 4.0);
                double *x = &planes[(size_t)z * plane + (size_t)c * area + i];
                const double kept = *x * (1.0 + k4) * r4 / (r4 + k4);
                moved += *x - kept;
                *x = kept;
            }
            planes[brightest * plane + (size_t)c * area + i] += moved;
        }
    }
    free(m);
}
