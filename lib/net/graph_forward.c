/* One layer of a graph forward. */
#include "net/graph_run.h"

/* Behind a batch norm, whose values each colour has of its own. */
static hada_status conv_normed(hada_graph *graph, int i, const hada_tensor *x, hada_floats bias, const hada_tensor *y,
                               hada_error *err)
{
    for (int colour = 0; colour < graph->plan.net->colours; colour++) {
        const hada_batch_norm norm = hada_graph_norm(graph, graph->plan.nodes[i].norm, colour);
        const hada_tensor in = hada_graph_colour(graph, x, colour), out = hada_graph_colour(graph, y, colour);
        HADA_TRY(hada_conv_forward_normed(graph->convs[i], &norm, &in, bias, &out, err));
    }
    return HADA_OK;
}

static hada_status conv(hada_graph *graph, int i, const hada_tensor *x, const hada_tensor *y, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[i];
    hada_floats bias = {0};
    hada_tensor pooled = {0};
    if (node->layer->bias)
        bias = hada_graph_parameter(graph, graph->values, i, 0, 1);
    if (node->fused_pool >= 0)
        pooled = hada_graph_value(graph, node->fused_pool, 0);
    if (node->norm >= 0)
        return conv_normed(graph, i, x, bias, y, err);
    if (node->low >= 0) {
        const hada_tensor low = hada_graph_value(graph, node->low, 0);
        return hada_conv_forward_doubled(graph->convs[i], x, &low, bias, y, node->fused_pool >= 0 ? &pooled : NULL,
                                         err);
    }
    return hada_conv_forward(graph->convs[i], x, bias, y, node->fused_pool >= 0 ? &pooled : NULL, err);
}

static hada_status concat(hada_graph *graph, int i, int for_backward, const hada_tensor *y, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[i];
    int first = 0;
    for (int k = 0; k < node->layer->input_count; k++) {
        const graph_node *part = &graph->plan.nodes[node->inputs[k]];
        if (part->alias_of != i) {
            const hada_tensor x = hada_graph_value(graph, node->inputs[k], for_backward);
            HADA_TRY(hada_place(graph->slot, &x, y, 0, 0, first, 0, err));
        }
        first += part->channels;
    }
    return HADA_OK;
}

static hada_status norm(hada_graph *graph, int i, const hada_tensor *x, const hada_tensor *y, hada_error *err)
{
    for (int colour = 0; colour < graph->plan.net->colours; colour++) {
        const hada_batch_norm norm = hada_graph_norm(graph, i, colour);
        const hada_tensor in = hada_graph_colour(graph, x, colour), out = hada_graph_colour(graph, y, colour);
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
static hada_status linear(hada_graph *graph, int i, const hada_tensor *x, const hada_tensor *y, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    const graph_node *node = &plan->nodes[i];
    const hada_linear shape = {x->images, node->layer->in, node->channels};
    const hada_planar flat_x = hada_graph_flat(graph, x, plan->flat_in);
    const hada_planar flat_y = hada_graph_flat(graph, y, plan->flat_out);
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
    const hada_tensor y = hada_graph_value(graph, step->node, recompute);
    const hada_tensor x = hada_graph_value(graph, node->inputs[0], recompute);
    switch (layer->kind) {
    case HADA_LAYER_CONV: return conv(graph, step->node, &x, &y, err);
    case HADA_LAYER_ACTIVATION: return hada_activation_forward(graph->slot, node->activation, node->slope, &x, &y, err);
    case HADA_LAYER_POOL: return hada_pool_forward(graph->slot, layer->pool, layer->kernel, layer->stride, &x, &y, err);
    case HADA_LAYER_RESIZE: return hada_resize_forward(graph->slot, layer->resize, &x, &y, err);
    case HADA_LAYER_CONCAT: return concat(graph, step->node, recompute, &y, err);
    case HADA_LAYER_NORM: return norm(graph, step->node, &x, &y, err);
    case HADA_LAYER_LINEAR: return linear(graph, step->node, &x, &y, err);
    case HADA_LAYER_DROPOUT:
        /* two dropouts of a net must not draw the same: their places in the list tell them apart */
        return hada_dropout(graph->slot, graph->plan.options.training ? layer->p : 0.0f,
                            graph->seed + ((uint64_t)step->node << 40), graph->step, &x, &y, err);
    case HADA_LAYER_INPUT: break;
    }
    return HADA_OK;
}
