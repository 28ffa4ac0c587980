#include "ref/ref_convolve.h"

void hada_ref_convolve(int rows, int cols, const float *scene, const float *psf, double *out)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            const double x = scene[(size_t)i * (size_t)cols + (size_t)j];
            if (x == 0.0)
                continue;
            for (int r = 0; r < rows; r++) {
                const int from_row = (r - i + rows / 2 + rows) % rows;
                for (int c = 0; c < cols; c++) {
                    const int from_col = (c - j + cols / 2 + cols) % cols;
                    out[(size_t)r * (size_t)cols + (size_t)c] +=
                        x * psf[(size_t)from_row * (size_t)cols + (size_t)from_col];
                }
            }
        }
}

void hada_ref_convolve_crop(int rows, int cols, const float *scene, int psf_rows, int psf_cols, const float *psf,
                            double *out)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            const double x = scene[(size_t)i * (size_t)cols + (size_t)j];
            if (x == 0.0)
                continue;
            for (int r = 0; r < rows; r++) {
                const int from_row = r - i + psf_rows / 2;
                if (from_row < 0 || from_row >= psf_rows)
                    continue;
                for (int c = 0; c < cols; c++) {
                    const int from_col = c - j + psf_cols / 2;
                    if (from_col >= 0 && from_col < psf_cols)
                        out[(size_t)r * (size_t)cols + (size_t)c] +=
                            x * psf[(size_t)from_row * (size_t)psf_cols + (size_t)from_col];
                }
            }
        }
}
