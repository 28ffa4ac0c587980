/* One layer of a graph backward. */
#include "net/graph_run.h"

static hada_floats gradient_of(const hada_graph *graph, int node, int colour, int which)
{
    return hada_graph_parameter(graph, graph->gradients, node, colour, which);
}

static hada_status conv(hada_graph *graph, const graph_step *step, const hada_tensor *dy, const hada_tensor *dx,
                        hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    const int in = node->inputs[0];
    hada_status status = HADA_OK;
    if (graph->gradients.mem) {
        const hada_floats dw = gradient_of(graph, step->node, 0, 0);
        const hada_tensor x = hada_graph_value(graph, in, 1);
        hada_floats db = {0};
        if (node->layer->bias)
            db = gradient_of(graph, step->node, 0, 1);
        status = hada_conv_backward_weights(graph->convs[step->node], &x, dy, dw, db, graph->accumulate, err);
    }
    if (status || !step->wanted[0])
        return status;
    if (!graph->plan.nodes[in].masked)
        return hada_conv_backward_data(graph->convs[step->node], dy, NULL, dx, step->accumulate[0], err);
    const hada_tensor x = hada_graph_value(graph, in, 1);
    return hada_conv_backward_data(graph->convs[step->node], dy, &x, dx, step->accumulate[0], err);
}

static hada_status concat(hada_graph *graph, const graph_step *step, const hada_tensor *dy, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    int first = 0;
    for (int k = 0; k < node->layer->input_count; k++) {
        if (step->wanted[k]) {
            const hada_tensor part = hada_graph_gradient(graph, node->inputs[k]);
            HADA_TRY(hada_place_backward(graph->slot, dy, &part, 0, 0, first, step->accumulate[k], err));
        }
        first += graph->plan.nodes[node->inputs[k]].channels;
    }
    return HADA_OK;
}

static hada_status norm(hada_graph *graph, const graph_step *step, const hada_tensor *dy, const hada_tensor *dx,
                        hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[step->node];
    const hada_tensor x = hada_graph_value(graph, node->inputs[0], 1);
    for (int colour = 0; colour < graph->plan.net->colours; colour++) {
        const hada_batch_norm norm = hada_graph_norm(graph, step->node, colour);
        hada_floats dweight = {graph->extras.mem, graph->plan.unwanted};
        hada_floats dbias = {graph->extras.mem, graph->plan.unwanted + (size_t)node->channels};
        if (graph->gradients.mem) {
            dweight = gradient_of(graph, step->node, colour, 0);
            dbias = gradient_of(graph, step->node, colour, 1);
        }
        const hada_tensor in = hada_graph_colour(graph, &x, colour), din = hada_graph_colour(graph, dx, colour);
        const hada_tensor dout = hada_graph_colour(graph, dy, colour);
        const hada_floats saved = {graph->extras.mem, hada_graph_saved_at(&graph->plan, step->node, colour)};
        HADA_TRY(hada_batch_norm_backward(graph->slot, &norm, &in, saved, &dout, &din, dweight, dbias,
                                          graph->gradients.mem && graph->accumulate, graph->scratch.mem, err));
    }
    return HADA_OK;
}

static hada_status linear(hada_graph *graph, const graph_step *step, const hada_tensor *dy, const hada_tensor *dx,
                          hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    const graph_node *node = &plan->nodes[step->node];
    const hada_linear shape = {plan->images, node->layer->in, node->channels};
    const hada_tensor x = hada_graph_value(graph, node->inputs[0], 1);
    const hada_planar flat_x = hada_graph_flat(graph, &x, plan->flat_in);
    const hada_planar flat_y = hada_graph_flat(graph, dy, plan->flat_out);
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
    case HADA_LAYER_CONV: return conv(graph, step, dy, dx, err);
    case HADA_LAYER_CONCAT: return concat(graph, step, dy, err);
    case HADA_LAYER_NORM: return norm(graph, step, dy, dx, err);
    case HADA_LAYER_LINEAR: return linear(graph, step, dy, dx, err);
    case HADA_LAYER_RESIZE: return hada_resize_backward(graph->slot, layer->resize, dy, dx, accumulate, err);
    case HADA_LAYER_POOL: {
        const hada_tensor x = hada_graph_value(graph, node->inputs[0], 1), y = hada_graph_value(graph, step->node, 1);
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
    const hada_tensor dy = hada_graph_gradient(graph, step->node);
    hada_tensor dx = {0};
    if (step->spare >= 0)
        dx = graph->tensors[step->spare];
    else if (step->wanted[0])
        dx = hada_graph_gradient(graph, node->inputs[0]);
    if (node->activation && !node->masked) {
        const hada_tensor y = hada_graph_value(graph, step->node, 1);
        HADA_TRY(hada_activation_backward(graph->slot, node->activation, node->slope, &y, &dy, &dy, err));
    }
    HADA_TRY(through(graph, step, &dy, &dx, err));
    if (step->spare >= 0 && step->wanted[0]) {
        const hada_tensor sum = hada_graph_gradient(graph, node->inputs[0]);
        HADA_TRY(hada_blend(graph->slot, 1.0f, &dx, 1.0f, &sum, err));
    }
    return HADA_OK;
}
