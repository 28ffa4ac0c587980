#include "ref/ref_mosaic.h"

int hada_ref_mosaic_channel(const char *pattern, int row, int col)
{
    const char colour = pattern[row % 2 * 2 + col % 2];
    return colour == 'r' ? 0 : colour == 'g' ? 1 : 2;
}

void hada_ref_mosaic(const char *pattern, int rows, int cols, const float *values, double *out)
{
    for (int c = 0; c < 3; c++)
        for (int row = 0; row < rows; row++)
            for (int col = 0; col < cols; col++) {
                double sum = 0.0, weights = 0.0;
                for (int r = row - 1; r <= row + 1; r++)
                    for (int q = col - 1; q <= col + 1; q++)
                        if (r >= 0 && r < rows && q >= 0 && q < cols && hada_ref_mosaic_channel(pattern, r, q) == c) {
                            const double weight = (r == row ? 2.0 : 1.0) * (q == col ? 2.0 : 1.0);
                            sum += weight * values[r * cols + q];
                            weights += weight;
                        }
                const int own = hada_ref_mosaic_channel(pattern, row, col) == c;
                out[(c * rows + row) * cols + col] = own ? values[row * cols + col] : sum / weights;
            }
}
