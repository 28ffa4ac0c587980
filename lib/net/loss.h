/* What training minimises: a value and its gradient. Internal.
 *
 * Everything is enqueued on the slot and not waited for. Sums run in a fixed order, without atomics: the same input
 * gives the same bits. The value, times the weight, is written to one float of the caller's, never added to, so that
 * each term of a sum of losses can be shown by itself. Gradients are those of weight * loss; accumulate: they are added
 * to dx, otherwise they replace it. dx NULL: the value alone. dx may not be x. The references are tests/ref/ref_loss.h.
 *
 * A perceptual loss is HADA_LOSS_MSE between the features of a fixed net; an adversarial loss is HADA_LOSS_LOGITS of
 * the output of a discriminator, label 1 for the generator (the form that does not saturate: Goodfellow et al. 2014).
 */
#ifndef HADA_NET_LOSS_H
#define HADA_NET_LOSS_H

#include "net/layers.h"

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
