/* The parts of a training step on a replica: filters, the net (generator), and losses. Internal. */
#ifndef HADA_TRAIN_STEP_H
#define HADA_TRAIN_STEP_H

#include <hadalens/status.h>
#include <stddef.h>

#include "train/parameters.h"
#include "train/replica_shape.h"

/* Frames to planes through the filters that are trained, and gradients of planes to those of filters.
 *
 * The gradient of a filter (docs/explanation/nets.md): with x = crop(irfft(W B)), N pixels of the grid, and G =
 * rfft(pad(dL/dx)), dL/dW = m / N conj(B) G for the form complex (m: 2 for columns that represent two, else 1), and
 * dL/dWr = m / N Re(B) Re(G), dL/dWi = m / N Im(B) Im(G) for split. */
typedef struct hada_filter_step {
    hada_step_images *images;
    hada_parameters *parameters;
    hada_fft *forward, *inverse, *back; /* frames; planes; gradients of planes */
} hada_filter_step;

/* The net that training improves, at the window's size: its input and output are resized (bilinear) if it runs at
 * another size. */
typedef struct hada_generator {
    hada_step_images *images;
    hada_parameters *parameters;
    const hada_net *net;
    uint64_t seed; /* of dropout */
    hada_graph *training, *inference;
    uint64_t training_version, inference_version; /* of the values that the graphs took over */
    hada_tensor input, output, output_gradient;   /* at the window's size, where the net runs at another */
} hada_generator;

hada_status hada_generator_create(hada_generator *generator, hada_step_images *images, hada_parameters *parameters,
                                  const hada_replica_desc *desc, hada_error *err);
void hada_generator_destroy(hada_generator *generator);

/* All at_once images of HADA_STEP_PLANES. `step` names the random numbers of dropout. */
hada_status hada_generator_forward(hada_generator *generator, uint64_t step, hada_error *err);

/* From the gradient of the output to those of the parameters. */
hada_status hada_generator_backward(hada_generator *generator, hada_error *err);

/* As in reconstruction: the first image of HADA_STEP_PLANES, to HADA_STEP_PLAIN. */
hada_status hada_generator_infer(hada_generator *generator, hada_error *err);

/* The output at the window's size, and its gradient. */
const hada_tensor *hada_generator_output(const hada_generator *generator);
const hada_tensor *hada_generator_output_gradient(const hada_generator *generator);

/* Features of scenes (VGG-16), kept on the host: they are compared with in every step that shows the scene. A store
 * belongs to a replica, since features have the layout and the bits of its device. */
typedef struct hada_features {
    float **kept;       /* of scene number 1 ... count; NULL: not kept */
    size_t count;       /* 0: nothing is kept */
    size_t floats;      /* of a scene's features */
    size_t bytes, most; /* that are kept; that may be */
} hada_features;

hada_status hada_features_create(hada_features *features, size_t scenes, size_t floats, size_t most, hada_error *err);
void hada_features_free(hada_features *features);

/* NULL: not kept; also for scene 0, which stands for all that change. */
const float *hada_features_find(const hada_features *features, size_t scene);

/* Room for a scene's features, which counts as kept; NULL: none is left, it is there already, or it is scene 0. */
float *hada_features_room(hada_features *features, size_t scene);
void hada_features_drop(hada_features *features, size_t scene);

/* The losses of the generator's output, with the gradients of the output and of the discriminator. Graphs run on
 * at_once images; the terms count the first `count` of them, and the gradients of the others are zero. */
typedef struct hada_losses {
    hada_step_images *images;
    hada_parameters *parameters;
    const hada_generator *generator;
    const hada_train_options *options;
    hada_graph *discriminator, *vgg;
    uint64_t discriminator_version; /* of the values that the graph took over */
    hada_tensor target, term_gradient, features, labels[2];
    hada_features kept; /* of scenes */
} hada_losses;

/* `options` must live as long. */
hada_status hada_losses_create(hada_losses *losses, const hada_generator *generator, const hada_replica_desc *desc,
                               const hada_train_options *options, hada_error *err);
void hada_losses_destroy(hada_losses *losses);

/* A call: terms of the first `count` of at_once samples, whose scenes stand in HADA_STEP_SCENES; weight: of each in the
 * step's mean; step: names the random numbers of dropout; discriminator_only: only the discriminator learns. */
typedef struct hada_losses_call {
    const hada_sample *samples;
    int count;
    double weight;
    uint64_t step;
    int discriminator_only;
} hada_losses_call;

/* Terms to HADA_STEP_TERMS, the gradient of the output, and that of the discriminator's parameters. */
hada_status hada_losses_run(hada_losses *losses, const hada_losses_call *call, hada_error *err);

#endif
