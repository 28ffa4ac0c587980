/* The losses of the generator's output, with their gradients: of the output, and of the discriminator. Internal.
 *
 * Graphs run on at_once images; the terms count the first `count` of them, and the others' gradients are zero. */
#ifndef HADA_TRAIN_LOSSES_H
#define HADA_TRAIN_LOSSES_H

#include "train/features.h"
#include "train/generator.h"
#include "train/sample.h"

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
