/* What inference leaves to the convolution behind it, so that it is never written: on the way up of a U-net bilinear
 * doubling and the concatenation with it; a batch norm. */
#include "net/graph_plan.h"

static int same_size(const graph_node *a, const graph_node *b)
{
    return a->rows == b->rows && a->cols == b->cols;
}

/* A resizing to twice the size for the second part of a concatenation that a convolution reads, and nobody else. */
static void try_doubling(graph_plan *plan, const hada_context *context, int resize)
{
    graph_node *high = &plan->nodes[resize];
    const int low = high->inputs[0], concat = hada_graph_only_reader(plan, resize);
    if (high->layer->resize != HADA_RESIZE_LINEAR || high->rows != 2 * plan->nodes[low].rows ||
        high->cols != 2 * plan->nodes[low].cols || concat < 0)
        return;
    graph_node *whole = &plan->nodes[concat];
    const int reader = hada_graph_only_reader(plan, concat), before = whole->inputs[0];
    if (whole->layer->kind != HADA_LAYER_CONCAT || whole->layer->input_count != 2 || whole->inputs[1] != resize ||
        before == resize || !same_size(whole, high) || !same_size(whole, &plan->nodes[before]) || reader < 0)
        return;
    graph_node *conv = &plan->nodes[reader], kept = *conv;
    if (conv->layer->kind != HADA_LAYER_CONV)
        return;
    conv->inputs[0] = before;
    conv->low = low;
    const hada_conv_desc desc = hada_graph_conv_desc(plan, conv);
    if (hada_conv_doubles(context, &desc))
        high->fused = whole->fused = 1;
    else
        *conv = kept;
}

/* A batch norm that a convolution reads, and nobody else. */
static void try_norm(graph_plan *plan, const hada_context *context, int norm)
{
    const int reader = hada_graph_only_reader(plan, norm);
    if (reader < 0 || plan->nodes[reader].layer->kind != HADA_LAYER_CONV || plan->nodes[reader].fused_pool >= 0 ||
        plan->nodes[reader].low >= 0)
        return;
    graph_node *conv = &plan->nodes[reader];
    const hada_conv_desc desc = hada_graph_conv_desc(plan, conv);
    if (!hada_conv_norms(context, &desc))
        return;
    conv->inputs[0] = plan->nodes[norm].inputs[0];
    conv->norm = norm;
    plan->nodes[norm].fused = 1;
}

void hada_graph_fuse_inference(graph_plan *plan, const hada_context *context)
{
    for (int i = 1; i < plan->node_count; i++)
        if (plan->nodes[i].layer->kind == HADA_LAYER_RESIZE)
            try_doubling(plan, context, i);
        else if (plan->nodes[i].layer->kind == HADA_LAYER_NORM)
            try_norm(plan, context, i);
}
