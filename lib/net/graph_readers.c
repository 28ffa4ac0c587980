/* What a node of a plan reads: which nodes read a value, and the convolution that a node is of what it reads. */
#include "net/graph_plan.h"

int hada_graph_reads(const graph_node *node, int value)
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

int hada_graph_readers_of(const graph_plan *plan, int value)
{
    int count = 0;
    for (int i = value + 1; i < plan->node_count; i++)
        count += hada_graph_reads(&plan->nodes[i], value);
    return count;
}

int hada_graph_only_reader(const graph_plan *plan, int value)
{
    if (value == plan->output || hada_graph_readers_of(plan, value) != 1)
        return -1;
    int reader = value + 1;
    while (!hada_graph_reads(&plan->nodes[reader], value))
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
