/* What an engine is made of. Internal to lib/train.
 *
 * Images stand on the device in two ways: as plain floats [image][channel][row][col], for transforms and transfers, and
 * as tensors, for nets and losses. A net shared by colours sees images x colours images of fewer channels, whose plain
 * floats are the same. */
#ifndef HADA_TRAIN_ENGINE_PARTS_H
#define HADA_TRAIN_ENGINE_PARTS_H

#include "fft/fft.h"
#include "model/model.h"
#include "net/graph.h"
#include "net/loss.h"
#include "net/optimizer.h"
#include "train/engine.h"
#include "train/features.h"

/* Buffers beside graphs, transforms and groups. */
enum {
    ENGINE_RAW,      /* filters: raw frames of a call */
    ENGINE_SPECTRA,  /* filters: their spectra */
    ENGINE_FLOW,     /* filters: the spectrum of the gradient of one plane */
    ENGINE_COLUMNS,  /* filters: how often a value of a half spectrum counts */
    ENGINE_PLANES,   /* what the net sees; plain */
    ENGINE_SCENES,   /* plain */
    ENGINE_FLAT,     /* nets: outputs and gradients on their way between graphs; plain */
    ENGINE_IN,       /* net at another size: its input at the window's size */
    ENGINE_OUT,      /* the same: its output */
    ENGINE_FALL,     /* the same: the gradient of that */
    ENGINE_TARGET,   /* nets: scenes as a tensor */
    ENGINE_SHARE,    /* critic, VGG: a gradient that comes back from them */
    ENGINE_FEATURES, /* VGG: features of the scenes */
    ENGINE_VGG,      /* its weights */
    ENGINE_PAIRS,    /* critic that sees planes as well: plane and image of each sample; plain */
    ENGINE_FALSE,    /* critic: labels of what the net made, 0 */
    ENGINE_TRUE,     /* of scenes, 1 */
    ENGINE_TERMS,    /* values of the terms, then norms */
    ENGINE_SUMS,     /* scratch of sums */
    ENGINE_BUFFERS
};

/* Floats of a work-item of train.cl. */
enum { ENGINE_RUN = 1024 };

/* Values in ENGINE_TERMS. */
enum {
    ENGINE_MSE,
    ENGINE_PERCEPTUAL,
    ENGINE_ADVERSARIAL,
    ENGINE_VARIATION,
    ENGINE_REAL,
    ENGINE_FAKE,
    ENGINE_TERM_COUNT,
    ENGINE_NORM = ENGINE_TERM_COUNT, /* the norm and its factor, twice */
    ENGINE_TERM_FLOATS = ENGINE_NORM + 4
};

/* Worked out before anything is allocated. */
typedef struct engine_shape {
    hada_stage stage;
    int channels, rows, cols; /* of the window */
    int at_once, depths;
    int filters, net, critic, vgg; /* 1: there are some */
    int paired;                    /* the critic sees the plane beside the image */
    size_t pixels, plane;          /* of the window; floats of all its channels */
    size_t frame;                  /* floats of a raw frame, all channels */
    hada_form form;
    hada_spectrum_layout layout;
    hada_fft_desc forward, inverse, back; /* frames; planes; gradients of planes */
    int net_rows, net_cols, resized;
    hada_size features, logits;
    hada_graph_options train, look, judge, see; /* of the net, of the net for one image, of the critic, of VGG */
    size_t bytes[ENGINE_BUFFERS];
    int groups;
} engine_shape;

typedef struct engine_group {
    hada_buffer values, gradient, state;
    size_t trained, floats; /* on the device */
    hada_part part;         /* of the trained ones, which are updated here */
    int clear;              /* the gradient begins anew: what stands there does not count */
    hada_optimizer_desc rule;
} engine_group;

struct hada_engine {
    hada_slot *slot;
    hada_train_options options;
    engine_shape shape;
    const hada_net *net, *critic, *vgg;
    engine_group *groups;
    hada_buffer buffers[ENGINE_BUFFERS];
    hada_fft *forward, *inverse, *back;
    hada_graph *train, *look, *judge, *see;
    hada_tensor in, out, fall, target, share, features, labels[2];
    int new_train, new_look, new_judge; /* weights changed since the graph took them */
    hada_features kept;                 /* of scenes */
    const hada_sample *samples;         /* of a step of a net: at_once */
};

/* engine_shape.c */
hada_status hada_engine_shape_of(const hada_context *context, const hada_engine_desc *desc, engine_shape *shape,
                                 hada_error *err);
/* Floats that a group holds on the device: all its values, and those that are trained. */
void hada_engine_group_sizes(const engine_shape *shape, const hada_engine_desc *desc, int group, size_t *floats,
                             size_t *trained);
hada_optimizer_desc hada_engine_rule(const hada_train_options *options, int group);
hada_part hada_engine_part_of(const hada_engine_desc *desc, int group, size_t trained);
/* Images of the window for a net, and what the critic and VGG make of them. */
hada_tensor hada_engine_tensor(const hada_context *context, const engine_shape *shape, const hada_net *net, cl_mem mem);
hada_tensor hada_engine_logits(const hada_context *context, const engine_shape *shape, cl_mem mem);
hada_tensor hada_engine_features(const hada_context *context, const engine_shape *shape, const hada_net *vgg,
                                 cl_mem mem);

/* engine_filters.c: values of a depth's filters in the order of the device, `floats` of them. */
hada_status hada_engine_first_filters(const hada_engine *engine, const hada_engine_desc *desc, int depth, float *values,
                                      hada_error *err);
/* Raw frames to planes: clipped at zero or as they are. */
hada_status hada_engine_refocus(hada_engine *engine, const hada_sample *samples, int count, int clip, hada_error *err);
/* Gradients of `count` planes, plain floats in `mem`, to those of filters. */
hada_status hada_engine_filter_gradients(hada_engine *engine, const hada_sample *samples, int count, cl_mem mem,
                                         unsigned char *touched, hada_error *err);
/* FILTERS: the error of the planes; they become its gradient. */
hada_status hada_engine_plane_error(hada_engine *engine, int count, double weight, hada_error *err);
/* The gradient of clipping at zero, in ENGINE_FLAT. */
hada_status hada_engine_mask(hada_engine *engine, hada_error *err);

/* engine_net.c: a tensor's plain floats, from `offset` on, image after image. */
hada_planar hada_engine_plain(const hada_tensor *tensor, cl_mem mem, size_t offset);
hada_status hada_engine_net_forward(hada_engine *engine, uint64_t step, hada_error *err);
/* From the gradient of the output on; joint: the gradient of its input goes to ENGINE_FLAT. */
hada_status hada_engine_net_backward(hada_engine *engine, hada_error *err);
/* What stands in ENGINE_PLANES as its first image, into ENGINE_FLAT. */
hada_status hada_engine_net_look(hada_engine *engine, hada_error *err);
/* The output at the window's size, and its gradient. */
const hada_tensor *hada_engine_output(const hada_engine *engine);
const hada_tensor *hada_engine_output_gradient(const hada_engine *engine);

/* engine_features.c: features of the scenes of engine->samples, into ENGINE_FEATURES if all are kept (found); and from
 * there to be kept. */
hada_status hada_engine_features_make(hada_engine *engine, const hada_engine_desc *desc, hada_error *err);
hada_status hada_engine_features_find(hada_engine *engine, int *found, hada_error *err);
hada_status hada_engine_features_keep(hada_engine *engine, hada_error *err);

/* engine_losses.c: terms of `count` images of the output, and the gradient of the output. */
hada_status hada_engine_losses(hada_engine *engine, int count, double weight, uint64_t step, int critic_only,
                               hada_error *err);

/* engine_groups.c */
hada_status hada_engine_groups_make(hada_engine *engine, const hada_engine_desc *desc, hada_error *err);
/* Whether what comes next is added to a net's gradient; from then on it is. */
int hada_engine_accumulates(hada_engine *engine, int group);
/* A gradient that begins anew and to which nothing came becomes zero (enqueued). */
hada_status hada_engine_settle(hada_engine *engine, int group, hada_error *err);
void hada_engine_groups_free(hada_engine *engine);

#endif
