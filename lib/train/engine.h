/* One device's share of training: parameters, a step's gradients, the update. Internal.
 *
 * Parameters stand in groups, each an array of floats with an optimiser state of its own: the net; the discriminator
 * (critic); the filters of each depth (a depth's filters are updated only in steps that show it, with a count of steps
 * of their own). Gradients of several calls of hada_engine_backward add up until they are cleared.
 *
 * The gradient of a filter (docs/training.md): with x = crop(irfft(W B)), N pixels of the grid, and G =
 * rfft(pad(dL/dx)), dL/dW = m / N conj(B) G for the form complex (m: 2 for columns that stand for two, else 1), and
 * dL/dWr = m / N Re(B) Re(G), dL/dWi = m / N Im(B) Im(G) for split. */
#ifndef HADA_TRAIN_ENGINE_H
#define HADA_TRAIN_ENGINE_H

#include <hadalens/train.h>

#include "runtime/slot.h"

typedef enum hada_group { HADA_GROUP_NET = 0, HADA_GROUP_CRITIC = 1, HADA_GROUP_FILTERS = 2 } hada_group;
/* HADA_GROUP_FILTERS + z: the filters of depth z. */

/* What stands in a group. */
typedef enum hada_content { HADA_CONTENT_VALUES = 0, HADA_CONTENT_GRADIENT = 1, HADA_CONTENT_STATE = 2 } hada_content;

typedef struct hada_engine hada_engine;

/* A pair on its way through a step. FILTERS and JOINT: `input` is the raw frame (dark level taken off). The other
 * stages: what the net sees, at the window's size (ENHANCE, ADVERSARIAL: a reconstructed plane; CONVENTIONAL: the raw
 * frame, resized). */
typedef struct hada_sample {
    int depth;
    const hada_image *input, *scene; /* scene: the window */
    size_t scene_number;             /* the same one always means the same scene; 0: it may change */
} hada_sample;

/* Terms of a loss: each is its mean over the samples of a call, times its weight of the options, times `weight` and the
 * number of samples, so that those of the calls of a step add up to the step's mean. 0 where a term is off. `critic` is
 * the discriminator's own loss: cross-entropy of real images (label 1) plus that of the net's (label 0); 2 ln 2 where
 * it cannot tell them apart. */
typedef struct hada_terms {
    double mse, perceptual, adversarial, variation, critic;
} hada_terms;

/* `net`, `critic` and `vgg` may be NULL where the stage has none; copied values, lists must live as long. `model` gives
 * the sizes, and for FILTERS and JOINT the start of the filters; with `random_start` those of FILTERS start from normal
 * numbers (real and imaginary parts, deviation 0.05: planes of about 7 % of the frames' contrast), symmetric as
 * those of a real kernel. It may go once the engine is made. */
typedef struct hada_engine_desc {
    const hada_model *model;
    const hada_train_options *options;
    const hada_net *net, *critic, *vgg;
    int at_once; /* samples of one call, at most */
    /* Several engines update the same values: of the nets' values this one updates share number `share` of `shares` (0:
     * all), and holds the optimiser's states of these alone; of filters it updates all. */
    int share, shares;
    /* Features of the scenes number 1 ... `scenes` are kept on the host, up to so many bytes: the perceptual term then
     * runs VGG-16 once instead of twice, with the same bits. 0: none are. */
    size_t scenes, feature_bytes;
} hada_engine_desc;

hada_status hada_engine_bytes(const hada_context *context, const hada_engine_desc *desc, size_t *bytes,
                              hada_error *err);
hada_status hada_engine_create(hada_engine **out, hada_slot *slot, const hada_engine_desc *desc, hada_error *err);
void hada_engine_destroy(hada_engine **engine);

/* Groups that this stage trains: the net's and the critic's counts may be 0. */
int hada_engine_groups(const hada_engine *engine);
/* VALUES of a net are its parameters with the running statistics of batch norms behind them. STATE: of all shares. */
size_t hada_engine_count(const hada_engine *engine, int group, hada_content content); /* floats */

/* Floats of a group that are trained; those of them that this engine updates are `count` from `first` on. */
typedef struct hada_part {
    size_t first, count;
} hada_part;
hada_part hada_engine_part(const hada_engine *engine, int group);

/* The gradients of all groups begin anew: what comes first replaces what stands there. */
hada_status hada_engine_clear(hada_engine *engine, hada_error *err);

/* Forward and backward of up to at_once samples. `weight`: of each sample in the step's mean (1 / batch). `step` names
 * the random numbers of dropout, for the call (images are counted from its first); critic_only: only the critic's
 * gradients are wanted. Terms are known when it returns. `touched` (per depth, may be NULL) is set to 1 where a depth's
 * filters have a gradient.
 *
 * Gradients add up sample by sample in order, the same bits at every run. Batch norms take the statistics of the
 * samples of a call, so nets that have them depend on at_once; a call with fewer than at_once samples takes as long as
 * a full one (the samples are repeated to fill up, for the statistics alone). */
hada_status hada_engine_backward(hada_engine *engine, const hada_sample *samples, int count, double weight,
                                 uint64_t step, int critic_only, hada_terms *terms, unsigned char *touched,
                                 hada_error *err);

/* The norm over the gradients of net and filters (groups that are touched), and of the critic by itself. */
hada_status hada_engine_norm(hada_engine *engine, const unsigned char *touched, double *norm, double *critic_norm,
                             hada_error *err);

/* One update of a group, or of this engine's part of it, from its gradient, which is multiplied by `scale` before
 * (clipping); step counts from 1. The rule's eps is negligible for filters, whose gradients are far smaller than those
 * of nets, and filters know no weight decay. */
hada_status hada_engine_update(hada_engine *engine, int group, uint64_t step, double rate, double scale,
                               hada_error *err);

/* Contents from and to the host (blocking). Filters are in model order: [channel][rows][cols / 2 + 1] complex, whatever
 * the device's layout, so that devices with different layouts average, and files fit every device. STATE: of all
 * shares, of which this engine's part alone is written to `out`, and read from `values`. */
hada_status hada_engine_read(hada_engine *engine, int group, hada_content content, float *out, hada_error *err);
hada_status hada_engine_write(hada_engine *engine, int group, hada_content content, const float *values,
                              hada_error *err);

/* VALUES or GRADIENT, to read and change until it is closed; no other call in between. A net's stand where they are if
 * the device's memory is the host's, filters in `room`, which takes hada_engine_count() floats. *values: NULL on
 * failure.
 */
hada_status hada_engine_open(hada_engine *engine, int group, hada_content content, float *room, float **values,
                             hada_error *err);
hada_status hada_engine_close(hada_engine *engine, int group, hada_content content, float *values, hada_error *err);

/* Forward alone, as reconstruction does it: batch norms with their running statistics, no dropout, and what is below
 * zero becomes zero (training looks at what the net and, in FILTERS, the filters give without that). `before` (FILTERS,
 * JOINT: the linear plane; else the input; may be NULL) and `after` are created by the call at the window's size where
 * they are empty; FILTERS has the same in both. */
hada_status hada_engine_forward(hada_engine *engine, const hada_sample *sample, hada_image *before, hada_image *after,
                                hada_error *err);

#endif
