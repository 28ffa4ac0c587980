#include "ref/ref_varying.h"

#include <string.h>

/* The PSF of a pixel p of the window at a pixel q of the frame: sum_k w_k(p) h_k(q - p). */
static double light(const hada_ref_varying *c, int p_row, int p_col, int q_row, int q_col)
{
    const int row = q_row - (p_row + (c->rows - c->window_rows) / 2) + c->rows / 2,
              col = q_col - (p_col + (c->cols - c->window_cols) / 2) + c->cols / 2;
    double sum = 0.0;
    if (row < 0 || col < 0 || row >= c->rows || col >= c->cols)
        return 0.0;
    for (int k = 0; k < c->components; k++)
        sum += c->weights[(k * c->window_rows + p_row) * c->window_cols + p_col] *
               c->psf[(k * c->rows + row) * c->cols + col];
    return sum;
}

void hada_ref_varying_forward(const hada_ref_varying *c, const double *x, double *frame)
{
    memset(frame, 0, (size_t)c->rows * (size_t)c->cols * sizeof *frame);
    for (int p = 0; p < c->window_rows * c->window_cols; p++)
        for (int q = 0; q < c->rows * c->cols; q++)
            frame[q] += x[p] * light(c, p / c->window_cols, p % c->window_cols, q / c->cols, q % c->cols);
}

void hada_ref_varying_transpose(const hada_ref_varying *c, const double *frame, double *x)
{
    for (int p = 0; p < c->window_rows * c->window_cols; p++) {
        x[p] = 0.0;
        for (int q = 0; q < c->rows * c->cols; q++)
            x[p] += frame[q] * light(c, p / c->window_cols, p % c->window_cols, q / c->cols, q % c->cols);
    }
}
