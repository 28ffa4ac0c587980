/* Two-dimensional convolutions (cross-correlations, as every deep-learning library has them), forward and backward.
 * Internal.
 *
 *     y[n][o][r][c] = act(bias[o] + sum_{i,u,v} w[o][i][u][v] x[n][i][r*stride + u - pad_rows][c*stride + v -
 * pad_cols])
 *
 * x is zero outside. Weights and their gradients stand as PyTorch has them: [out][in][kernel rows][kernel cols], for
 * transposed convolutions [in][out][kernel rows][kernel cols]. Several implementations stand behind one interface,
 * the plain one (any size) last; all sums run in a fixed order. An object belongs to one slot and holds its own form of
 * the weights. */
#ifndef HADA_NET_CONV_H
#define HADA_NET_CONV_H

#include "net/tensor.h"
#include "netlist/net_list.h"

typedef struct hada_conv_desc {
    int images; /* at most */
    int in_channels, out_channels, in_rows, in_cols;
    int kernel_rows, kernel_cols, stride, pad_rows, pad_cols;
    int transposed, output_pad; /* transposed: out = (in - 1) * stride - 2 pad + kernel + output_pad */
    hada_activation activation;
    float slope;
    hada_conv_method method;
    int training; /* 1: the backward functions will be called */
    int doubled;  /* of in_channels, the last so many are given at half the size; 0: none */
} hada_conv_desc;

void hada_conv_output_size(const hada_conv_desc *desc, int *rows, int *cols);

typedef struct hada_conv hada_conv;

hada_status hada_conv_create(hada_conv **out, hada_slot *slot, const hada_conv_desc *desc, hada_error *err);
void hada_conv_destroy(hada_conv **conv);
hada_conv_method hada_conv_serving(const hada_conv *conv);

/* Takes over new weights (enqueued); `weights` holds out*in*kernel floats and is not needed
 * afterwards. */
hada_status hada_conv_set_weights(hada_conv *conv, hada_floats weights, hada_error *err);

/* y = act(conv(x) + bias); bias NULL: none. `pooled` (NULL: none) takes the 2 x 2 maxima of y as well, odd last rows
 * and columns dropped. Where the description has `doubled` channels, x has the others, and `low` those at half the
 * size: what comes in is hada_resize_forward(HADA_RESIZE_LINEAR) of it, which is not written. The bits are those of
 * resizing first. Else `low` is NULL. */
hada_status hada_conv_forward(hada_conv *conv, const hada_tensor *x, const hada_tensor *low, hada_floats bias,
                              const hada_tensor *y, const hada_tensor *pooled, hada_error *err);

/* Whether a description can have `doubled` channels here: without backward, where Winograd's tiles of 4 x 4 serve it,
 * the size is even and the channels before them are whole blocks. */
int hada_conv_doubles(const hada_context *context, const hada_conv_desc *desc);

/* dx = the gradient of x for dy, the gradient before the activation. `masked_by` (NULL: none): dx is zero where this
 * tensor, the output of a ReLU that made x, is not above zero. accumulate: dx is added to. */
hada_status hada_conv_backward_data(hada_conv *conv, const hada_tensor *dy, const hada_tensor *masked_by,
                                    const hada_tensor *dx, int accumulate, hada_error *err);

/* dw and db (NULL: none) from x and dy, summed over the images; accumulate: added to. */
hada_status hada_conv_backward_weights(hada_conv *conv, const hada_tensor *x, const hada_tensor *dy, hada_floats dw,
                                       hada_floats db, int accumulate, hada_error *err);

/* Relative rms from the plain convolution: what docs/explanation/speed-and-accuracy.md states against double precision,
 * and as much for the plain one itself. */
#define HADA_CONV_TF32_MOST 2e-6

/* Whether tensor cores serve convolutions: tried on the device first.
 *
 * Where the slot's device says that it has tensor cores and nobody has tried them on this context: computes small
 * convolutions by them and holds these against the plain one. From then on they serve (HADA_CONV_AUTO), or a warning in
 * the log says why not. Errors are those of a comparison that could not be made. */
hada_status hada_conv_tf32_try(hada_slot *slot, hada_error *err);

/* The comparison alone: the larger of the relative differences of both sizes of tiles. */
hada_status hada_conv_tf32_apart(hada_slot *slot, double *apart, hada_error *err);

#endif
