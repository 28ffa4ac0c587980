/* References of the layers of nets that are not convolutions, forward and backward, by their definitions, on plain
 * arrays [image][channel][row][column] in double precision. Definitions are PyTorch's. Internal.
 *
 * Backward functions add to dx (and dweight, dbias): clear them first. */
#ifndef HADA_REF_LAYERS_H
#define HADA_REF_LAYERS_H

#include <stddef.h>
#include <stdint.h>

#include "core/base.h"

typedef struct hada_ref_shape {
    int images, channels, rows, cols;
} hada_ref_shape;
size_t hada_ref_values(const hada_ref_shape *shape);
/* The place of a value in an array of this shape. */
size_t hada_ref_at(const hada_ref_shape *shape, int image, int channel, int row, int col);

/* Leaky ReLU: slope 0 ReLU, slope 1 nothing. Backward takes the output y. */
void hada_ref_leaky(size_t count, double slope, const double *x, double *y);
void hada_ref_leaky_backward(size_t count, double slope, const double *y, const double *dy, double *dx);
void hada_ref_sigmoid(size_t count, const double *x, double *y);
void hada_ref_sigmoid_backward(size_t count, const double *y, const double *dy, double *dx);

/* Windows of size x size every `stride` pixels, incomplete ones dropped: rows (in - size) / stride + 1. */
hada_ref_shape hada_ref_pool_shape(const hada_ref_shape *in, int size, int stride);
void hada_ref_pool(const hada_ref_shape *in, int mean, int size, int stride, const double *x, double *y);
void hada_ref_pool_backward(const hada_ref_shape *in, int mean, int size, int stride, const double *x, const double *dy,
                            double *dx);

/* Resizing from the size of `in` to rows x cols; taps 1 (nearest), 2 (linear) or 4 (cubic, a = -0.75, Keys 1981). */
void hada_ref_resize(const hada_ref_shape *in, int rows, int cols, int taps, int aligned, const double *x, double *y);
void hada_ref_resize_backward(const hada_ref_shape *in, int rows, int cols, int taps, int aligned, const double *dy,
                              double *dx);

/* x into y with its top left at (row, col), as channels first ... of y; what it does not reach of these channels
 * becomes 0. */
void hada_ref_place(const hada_ref_shape *in, const hada_ref_shape *out, int row, int col, int first, const double *x,
                    double *y);
void hada_ref_place_backward(const hada_ref_shape *in, const hada_ref_shape *out, int row, int col, int first,
                             const double *dy, double *dx);

/* Batch normalisation with the given mean and variance, and with the batch's own (Ioffe and Szegedy 2015), which are
 * put into mean and variance (biased), `channels` long each. */
void hada_ref_batch_norm(const hada_ref_shape *shape, const double *weight, const double *bias, const double *mean,
                         const double *variance, double eps, const double *x, double *y);
void hada_ref_batch_statistics(const hada_ref_shape *shape, const double *x, double *mean, double *variance);
hada_status hada_ref_batch_norm_backward(const hada_ref_shape *shape, const double *weight, double eps, const double *x,
                                         const double *dy, double *dx, double *dweight, double *dbias, hada_error *err);

/* Dropout with the numbers of Philox4x32-7 (Salmon et al. 2011): see kernels/net_dropout.cl for key and counter. */
void hada_ref_dropout(const hada_ref_shape *shape, double p, uint64_t seed, uint64_t step, const double *x, double *y);
void hada_ref_philox(int rounds, uint32_t counter[4], uint32_t key0, uint32_t key1);

/* y[n][o] = bias[o] + sum_i w[o][i] x[n][i]; bias may be NULL. */
void hada_ref_linear(int images, int in, int out, const double *w, const double *bias, const double *x, double *y);
void hada_ref_linear_backward(int images, int in, int out, const double *w, const double *x, const double *dy,
                              double *dx, double *dw, double *dbias);

#endif
