/* The net of an engine at the window's size: what it sees and gives is resized (bilinear) where it runs at another. */
#include "train/engine_parts.h"

hada_planar hada_engine_plain(const hada_tensor *tensor, cl_mem mem, size_t offset)
{
    const size_t plane = (size_t)tensor->rows * (size_t)tensor->cols;
    return (hada_planar){.mem = mem,
                         .offset = offset,
                         .image_stride = plane * (size_t)tensor->channels,
                         .channel_stride = plane,
                         .row_stride = (size_t)tensor->cols};
}

const hada_tensor *hada_engine_output(const hada_engine *engine)
{
    return engine->shape.resized ? &engine->out : hada_graph_output(engine->train);
}

const hada_tensor *hada_engine_output_gradient(const hada_engine *engine)
{
    return engine->shape.resized ? &engine->fall : hada_graph_output_gradient(engine->train);
}

/* Weights that changed since a graph took them over. */
static hada_status take_weights(hada_engine *engine, hada_graph *graph, int *changed, hada_error *err)
{
    const hada_floats values = {engine->groups[HADA_GROUP_NET].values.mem, 0};
    hada_status status = *changed ? hada_graph_set_weights(graph, values, err) : HADA_OK;
    if (!status)
        *changed = 0;
    return status;
}

/* ENGINE_PLANES to a graph's input, by way of `window` where the sizes differ. */
static hada_status bring(hada_engine *engine, hada_graph *graph, const hada_tensor *window, hada_error *err)
{
    const hada_tensor *x = hada_graph_input(graph), *first = engine->shape.resized ? window : x;
    const hada_planar planes = hada_engine_plain(first, engine->buffers[ENGINE_PLANES].mem, 0);
    hada_status status = hada_tensor_load(engine->slot, &planes, first, err);
    if (!engine->shape.resized)
        return status;
    if (!status)
        status = hada_tensor_clear_halo(engine->slot, x, err);
    return status ? status : hada_resize_forward(engine->slot, HADA_RESIZE_LINEAR, first, x, err);
}

hada_status hada_engine_net_forward(hada_engine *engine, uint64_t step, hada_error *err)
{
    hada_slot_stage(engine->slot, "net");
    hada_status status = take_weights(engine, engine->train, &engine->new_train, err);
    hada_graph_set_step(engine->train, engine->options.seed, step);
    if (!status)
        status = bring(engine, engine->train, &engine->in, err);
    if (!status)
        status = hada_graph_forward(engine->train, err);
    if (!status && engine->shape.resized)
        status =
            hada_resize_forward(engine->slot, HADA_RESIZE_LINEAR, hada_graph_output(engine->train), &engine->out, err);
    return status;
}

hada_status hada_engine_net_backward(hada_engine *engine, hada_error *err)
{
    const hada_floats gradient = {engine->groups[HADA_GROUP_NET].gradient.mem, 0};
    hada_status status = HADA_OK;
    hada_slot_stage(engine->slot, "net");
    if (engine->shape.resized)
        status = hada_resize_backward(engine->slot, HADA_RESIZE_LINEAR, &engine->fall,
                                      hada_graph_output_gradient(engine->train), 0, err);
    if (!status)
        status = hada_graph_backward(engine->train, gradient, hada_engine_accumulates(engine, HADA_GROUP_NET), err);
    if (status || !engine->shape.filters)
        return status;
    const hada_tensor *fall = hada_graph_input_gradient(engine->train);
    if (engine->shape.resized) { /* what the net saw is not needed any more */
        status = hada_resize_backward(engine->slot, HADA_RESIZE_LINEAR, fall, &engine->in, 0, err);
        fall = &engine->in;
    }
    const hada_planar flat = hada_engine_plain(fall, engine->buffers[ENGINE_FLAT].mem, 0);
    return status ? status : hada_tensor_store(engine->slot, fall, &flat, err);
}

hada_status hada_engine_net_look(hada_engine *engine, hada_error *err)
{
    const hada_tensor *y = hada_graph_output(engine->look);
    const hada_tensor window = hada_tensor_images(&engine->in, 0, engine->net->colours);
    const hada_tensor out = hada_tensor_images(&engine->out, 0, engine->net->colours);
    const hada_tensor *last = engine->shape.resized ? &out : y;
    const hada_planar flat = hada_engine_plain(last, engine->buffers[ENGINE_FLAT].mem, 0);
    hada_slot_stage(engine->slot, "look");
    hada_status status = take_weights(engine, engine->look, &engine->new_look, err);
    if (!status)
        status = bring(engine, engine->look, &window, err);
    if (!status)
        status = hada_graph_forward(engine->look, err);
    if (!status)
        status = hada_activation_forward(engine->slot, HADA_ACTIVATION_RELU, 0.0f, y, y, err);
    if (!status && engine->shape.resized)
        status = hada_resize_forward(engine->slot, HADA_RESIZE_LINEAR, y, &out, err);
    return status ? status : hada_tensor_store(engine->slot, last, &flat, err);
}
