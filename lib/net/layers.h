/* The layers of a net that are not convolutions, forward and backward. Internal.
 *
 * Everything is enqueued on the slot and not waited for. Tensors as in net/tensor.h; x and y of a call have the same
 * number of images. "d" before a name is the gradient of the loss with respect to it. Definitions are PyTorch's; the
 * references are tests/ref/ref_layers.h. */
#ifndef HADA_NET_LAYERS_H
#define HADA_NET_LAYERS_H

#include "net/conv.h"

/* y = act(x); y may be x. Backward needs the output y alone; dx may be dy. */
hada_status hada_activation_forward(hada_slot *slot, hada_activation activation, float slope, const hada_tensor *x,
                                    const hada_tensor *y, hada_error *err);
hada_status hada_activation_backward(hada_slot *slot, hada_activation activation, float slope, const hada_tensor *y,
                                     const hada_tensor *dy, const hada_tensor *dx, hada_error *err);

/* Pooling without padding, windows of size x size every `stride` pixels; incomplete windows are dropped. The gradient
 * of a maximum goes to the first of equal values, row by row, as in PyTorch. */
hada_status hada_pool_forward(hada_slot *slot, hada_pool pool, int size, int stride, const hada_tensor *x,
                              const hada_tensor *y, hada_error *err);
hada_status hada_pool_backward(hada_slot *slot, hada_pool pool, int size, int stride, const hada_tensor *x,
                               const hada_tensor *y, const hada_tensor *dy, const hada_tensor *dx, int accumulate,
                               hada_error *err);

/* Resizing to the size of y. Nearest and (bi)linear as torch.nn.functional.interpolate without and with align_corners;
 * cubic with a = -0.75, without antialiasing, likewise. Backward is the transposed operation, by gathering. */
hada_status hada_resize_forward(hada_slot *slot, hada_resize resize, const hada_tensor *x, const hada_tensor *y,
                                hada_error *err);
hada_status hada_resize_backward(hada_slot *slot, hada_resize resize, const hada_tensor *dy, const hada_tensor *dx,
                                 int accumulate, hada_error *err);

/* Planar images [image][channel][rows][cols] resized as by HADA_RESIZE_LINEAR, with the bits of tensors resized so;
 * values below `floor` (-INFINITY: none is) count as that. */
typedef struct hada_planes {
    hada_planar at;
    int rows, cols;
} hada_planes;
hada_status hada_resize_planes(hada_slot *slot, const hada_planes *from, const hada_planes *to, int images,
                               int channels, float floor, hada_error *err);

/* Copies x into y with its top left at (row, col) of y, cropping and filling with zeros (concatenation of odd sizes,
 * crop, pad); channels of y from first_channel on are written, the others left alone. accumulate: added to. */
hada_status hada_place(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, int row, int col, int first_channel,
                       int accumulate, hada_error *err);
/* The transposed operation with the same arguments: dx takes what dy has where x was placed, zeros where it was cut. */
hada_status hada_place_backward(hada_slot *slot, const hada_tensor *dy, const hada_tensor *dx, int row, int col,
                                int first_channel, int accumulate, hada_error *err);

/* y = a x + b y, elementwise; b = 0: what stood in y does not matter. */
hada_status hada_blend(hada_slot *slot, float a, const hada_tensor *x, float b, const hada_tensor *y, hada_error *err);

/* Batch normalisation over images, rows and columns (Ioffe and Szegedy 2015). `values` hold, in floats, each `channels`
 * long: weight, bias, running mean, running variance (as PyTorch's state dict). Training computes the batch's mean and
 * 1/sqrt(var + eps) into `saved` (2 x channels floats) by fixed-order sums and updates the running values with
 * `momentum` (unbiased variance; training needs two values a channel). `scratch` holds hada_batch_norm_scratch() bytes.
 * y may be x, dx may be dy; accumulate: dweight and dbias are added to, dx is replaced. */
typedef struct hada_batch_norm {
    hada_floats weight, bias, mean, variance;
    float eps, momentum;
} hada_batch_norm;
size_t hada_batch_norm_scratch(const hada_tensor *x);
hada_status hada_batch_norm_infer(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x,
                                  const hada_tensor *y, hada_error *err);
hada_status hada_batch_norm_train(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x,
                                  const hada_tensor *y, hada_floats saved, cl_mem scratch, hada_error *err);
hada_status hada_batch_norm_backward(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x,
                                     hada_floats saved, const hada_tensor *dy, const hada_tensor *dx,
                                     hada_floats dweight, hada_floats dbias, int accumulate, cl_mem scratch,
                                     hada_error *err);

/* Dropout: y = x * keep / (1 - p), keep drawn from (seed, step, place of the value) by a counter-based generator, so
 * that backward draws the same again and the layout does not matter. Forward and backward are the same operation. Each
 * layer of a net needs a seed of its own. */
hada_status hada_dropout(hada_slot *slot, float p, uint64_t seed, uint64_t step, const hada_tensor *x,
                         const hada_tensor *y, hada_error *err);

/* Fully connected: y[n][o] = bias[o] + sum_i w[o][i] x[n][i]; plain arrays of floats, x[images][in]. A tensor becomes
 * such an array by hada_tensor_store() (channel, row, column order, as torch.flatten). No bias: its mem is NULL. */
typedef struct hada_linear {
    int images, in, out;
} hada_linear;
hada_status hada_linear_forward(hada_slot *slot, const hada_linear *shape, hada_floats w, hada_floats bias,
                                hada_floats x, hada_floats y, hada_error *err);
hada_status hada_linear_backward_data(hada_slot *slot, const hada_linear *shape, hada_floats w, hada_floats dy,
                                      hada_floats dx, hada_error *err);
hada_status hada_linear_backward_weights(hada_slot *slot, const hada_linear *shape, hada_floats x, hada_floats dy,
                                         hada_floats dw, hada_floats dbias, int accumulate, hada_error *err);

/* What training minimises: a value and its gradient. Sums run in a fixed order, without atomics: the same input gives
 * the same bits. The value, times the weight, is written to one float of the caller's, never added to, so that each
 * term of a sum of losses can be shown by itself. Gradients are those of weight * loss; accumulate: they are added to
 * dx, otherwise they replace it. dx NULL: the value alone. dx may not be x. The references are tests/ref/ref_loss.h.
 *
 * A perceptual loss is HADA_LOSS_MSE between the features of a fixed net; an adversarial loss is HADA_LOSS_LOGITS of
 * the output of a discriminator, label 1 for the generator (the form that does not saturate: Goodfellow et al. 2014).
 */

/* With the mean over all images, channels, rows and columns, d = x - target:
 *   MSE         mean d^2
 *   L1          mean |d|; the gradient where d = 0 is 0
 *   LOGITS      mean of max(x, 0) - x t + log(1 + exp(-|x|)): binary cross-entropy of sigmoid(x) against the target
 *               t in 0 ... 1 (torch.nn.functional.binary_cross_entropy_with_logits)
 *   TV          total variation: the sum over channels and pixels of |x[r+1][c] - x[r][c]| + |x[r][c+1] - x[r][c]|,
 *               averaged over the images (tf.image.total_variation, which the authors of the 2022 paper take)
 *   TV_SQUARED  the same with squares for absolute values (the paper's own formula) */
typedef struct hada_loss_desc {
    hada_loss loss;
    float weight;
} hada_loss_desc;

/* Bytes of device memory that a call needs as scratch, for x of this shape. Its content does not matter. */
size_t hada_loss_scratch(const hada_tensor *x);

/* `target` has the shape of x; TV and TV_SQUARED have none (NULL). */
hada_status hada_loss_run(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *target,
                          hada_floats value, const hada_tensor *dx, int accumulate, cl_mem scratch, hada_error *err);

#endif
