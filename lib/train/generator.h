/* The net that training improves, at the window's size: what it takes and gives is resized (bilinear) where it runs at
 * another. Internal. */
#ifndef HADA_TRAIN_GENERATOR_H
#define HADA_TRAIN_GENERATOR_H

#include "train/parameters.h"

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

/* From the gradient of the output on; joint: the gradient of its input goes to HADA_STEP_PLAIN. */
hada_status hada_generator_backward(hada_generator *generator, hada_error *err);

/* As in reconstruction: the first image of HADA_STEP_PLANES, to HADA_STEP_PLAIN. */
hada_status hada_generator_infer(hada_generator *generator, hada_error *err);

/* The output at the window's size, and its gradient. */
const hada_tensor *hada_generator_output(const hada_generator *generator);
const hada_tensor *hada_generator_output_gradient(const hada_generator *generator);

#endif
