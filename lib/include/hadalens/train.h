/* Hadalens: training of filters and nets from pairs (raw frame, known scene) by gradients.
 *
 * The exact fit (hadalens/fit.h) gives the filters in seconds; training goes on from there. Stages, as in Appendix B of
 * Tian and Yang, Optics Express 30(19), 34479 (2022):
 *   FILTERS       the Hadamard filters alone, from a random start or from a model's, by the mean squared error: the
 *                 paper's method, to compare with the exact fit
 *   ENHANCE       a net that enhances refocused planes, shared by all depths; the filters stay as they are. It sees the
 *                 planes that reconstruction would give: refined ones where the model refines
 *   ADVERSARIAL   the same, with a discriminator that is trained against it (first alone for some steps)
 *   CONVENTIONAL  a net from the raw frame to the image without filters (Appendix C), to compare with
 *
 * A trainer works step by step: each takes `batch` pairs, drawn by seed, changed by the augmentations, and updates the
 * parameters once. Same pairs, options, devices and build give the same bits, also when training was stopped and
 * resumed from a checkpoint. Several devices of a context share a step's pairs and average their gradients.
 *
 * Threads: a trainer is used by one thread at a time; it reads pairs from a thread of its own. */
#ifndef HADALENS_TRAIN_H
#define HADALENS_TRAIN_H

#include <hadalens/communicator.h>
#include <hadalens/dataset.h>
#include <hadalens/device.h>
#include <hadalens/fit.h>
#include <hadalens/image.h>
#include <hadalens/model.h>
#include <hadalens/net.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_stage {
    HADA_STAGE_FILTERS = 1,
    HADA_STAGE_ENHANCE = 2,
    HADA_STAGE_ADVERSARIAL = 3,
    HADA_STAGE_CONVENTIONAL = 5
} hada_stage;

/* Changes of a pair on its way, drawn anew each time it is seen. */
typedef struct hada_augment {
    size_t size;  /* sizeof(hada_augment) */
    int shift;    /* raw frame and scene move together by up to so many pixels in rows and in columns; what leaves the
                     window is lost, what leaves the frame comes back in at the other side (circular boundary only) */
    int flips;    /* 1: left and right, 2: top and bottom, 3: both; for optics that are symmetric in this way only */
    double noise; /* standard deviation of Gaussian noise added to the raw frame, as a share of its maximum */
    double exposure; /* both images are scaled by a factor from 1 - exposure to 1 + exposure */
    int plane_flips; /* ENHANCE and ADVERSARIAL: the reconstructed plane and the scene are flipped together (1, 2, 3);
                        HADA_AUTO (default): 3 there */
} hada_augment;
HADA_INIT(hada_augment, HADA_STRUCT_AUGMENT)

typedef enum hada_rule { HADA_RULE_RMSPROP = 0, HADA_RULE_ADAM = 1 } hada_rule;
typedef enum hada_rate { HADA_RATE_CONSTANT = 0, HADA_RATE_COSINE = 2 } hada_rate;

typedef struct hada_train_options {
    size_t size; /* sizeof(hada_train_options) */
    hada_stage stage;
    uint64_t seed;

    /* what is trained */
    hada_form form;   /* FILTERS: HADA_FORM_COMPLEX or HADA_FORM_SPLIT; HADA_FORM_AUTO (default): complex for a random
                         start, else   the model's */
    int random_start; /* FILTERS: 1: random filters; 0 (default): the model's */
    const char *net;  /* preset of a new net ("compact", "paper"), used where the model has none or `new_net` is 1 */
    const hada_net *net_given; /* instead of a preset; copied; NULL: none */
    int new_net;
    const char *discriminator; /* preset of the discriminator: "patch" (default) judges the image patch by patch at the
                                  window's own size, "paper" the whole image at 256 x 256 */
    int net_rows, net_cols;    /* size at which the net runs; 0, 0: the window's */

    /* steps */
    uint64_t steps; /* of the whole training: the schedule's length */
    int batch;      /* pairs of a step */
    int at_once;    /* pairs computed together on a device; fewer need less memory (gradients add up);
                       HADA_AUTO (default): chosen from the memory */
    int recompute;  /* 1: keep less for backward, compute it again */
    hada_rule rule; /* HADA_RULE_RMSPROP is the paper's */
    double rate, filter_rate, discriminator_rate; /* of the net, the filters (HADA_AUTO: 0.1 for a random start, else
                                              1e-3), the discriminator (HADA_AUTO: 3e-4 for "paper", else 1e-3) */
    hada_rate schedule;
    double last_rate;             /* COSINE: at the end, as a share of the rate */
    uint64_t warmup;              /* steps in which the rate rises from a tenth */
    double clip;                  /* largest norm of a step's gradient; 0: as it is */
    uint64_t discriminator_steps; /* steps (of `steps`) of the discriminator alone, before the first of the net */

    /* losses: weights; those of the paper's code by default: 1.5, 0.1, 8e-3, 5e-7, but ADVERSARIAL with another
       discriminator than "paper" 2e-3 (adversarial HADA_AUTO, as it is set up: that default); the other stages have no
       adversarial term. FILTERS: the mean squared error alone. */
    double mse, perceptual, adversarial, variation;
    int variation_squared; /* 1: the paper's formula; 0 (default): absolute values, as its code */
    const char *vgg;       /* safetensors file of VGG-16; NULL: the perceptual term is off */

    const hada_augment *augment; /* NULL (default): hada_augment_init(); copied */

    double compose; /* ENHANCE and ADVERSARIAL: the share of pairs that become scenes of several depths: parts of their
                       scene are moved to other depths or replaced, and the captured frame is changed by what the model
                       says that this makes of it. Planes are then refined together, as reconstruction does. 0: none; 1:
                       a new net only shares light out among the planes of a frame: their sum, and planes that stand
                       alone, stay as they are; HADA_AUTO (default): 0.15 where the model has transfer functions and
                       several depths (ENHANCE: 1 where it refines by total variation), else 0 */

    const hada_communicator *communicator; /* ranks that share the pairs of each step, each with a trainer of its own
                                              from the same arguments: they make the same calls, and all have the same
                                              parameters at every time; copied; NULL (default): none do */
} hada_train_options;
static inline void hada_train_options_init(hada_train_options *options, hada_stage stage)
{
    hada_struct_init((hada_struct)((int)HADA_STRUCT_TRAIN_OPTIONS + (int)stage), options, sizeof *options);
}

typedef struct hada_trainer hada_trainer;

/* Starts at step 0, on one or more devices, a context each, which share the pairs of a step. `model` gives filters,
 * sizes and (where it has one) the net, and may be destroyed afterwards; CONVENTIONAL takes only its sizes.
 * `pairs` are those to learn from, `held_out` (may be NULL) those to validate with: of the model's depths, frames of
 * its raw size and scenes of its window's size or the raw frame's, of which the centre is used; both must last as long
 * as the trainer. What training makes of them, and what VGG-16 makes of the scenes for the perceptual term, is kept in
 * the host's memory as long as there is room (a gibibyte for both), where no augmentation other than plane_flips
 * changes it. HADA_ERROR_ARGUMENT, HADA_ERROR_MODEL or HADA_ERROR_MEMORY with a message that says what to change. */
HADA_API hada_status hada_trainer_create(hada_trainer **out, hada_context *const *contexts, int count,
                                         const hada_model *model, const hada_dataset *pairs,
                                         const hada_dataset *held_out, const hada_train_options *options,
                                         hada_error *err);
HADA_API void hada_trainer_destroy(hada_trainer **trainer);

/* What a trainer is doing. */
typedef struct hada_trainer_info {
    size_t size;                       /* sizeof(hada_trainer_info), set by the caller */
    const hada_train_options *options; /* as the trainer understood them: what was left open is filled in */
    const hada_net *net;               /* that is trained, with its first values, owned by the trainer; NULL: none */
    uint64_t steps, seen;              /* steps done; pairs seen on the way */
} hada_trainer_info;
HADA_API hada_status hada_trainer_get_info(const hada_trainer *trainer, hada_trainer_info *info, hada_error *err);

/* Device bytes that training needs on each device; nothing is allocated. */
HADA_API hada_status hada_trainer_bytes(hada_context *context, const hada_model *model,
                                        const hada_train_options *options, uint64_t *bytes, hada_error *err);

typedef struct hada_step_report {
    size_t size;                                    /* sizeof(hada_step_report), set by the caller */
    uint64_t step;                                  /* steps done, with this one */
    double loss;                                    /* sum of the weighted terms, mean over the pairs of the step */
    double mse, perceptual, adversarial, variation; /* the weighted terms; NaN where a term is off */
    double discriminator;                           /* loss of the discriminator; NaN without one */
    double norm;                                    /* of the gradient before clipping */
    double rate;                                    /* of this step */
    int discriminator_only;                         /* 1: a step of the discriminator alone */
    int rolled_back; /* 1: loss or gradient were not finite: parameters went back to the last good ones, the rate was
                        halved for what follows; step is where it goes on */
    double seconds;
} hada_step_report;

/* One step. HADA_ERROR_NUMERIC when it was rolled back ten times without a good step between. */
HADA_API hada_status hada_trainer_step(hada_trainer *trainer, hada_step_report *report, hada_error *err);

/* Means over the held-out pairs, at most `most` of them, evenly chosen (0: all), as they were captured and, where
 * training composes scenes of several depths, each as two of these as well (always the same ones): PSNR (peak 1), SSIM,
 * MAE, sharpness, of what the parameters give now, and of what they start from (the planes without the net; NaN for
 * CONVENTIONAL). */
typedef struct hada_validation {
    size_t size; /* sizeof(hada_validation), set by the caller */
    int pairs;
    double psnr, ssim, mae, sharpness;
    double psnr_before, ssim_before, mae_before, sharpness_before;
    double sharpness_truth;
} hada_validation;
HADA_API hada_status hada_trainer_validate(hada_trainer *trainer, int most, hada_validation *out, hada_error *err);

/* What becomes of a held-out pair (numbered over all depths, near to far): raw frame, plane before the net, output,
 * truth. Created by the call; any may be NULL. */
HADA_API hada_status hada_trainer_show(hada_trainer *trainer, int pair, hada_image *raw, hada_image *before,
                                       hada_image *after, hada_image *truth, hada_error *err);

/* The parameters as they are now, as a model; CONVENTIONAL has none, but a net. FILTERS: no OTF is changed, and
 * the model recommends no refinement, which would bypass the trained filters. */
HADA_API hada_status hada_trainer_model(hada_trainer *trainer, hada_model **out, hada_error *err);
HADA_API hada_status hada_trainer_net(hada_trainer *trainer, hada_net **out, hada_error *err);

/* Checkpoints: everything that going on with the same bits needs (safetensors), written beside and renamed, so that the
 * file is whole at any moment. Where the parameters are not finite, saving first goes back to the last good ones.
 * Loading takes the trainer to that step; it must have been created with the same model, stage, nets, rule, seed and
 * batch (HADA_ERROR_MODEL says what differs); rates, losses and the number of steps may differ. */
HADA_API hada_status hada_trainer_save(hada_trainer *trainer, const char *path, hada_error *err);
HADA_API hada_status hada_trainer_load(hada_trainer *trainer, const char *path, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
