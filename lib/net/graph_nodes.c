/* The nodes of a graph: what is fused into one launch, and which values alias the memory of another. In inference
 * convolutions also take over bilinear doubling and concatenation (the way up of a U-net) before them, whose results
 * are then never written. */

#include "net/graph_plan.h"

/* Whether a node that is not fused reads a value. */
static int reads(const graph_node *node, int value)
{
    if (node->fused)
        return 0;
    if (node->low == value)
        return 1;
    for (int i = 0; i < node->layer->input_count; i++)
        if (node->inputs[i] == value)
            return 1;
    return 0;
}

static int readers_of(const graph_plan *plan, int value)
{
    int count = 0;
    for (int i = value + 1; i < plan->node_count; i++)
        count += reads(&plan->nodes[i], value);
    return count;
}

/* The node that alone reads a value; -1: none or several, or it is the output. */
static int only_reader(const graph_plan *plan, int value)
{
    if (value == plan->output || readers_of(plan, value) != 1)
        return -1;
    int reader = value + 1;
    while (!reads(&plan->nodes[reader], value))
        reader++;
    return reader;
}

hada_conv_desc hada_graph_conv_desc(const graph_plan *plan, const graph_node *node)
{
    const graph_node *in = &plan->nodes[node->inputs[0]];
    const int doubled = node->low >= 0 ? plan->nodes[node->low].channels : 0;
    const hada_layer *layer = node->layer;
    return (hada_conv_desc){.images = plan->images,
                            .in_channels = in->channels + doubled,
                            .out_channels = node->channels,
                            .in_rows = in->rows,
                            .in_cols = in->cols,
                            .kernel_rows = layer->kernel,
                            .kernel_cols = layer->kernel,
                            .stride = layer->stride,
                            .pad_rows = layer->pad,
                            .pad_cols = layer->pad,
                            .transposed = layer->transposed,
                            .output_pad = layer->output_pad,
                            .activation = node->activation,
                            .slope = node->slope,
                            .method = plan->options.method,
                            .training = plan->options.training,
                            .doubled = doubled};
}

/* An activation that alone takes what a convolution or linear layer without one gives. */
static void fuse_activations(graph_plan *plan)
{
    for (int i = 1; i < plan->node_count; i++) {
        graph_node *node = &plan->nodes[i];
        if (node->layer->kind != HADA_LAYER_ACTIVATION)
            continue;
        const int before = node->inputs[0];
        graph_node *giver = &plan->nodes[before];
        const hada_layer_kind kind = giver->layer->kind;
        if ((kind != HADA_LAYER_CONV && kind != HADA_LAYER_LINEAR) || giver->activation ||
            readers_of(plan, before) != 1)
            continue;
        giver->activation = node->activation;
        giver->slope = node->slope;
        node->fused = 1;
        for (int k = i + 1; k < plan->node_count; k++)
            for (int n = 0; n < plan->nodes[k].layer->input_count; n++)
                if (plan->nodes[k].inputs[n] == i)
                    plan->nodes[k].inputs[n] = before;
        if (plan->output == i)
            plan->output = before;
    }
}

static void fuse_pooling(graph_plan *plan)
{
    for (int i = 1; i < plan->node_count; i++) {
        graph_node *node = &plan->nodes[i];
        const hada_layer *layer = node->layer;
        if (layer->kind != HADA_LAYER_POOL || layer->pool != HADA_POOL_MAX || layer->kernel != 2 || layer->stride != 2)
            continue;
        graph_node *before = &plan->nodes[node->inputs[0]];
        if (before->layer->kind != HADA_LAYER_CONV || before->layer->transposed || before->fused_pool >= 0)
            continue;
        before->fused_pool = i;
        node->pooled = 1;
    }
}

/* Whether a value may alias a part of a concatenation: all its other readers come before the concatenation, so that in
 * backward the gradient of the whole is there first. */
static int can_alias(const graph_plan *plan, int value, int concat)
{
    const graph_node *node = &plan->nodes[value], *whole = &plan->nodes[concat];
    int times = 0;
    if (!value || node->alias_of != value || node->layer->kind == HADA_LAYER_CONCAT || node->rows != whole->rows ||
        node->cols != whole->cols)
        return 0;
    for (int i = concat + 1; i < plan->node_count; i++)
        if (reads(&plan->nodes[i], value))
            return 0;
    for (int i = 0; i < whole->layer->input_count; i++)
        times += whole->inputs[i] == value;
    return times == 1;
}

static void alias_concats(graph_plan *plan)
{
    for (int i = 1; i < plan->node_count; i++) {
        const graph_node *whole = &plan->nodes[i];
        if (whole->fused || whole->layer->kind != HADA_LAYER_CONCAT)
            continue;
        int first = 0;
        for (int k = 0; k < whole->layer->input_count; k++) {
            graph_node *part = &plan->nodes[whole->inputs[k]];
            /* whole blocks, so that no part holds another's channels in its last one */
            const int whole_blocks = part->channels % plan->block == 0 || k == whole->layer->input_count - 1;
            if (first % plan->block == 0 && whole_blocks && can_alias(plan, whole->inputs[k], i)) {
                part->alias_of = i;
                part->alias_channel = first;
            }
            first += part->channels;
        }
    }
}

static int has_parts(const graph_plan *plan, int value)
{
    for (int i = 0; i < plan->node_count; i++)
        if (i != value && plan->nodes[i].alias_of == value)
            return 1;
    return 0;
}

/* A level is a run of layers of one size. A value that only its own level reads is recomputed. */
static void recompute_inside_levels(graph_plan *plan, int *level)
{
    for (int i = 1; i < plan->node_count; i++) {
        const graph_node *node = &plan->nodes[i], *before = &plan->nodes[i - 1];
        level[i] = level[i - 1] + (i == 1 || node->rows != before->rows || node->cols != before->cols);
    }
    for (int i = 1; i < plan->node_count; i++) {
        graph_node *node = &plan->nodes[i];
        const hada_layer_kind kind = node->layer->kind;
        node->recompute = !node->fused && i != plan->output && node->alias_of == i && node->fused_pool < 0 &&
                          (kind == HADA_LAYER_CONV || kind == HADA_LAYER_ACTIVATION || kind == HADA_LAYER_RESIZE ||
                           kind == HADA_LAYER_CONCAT) &&
                          !has_parts(plan, i);
        for (int k = i + 1; k < plan->node_count; k++)
            if (reads(&plan->nodes[k], i) && level[k] != level[i])
                node->recompute = 0;
    }
}

static void find_gradients(graph_plan *plan)
{
    for (int i = 0; i < plan->node_count; i++) {
        graph_node *node = &plan->nodes[i];
        node->needs_gradient =
            i ? plan->options.weight_gradients && node->layer->parameter >= 0 : plan->options.input_gradient;
        for (int k = 0; k < node->layer->input_count; k++)
            node->needs_gradient |= plan->nodes[node->inputs[k]].needs_gradient;
    }
    for (int i = 1; i < plan->node_count; i++) {
        graph_node *node = &plan->nodes[i];
        node->masked = node->activation == HADA_ACTIVATION_RELU && i != plan->output && node->alias_of == i;
        for (int k = i + 1; k < plan->node_count; k++)
            if (reads(&plan->nodes[k], i) && plan->nodes[k].layer->kind != HADA_LAYER_CONV)
                node->masked = 0;
    }
}

static int same_size(const graph_node *a, const graph_node *b)
{
    return a->rows == b->rows && a->cols == b->cols;
}

/* A resizing to twice the size for the second part of a concatenation that a convolution reads, and nobody else. */
static void try_doubling(graph_plan *plan, const hada_context *context, int resize)
{
    graph_node *high = &plan->nodes[resize];
    const int low = high->inputs[0], concat = only_reader(plan, resize);
    if (high->layer->resize != HADA_RESIZE_LINEAR || high->rows != 2 * plan->nodes[low].rows ||
        high->cols != 2 * plan->nodes[low].cols || concat < 0)
        return;
    graph_node *whole = &plan->nodes[concat];
    const int reader = only_reader(plan, concat), before = whole->inputs[0];
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

static void fuse_inference(graph_plan *plan, const hada_context *context)
{
    for (int i = 1; i < plan->node_count; i++)
        if (plan->nodes[i].layer->kind == HADA_LAYER_RESIZE)
            try_doubling(plan, context, i);
}

hada_status hada_graph_nodes_make(graph_plan *plan, const hada_context *context, hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_net *net = plan->net;
    const size_t count = (size_t)net->count;
    hada_size *sizes = NULL;
    int *level = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(plan->nodes, count, "a net's plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(sizes, count, "a net's plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(level, count, "a net's plan", err));
    HADA_TRY_OR_DONE(hada_net_sizes(net, plan->options.rows, plan->options.cols, sizes, err));
    plan->node_count = net->count;
    plan->output = net->count - 1;
    for (int i = 0; i < net->count; i++) {
        const hada_layer *layer = &net->layers[i];
        graph_node *node = &plan->nodes[i];
        *node = (graph_node){.layer = layer,
                             .channels = layer->channels,
                             .rows = sizes[i].rows,
                             .cols = sizes[i].cols,
                             .fused_pool = -1,
                             .low = -1,
                             .activation = layer->activation,
                             .slope = layer->slope,
                             .alias_of = i,
                             .value = -1,
                             .recomputed = -1,
                             .gradient = -1};
        for (int k = 0; k < layer->input_count; k++)
            node->inputs[k] = layer->inputs[k];
    }
    fuse_activations(plan);
    fuse_pooling(plan);
    if (!plan->options.training)
        fuse_inference(plan, context);
    alias_concats(plan);
    if (plan->options.training)
        find_gradients(plan);
    if (plan->options.training && plan->options.recompute)
        recompute_inside_levels(plan, level);
done:
    HADA_FREE(level, sizes);
    return status;
}
