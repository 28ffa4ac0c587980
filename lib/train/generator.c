#include "train/step.h"

static hada_tensor window_tensor(const hada_generator *generator, hada_step_place place)
{
    const hada_step_images *images = generator->images;
    return hada_step_tensor(images->slot->context, images->shape, generator->net, hada_step_mem(images, place));
}

hada_status hada_generator_create(hada_generator *generator, hada_step_images *images, hada_parameters *parameters,
                                  const hada_replica_desc *desc, hada_error *err)
{
    const hada_replica_shape *shape = images->shape;
    *generator =
        (hada_generator){.images = images, .parameters = parameters, .net = desc->net, .seed = desc->options->seed};
    HADA_TRY(hada_graph_create(&generator->training, images->slot, desc->net, &shape->training, err));
    HADA_TRY(hada_graph_create(&generator->inference, images->slot, desc->net, &shape->inference, err));
    generator->input = window_tensor(generator, HADA_STEP_INPUT);
    generator->output = window_tensor(generator, HADA_STEP_OUTPUT);
    generator->output_gradient = window_tensor(generator, HADA_STEP_OUTPUT_GRADIENT);
    return HADA_OK;
}

void hada_generator_destroy(hada_generator *generator)
{
    hada_graph_destroy(&generator->training);
    hada_graph_destroy(&generator->inference);
}

const hada_tensor *hada_generator_output(const hada_generator *generator)
{
    return generator->images->shape->resized ? &generator->output : hada_graph_output(generator->training);
}

const hada_tensor *hada_generator_output_gradient(const hada_generator *generator)
{
    return generator->images->shape->resized ? &generator->output_gradient
                                             : hada_graph_output_gradient(generator->training);
}

/* Weights that changed since a graph took them over. */
static hada_status take_weights(hada_generator *generator, hada_graph *graph, uint64_t *version, hada_error *err)
{
    const uint64_t now = generator->parameters->group[HADA_GROUP_NET].version;
    if (*version == now)
        return HADA_OK;
    HADA_TRY(hada_graph_set_weights(graph, hada_parameters_values(generator->parameters, HADA_GROUP_NET), err));
    *version = now;
    return HADA_OK;
}

/* The planes to a graph's input, by way of `window` where the sizes differ. */
static hada_status load_planes(hada_generator *generator, hada_graph *graph, const hada_tensor *window, hada_error *err)
{
    const hada_step_images *images = generator->images;
    const int resized = images->shape->resized;
    const hada_tensor *x = hada_graph_input(graph), *first = resized ? window : x;
    const hada_planar planes = hada_planar_like(first, hada_step_mem(images, HADA_STEP_PLANES), 0);
    HADA_TRY(hada_tensor_load(images->slot, &planes, first, err));
    if (resized) {
        HADA_TRY(hada_tensor_clear_halo(images->slot, x, err));
        HADA_TRY(hada_resize_forward(images->slot, HADA_RESIZE_LINEAR, first, x, err));
    }
    return HADA_OK;
}

hada_status hada_generator_forward(hada_generator *generator, uint64_t step, hada_error *err)
{
    const hada_step_images *images = generator->images;
    hada_graph *graph = generator->training;
    hada_slot_stage(images->slot, "net");
    HADA_TRY(take_weights(generator, graph, &generator->training_version, err));
    hada_graph_set_step(graph, generator->seed, step);
    HADA_TRY(load_planes(generator, graph, &generator->input, err));
    HADA_TRY(hada_graph_forward(graph, err));
    if (images->shape->resized)
        HADA_TRY(
            hada_resize_forward(images->slot, HADA_RESIZE_LINEAR, hada_graph_output(graph), &generator->output, err));
    return HADA_OK;
}

hada_status hada_generator_backward(hada_generator *generator, hada_error *err)
{
    const hada_step_images *images = generator->images;
    const hada_floats gradient = hada_parameters_gradient(generator->parameters, HADA_GROUP_NET);
    hada_slot_stage(images->slot, "net");
    if (images->shape->resized)
        HADA_TRY(hada_resize_backward(images->slot, HADA_RESIZE_LINEAR, &generator->output_gradient,
                                      hada_graph_output_gradient(generator->training), 0, err));
    return hada_graph_backward(generator->training, gradient,
                               hada_parameters_accumulates(generator->parameters, HADA_GROUP_NET), err);
}

hada_status hada_generator_infer(hada_generator *generator, hada_error *err)
{
    const hada_step_images *images = generator->images;
    hada_graph *graph = generator->inference;
    const hada_tensor *y = hada_graph_output(graph);
    const hada_tensor window = hada_tensor_images(&generator->input, 0, generator->net->colours);
    const hada_tensor out = hada_tensor_images(&generator->output, 0, generator->net->colours);
    const hada_tensor *last = images->shape->resized ? &out : y;
    const hada_planar plain = hada_planar_like(last, hada_step_mem(images, HADA_STEP_PLAIN), 0);
    hada_slot_stage(images->slot, "inference");
    HADA_TRY(take_weights(generator, graph, &generator->inference_version, err));
    HADA_TRY(load_planes(generator, graph, &window, err));
    HADA_TRY(hada_graph_forward(graph, err));
    HADA_TRY(hada_activation_forward(images->slot, HADA_ACTIVATION_RELU, 0.0f, y, y, err));
    if (images->shape->resized)
        HADA_TRY(hada_resize_forward(images->slot, HADA_RESIZE_LINEAR, y, &out, err));
    return hada_tensor_store(images->slot, last, &plain, err);
}
