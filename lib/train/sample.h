/* A pair on its way through a training step. Internal. */
#ifndef HADA_TRAIN_SAMPLE_H
#define HADA_TRAIN_SAMPLE_H

#include <hadalens/image.h>

/* FILTERS and JOINT: `input` is the raw frame (dark level taken off). The other stages: what the net takes, at the
 * window's size (ENHANCE, ADVERSARIAL: a reconstructed plane; CONVENTIONAL: the raw frame, resized). */
typedef struct hada_sample {
    int depth;
    const hada_image *input, *scene; /* scene: the window */
    size_t scene_number;             /* the same one always means the same scene; 0: it may change */
    double weight;                   /* of its gradient, for a net; 0: 1 */
} hada_sample;

/* Terms of a loss: each is its mean over the samples of a call, times its weight of the options, times `weight` and the
 * number of samples, so that those of the calls of a step add up to the step's mean. 0 where a term is off.
 * `discriminator` is the discriminator's own loss: cross-entropy of real images (label 1) plus that of the net's (label
 * 0); 2 ln 2 where it cannot tell them apart. */
typedef struct hada_terms {
    double mse, perceptual, adversarial, variation, discriminator;
} hada_terms;

#endif
