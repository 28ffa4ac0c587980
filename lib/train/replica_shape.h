/* What a replica is made from, and its sizes and bytes before anything is allocated. Internal.
 *
 * A replica is one device's copy of what is trained, with all that a step needs. Images stand on the device in two
 * ways: as plain floats [image][channel][row][col], for transforms and transfers, and as tensors, for nets and losses.
 * A net shared by colours takes images x colours images of fewer channels, whose plain floats are the same. */
#ifndef HADA_TRAIN_REPLICA_SHAPE_H
#define HADA_TRAIN_REPLICA_SHAPE_H

#include <hadalens/image.h>
#include <hadalens/train.h>

#include "fft/fft.h"
#include "model/model.h"
#include "net/graph.h"
#include "net/optimizer.h"

/* A pair in a training step. FILTERS: `input` is the raw frame (dark level taken off). The other stages: what
 * the net takes, at the window's size (ENHANCE, ADVERSARIAL: a reconstructed plane; CONVENTIONAL: the raw frame,
 * resized). */
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

/* Groups of parameters; HADA_GROUP_FILTERS + z: the filters of depth z. */
typedef enum hada_group { HADA_GROUP_NET = 0, HADA_GROUP_DISCRIMINATOR = 1, HADA_GROUP_FILTERS = 2 } hada_group;

/* Floats of a group that are trained. */
typedef struct hada_part {
    size_t first, count;
} hada_part;

/* `net`, `discriminator` and `vgg` may be NULL where the stage has none; copied values, lists must live as long.
 * `model` gives the sizes, and for FILTERS the start of the filters; with `random_start` those of FILTERS
 * start from normal numbers (real and imaginary parts, deviation 0.05: planes of about 7 % of the frames' contrast),
 * symmetric as those of a real kernel. It may go once the replica is made. */
typedef struct hada_replica_desc {
    const hada_model *model;
    const hada_train_options *options;
    const hada_net *net, *discriminator, *vgg;
    int at_once; /* samples of one call, at most */
    /* Several replicas update the same values: of the nets' values this one updates share number `share` of `shares`
     * (0: all), and holds the optimiser's states of these alone; of filters it updates all. */
    int share, shares;
    /* Features of the scenes number 1 ... `scenes` are kept on the host, up to so many bytes: the perceptual term then
     * runs VGG-16 once instead of twice, with the same bits. 0: none are. */
    size_t scenes, feature_bytes;
} hada_replica_desc;

/* Where images and numbers of a step stand on the device. */
typedef enum hada_step_place {
    HADA_STEP_RAW,             /* filters: raw frames of a call */
    HADA_STEP_SPECTRA,         /* filters: their spectra */
    HADA_STEP_PLANE_SPECTRUM,  /* filters: the spectrum of the gradient of one plane */
    HADA_STEP_COLUMN_WEIGHTS,  /* filters: how often a value of a half spectrum counts */
    HADA_STEP_PLANES,          /* what the net takes; plain */
    HADA_STEP_SCENES,          /* plain */
    HADA_STEP_PLAIN,           /* nets: outputs and gradients on their way between graphs; plain */
    HADA_STEP_INPUT,           /* net at another size: its input at the window's size */
    HADA_STEP_OUTPUT,          /* the same: its output */
    HADA_STEP_OUTPUT_GRADIENT, /* the same: the gradient of that */
    HADA_STEP_TARGET,          /* nets: scenes as a tensor */
    HADA_STEP_TERM_GRADIENT,   /* a term's gradient that comes back from the discriminator or VGG-16 */
    HADA_STEP_FEATURES,        /* VGG-16: features of the scenes */
    HADA_STEP_VGG,             /* its weights */
    HADA_STEP_FAKE,            /* discriminator: labels of what the net made, 0 */
    HADA_STEP_REAL,            /* of scenes, 1 */
    HADA_STEP_TERMS,           /* values of the terms, then squares of norms */
    HADA_STEP_SCRATCH,         /* of sums */
    HADA_STEP_PLACES
} hada_step_place;

/* Values in HADA_STEP_TERMS. */
enum {
    HADA_TERM_MSE,
    HADA_TERM_PERCEPTUAL,
    HADA_TERM_ADVERSARIAL,
    HADA_TERM_VARIATION,
    HADA_TERM_REAL,
    HADA_TERM_FAKE,
    HADA_TERM_COUNT,
    HADA_TERM_SQUARES = HADA_TERM_COUNT, /* of the gradients of net and filters, of the discriminator's */
    HADA_TERM_FLOATS = HADA_TERM_SQUARES + 2
};

typedef struct hada_replica_shape {
    hada_stage stage;
    int channels, rows, cols; /* of the window */
    int at_once, depths;
    int filters, net, has_discriminator, vgg; /* 1: there are some; either filters or a net */
    size_t pixels, plane;                     /* of the window; floats of all its channels */
    size_t input; /* floats that the net takes: a plane, or as many again of the others beside it */
    size_t frame; /* floats of a raw frame, all channels */
    hada_form form;
    hada_spectrum_layout layout;
    hada_fft_desc forward, inverse, back; /* frames; planes; gradients of planes */
    int net_rows, net_cols, resized;
    hada_size features, logits;
    hada_graph_options training, inference, discriminator, vgg_graph; /* of the net, of the net for one image, ... */
    size_t bytes[HADA_STEP_PLACES];
    int groups;
} hada_replica_shape;

/* The form of the filters that are trained: what the options say, else the model's own, or complex from random ones. */
hada_status hada_train_form(const hada_train_options *options, const hada_model_info *info, hada_form *form,
                            hada_error *err);

hada_status hada_replica_shape_of(const hada_context *context, const hada_replica_desc *desc, hada_replica_shape *shape,
                                  hada_error *err);

/* Floats that a group holds on the device: all its values, and those that are trained. */
void hada_group_sizes(const hada_replica_shape *shape, const hada_replica_desc *desc, int group, size_t *floats,
                      size_t *trained);
hada_optimizer_desc hada_group_rule(const hada_train_options *options, int group);
hada_part hada_group_part(const hada_replica_desc *desc, int group, size_t trained);

/* Images of the window for a net, and what the discriminator and VGG-16 make of them. */
hada_tensor hada_step_tensor(const hada_context *context, const hada_replica_shape *shape, const hada_net *net,
                             cl_mem mem);
hada_tensor hada_step_logits(const hada_context *context, const hada_replica_shape *shape, cl_mem mem);
hada_tensor hada_step_features(const hada_context *context, const hada_replica_shape *shape, const hada_net *vgg,
                               cl_mem mem);

typedef struct hada_step_images {
    hada_slot *slot;
    const hada_replica_shape *shape;
    hada_buffer place[HADA_STEP_PLACES]; /* those that the stage needs */
} hada_step_images;

hada_status hada_step_images_create(hada_step_images *images, hada_slot *slot, const hada_replica_shape *shape,
                                    hada_error *err);
void hada_step_images_destroy(hada_step_images *images);

static inline cl_mem hada_step_mem(const hada_step_images *images, hada_step_place place)
{
    return images->place[place].mem;
}

/* One image of the window to its place among those of a call. */
hada_status hada_step_upload(hada_step_images *images, hada_step_place place, const hada_image *image, int number,
                             hada_error *err);

#endif
