/* One layer of a graph, forward or backward: the tensors and parameters of its node, and the launches. */
#include "net/graph_plan.h"

/* The value of a node; for_backward: the recomputed one where there is one. */
static hada_tensor value_of(const hada_graph *graph, int node, int for_backward)
{
    const graph_node *it = &graph->plan.nodes[node];
    if (for_backward && it->recompute)
        return graph->tensors[it->recomputed];
    const graph_node *whole = &graph->plan.nodes[it->alias_of];
    return it->alias_of == node ? graph->tensors[whole->value]
                                : hada_tensor_channels(&graph->tensors[whole->value], it->alias_channel, it->channels);
}

static hada_tensor gradient_tensor(const hada_graph *graph, int node)
{
    const graph_node *it = &graph->plan.nodes[node], *whole = &graph->plan.nodes[it->alias_of];
    return it->alias_of == node
               ? graph->tensors[whole->gradient]
               : hada_tensor_channels(&graph->tensors[whole->gradient], it->alias_channel, it->channels);
}

/* The images of one colour among those of all. */
static hada_tensor colour_of(const hada_graph *graph, const hada_tensor *tensor, int colour)
{
    const int colours = graph->plan.net->colours;
    hada_tensor view = hada_tensor_images(tensor, colour, tensor->images / colours);
    view.image_stride *= (size_t)colours;
    return view;
}

hada_floats hada_graph_parameter(const hada_graph *graph, hada_floats all, int node, int colour, int which)
{
    return (hada_floats){all.mem, all.offset + hada_net_parameter(graph->plan.net, node, colour, which)->offset};
}

/* The batch norm of one colour. */
static hada_batch_norm norm_of(const hada_graph *graph, int node, int colour)
{
    const hada_layer *layer = graph->plan.nodes[node].layer;
    hada_floats part[4];
    for (int i = 0; i < 4; i++)
        part[i] = hada_graph_parameter(graph, graph->values, node, colour, i);
    return (hada_batch_norm){.weight = part[0],
                             .bias = part[1],
                             .mean = part[2],
                             .variance = part[3],
                             .eps = layer->eps,
                             .momentum = layer->momentum};
}

/* An image's values in channel, row, column order, one image after the other. */
static hada_planar flat_of(const hada_graph *graph, const hada_tensor *tensor, size_t offset)
{
    const size_t cols = (size_t)tensor->cols, plane = cols * (size_t)tensor->rows;
    return (hada_planar){.mem = graph->extras.mem,
                         .offset = offset,
                         .image_stride = plane * (size_t)tensor->channels,
                         .channel_stride = plane,
                         .row_stride = cols};
}

static hada_status conv_forward(hada_graph *graph, int i, const hada_tensor *x, const hada_tensor *y, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[i];
    hada_floats bias = {0};
    hada_tensor pooled = {0};
    if (node->layer->bias)
        bias = hada_graph_parameter(graph, graph->values, i, 0, 1);
    if (node->fused_pool >= 0)
        pooled = value_of(graph, node->fused_pool, 0);
    if (node->low >= 0) {
        const hada_tensor low = value_of(graph, node->low, 0);
        return hada_conv_forward_doubled(graph->convs[i], x, &low, bias, y, node->fused_pool >= 0 ? &pooled : NULL,
                                         err);
    }
    return hada_conv_forward(graph->convs[i], x, bias, y, node->fused_pool >= 0 ? &pooled : NULL, err);
}

static hada_status concat_forward(hada_graph *graph, int i, int for_backward, const hada_tensor *y, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[i];
    int first = 0;
    for (int k = 0; k < node->layer->input_count; k++) {
        const graph_node *part = &graph->plan.nodes[node->inputs[k]];
        if (part->alias_of != i) {
            const hada_tensor x = value_of(graph, node->inputs[k], for_backward);
            HADA_TRY(hada_place(graph->slot, &x, y, 0, 0, first, 0, err));
        }
        first += part->channels;
    }
    return HADA_OK;
}

static hada_status norm_forward(hada_graph *graph, int i, const hada_tensor *x, const hada_tensor *y, hada_error *err)
{
    for (int colour = 0; colour < graph->plan.net->colours; colour++) {
        const hada_batch_norm norm = norm_of(graph, i, colour);
        const hada_tensor in = colour_of(graph, x, colour), out = colour_of(graph, y, colour);
        if (graph->plan.options.training)
            HADA_TRY(
                hada_batch_norm_train(graph->slot, &norm, &in, &out,
                                      (hada_floats){graph->extras.mem, hada_graph_saved_at(&graph->plan, i, colour)},
                                      graph->scratch.mem, err));
        else
            HADA_TRY(hada_batch_norm_infer(graph->slot, &norm, &in, &out, err));
    }
    return HADA_OK;
}

/* Linear layers work on plain floats: values are brought there and back. */
static hada_status linear_forward(hada_graph *graph, int i, const hada_tensor *x, const hada_tensor *y, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    const graph_node *node = &plan->nodes[i];
    const hada_linear shape = {x->images, node->layer->in, node->channels};
    const hada_planar flat_x = flat_of(graph, x, plan->flat_in);
    const hada_planar flat_y = flat_of(graph, y, plan->flat_out);
    const hada_floats weight = hada_graph_parameter(graph, graph->values, i, 0, 0);
    hada_floats bias = {0};
    if (node->layer->bias)
        bias = hada_graph_parameter(graph, graph->values, i, 0, 1);
    HADA_TRY(hada_tensor_store(graph->slot, x, &flat_x, err));
    HADA_TRY(hada_linear_forward(graph->slot, &shape, weight, bias, (hada_floats){flat_x.mem, flat_x.offset},
                                 (hada_floats){flat_y.mem, flat_y.offset}, err));
    HADA_TRY(hada_tensor_load(graph->slot, &flat_y, y, err));
    if (node->activation)
        HADA_TRY(hada_activation_forward(graph->slot, node->activation, node->slope, y, y, err));
    return HADA_OK;
}

hada_status hada_graph_run_forward(hada_graph *graph, const graph_step *step, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    const hada_layer *layer = node->layer;
    const int recompute = step->kind == GRAPH_RECOMPUTE;
    const hada_tensor y = value_of(graph, step->node, recompute);
    const hada_tensor x = value_of(graph, node->inputs[0], recompute);
    switch (layer->kind) {
    case HADA_LAYER_CONV: return conv_forward(graph, step->node, &x, &y, err);
    case HADA_LAYER_ACTIVATION: return hada_activation_forward(graph->slot, node->activation, node->slope, &x, &y, err);
    case HADA_LAYER_POOL: return hada_pool_forward(graph->slot, layer->pool, layer->kernel, layer->stride, &x, &y, err);
    case HADA_LAYER_RESIZE: return hada_resize_forward(graph->slot, layer->resize, &x, &y, err);
    case HADA_LAYER_CONCAT: return concat_forward(graph, step->node, recompute, &y, err);
    case HADA_LAYER_NORM: return norm_forward(graph, step->node, &x, &y, err);
    case HADA_LAYER_LINEAR: return linear_forward(graph, step->node, &x, &y, err);
    case HADA_LAYER_DROPOUT:
        /* two dropouts of a net must not draw the same: their places in the list tell them apart */
        return hada_dropout(graph->slot, graph->plan.options.training ? layer->p : 0.0f,
                            graph->seed + ((uint64_t)step->node << 40), graph->step, &x, &y, err);
    case HADA_LAYER_INPUT: break;
    }
    return HADA_OK;
}

static hada_floats gradient_of(const hada_graph *graph, int node, int colour, int which)
{
    return hada_graph_parameter(graph, graph->gradients, node, colour, which);
}

static hada_status conv_backward(hada_graph *graph, const graph_step *step, const hada_tensor *dy,
                                 const hada_tensor *dx, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    const int in = node->inputs[0];
    hada_status status = HADA_OK;
    if (graph->gradients.mem) {
        const hada_floats dw = gradient_of(graph, step->node, 0, 0);
        const hada_tensor x = value_of(graph, in, 1);
        hada_floats db = {0};
        if (node->layer->bias)
            db = gradient_of(graph, step->node, 0, 1);
        status = hada_conv_backward_weights(graph->convs[step->node], &x, dy, dw, db, graph->accumulate, err);
    }
    if (status || !step->wanted[0])
        return status;
    if (!graph->plan.nodes[in].masked)
        return hada_conv_backward_data(graph->convs[step->node], dy, NULL, dx, step->accumulate[0], err);
    const hada_tensor x = value_of(graph, in, 1);
    return hada_conv_backward_data(graph->convs[step->node], dy, &x, dx, step->accumulate[0], err);
}

static hada_status concat_backward(hada_graph *graph, const graph_step *step, const hada_tensor *dy, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    int first = 0;
    for (int k = 0; k < node->layer->input_count; k++) {
        if (step->wanted[k]) {
            const hada_tensor part = gradient_tensor(graph, node->inputs[k]);
            HADA_TRY(hada_place_backward(graph->slot, dy, &part, 0, 0, first, step->accumulate[k], err));
        }
        first += graph->plan.nodes[node->inputs[k]].channels;
    }
    return HADA_OK;
}

static hada_status norm_backward(hada_graph *graph, const graph_step *step, const hada_tensor *dy,
                                 const hada_tensor *dx, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    const hada_tensor x = value_of(graph, node->inputs[0], 1);
    for (int colour = 0; colour < graph->plan.net->colours; colour++) {
        const hada_batch_norm norm = norm_of(graph, step->node, colour);
        hada_floats dweight = {graph->extras.mem, graph->plan.unwanted};
        hada_floats dbias = {graph->extras.mem, graph->plan.unwanted + (size_t)node->channels};
        if (graph->gradients.mem) {
            dweight = gradient_of(graph, step->node, colour, 0);
            dbias = gradient_of(graph, step->node, colour, 1);
        }
        const hada_tensor in = colour_of(graph, &x, colour), din = colour_of(graph, dx, colour);
        const hada_tensor dout = colour_of(graph, dy, colour);
        const hada_floats saved = {graph->extras.mem, hada_graph_saved_at(&graph->plan, step->node, colour)};
        HADA_TRY(hada_batch_norm_backward(graph->slot, &norm, &in, saved, &dout, &din, dweight, dbias,
                                          graph->gradients.mem && graph->accumulate, graph->scratch.mem, err));
    }
    return HADA_OK;
}

static hada_status linear_backward(hada_graph *graph, const graph_step *step, const hada_tensor *dy,
                                   const hada_tensor *dx, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    const graph_node *node = &plan->nodes[step->node];
    const hada_linear shape = {plan->images, node->layer->in, node->channels};
    const hada_tensor x = value_of(graph, node->inputs[0], 1);
    const hada_planar flat_x = flat_of(graph, &x, plan->flat_in);
    const hada_planar flat_y = flat_of(graph, dy, plan->flat_out);
    const hada_floats in = {flat_x.mem, flat_x.offset}, out = {flat_y.mem, flat_y.offset};
    HADA_TRY(hada_tensor_store(graph->slot, dy, &flat_y, err));
    if (graph->gradients.mem) {
        hada_floats db = {0};
        if (node->layer->bias)
            db = gradient_of(graph, step->node, 0, 1);
        HADA_TRY(hada_tensor_store(graph->slot, &x, &flat_x, err));
        HADA_TRY(hada_linear_backward_weights(graph->slot, &shape, in, out, gradient_of(graph, step->node, 0, 0), db,
                                              graph->accumulate, err));
    }
    if (step->wanted[0]) {
        const hada_floats weight = hada_graph_parameter(graph, graph->values, step->node, 0, 0);
        HADA_TRY(hada_linear_backward_data(graph->slot, &shape, weight, out, in, err));
        HADA_TRY(hada_tensor_load(graph->slot, &flat_x, dx, err));
    }
    return HADA_OK;
}

/* dx takes what this layer gives for its first input. */
static hada_status through(hada_graph *graph, const graph_step *step, const hada_tensor *dy, const hada_tensor *dx,
                           hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    const hada_layer *layer = node->layer;
    const int accumulate = step->accumulate[0];
    switch (layer->kind) {
    case HADA_LAYER_CONV: return conv_backward(graph, step, dy, dx, err);
    case HADA_LAYER_CONCAT: return concat_backward(graph, step, dy, err);
    case HADA_LAYER_NORM: return norm_backward(graph, step, dy, dx, err);
    case HADA_LAYER_LINEAR: return linear_backward(graph, step, dy, dx, err);
    case HADA_LAYER_RESIZE: return hada_resize_backward(graph->slot, layer->resize, dy, dx, accumulate, err);
    case HADA_LAYER_POOL: {
        const hada_tensor x = value_of(graph, node->inputs[0], 1), y = value_of(graph, step->node, 1);
        return hada_pool_backward(graph->slot, layer->pool, layer->kernel, layer->stride, &x, &y, dy, dx, accumulate,
                                  err);
    }
    case HADA_LAYER_DROPOUT:
        return hada_dropout(graph->slot, layer->p, graph->seed + ((uint64_t)step->node << 40), graph->step, dy, dx,
                            err);
    case HADA_LAYER_ACTIVATION: return hada_blend(graph->slot, 1.0f, dy, 0.0f, dx, err); /* done before */
    case HADA_LAYER_INPUT: break;
    }
    return HADA_OK;
}

hada_status hada_graph_run_backward(hada_graph *graph, const graph_step *step, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    const hada_tensor dy = gradient_tensor(graph, step->node);
    hada_tensor dx = {0};
    if (step->spare >= 0)
        dx = graph->tensors[step->spare];
    else if (step->wanted[0])
        dx = gradient_tensor(graph, node->inputs[0]);
    if (node->activation && !node->masked) {
        const hada_tensor y = value_of(graph, step->node, 1);
        HADA_TRY(hada_activation_backward(graph->slot, node->activation, node->slope, &y, &dy, &dy, err));
    }
    HADA_TRY(through(graph, step, &dy, &dx, err));
    if (step->spare >= 0 && step->wanted[0]) {
        const hada_tensor sum = gradient_tensor(graph, node->inputs[0]);
        HADA_TRY(hada_blend(graph->slot, 1.0f, &dx, 1.0f, &sum, err));
    }
    return HADA_OK;
}
