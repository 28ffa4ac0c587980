/* What a node of a graph works on: tensors and parameters. */
#include "net/graph_run.h"

hada_tensor hada_graph_value(const hada_graph *graph, int node, int for_backward)
{
    const graph_node *it = &graph->plan.nodes[node];
    if (for_backward && it->recompute)
        return graph->tensors[it->recomputed];
    const graph_node *whole = &graph->plan.nodes[it->alias_of];
    return it->alias_of == node ? graph->tensors[whole->value]
                                : hada_tensor_channels(&graph->tensors[whole->value], it->alias_channel, it->channels);
}

hada_tensor hada_graph_gradient(const hada_graph *graph, int node)
{
    const graph_node *it = &graph->plan.nodes[node], *whole = &graph->plan.nodes[it->alias_of];
    return it->alias_of == node
               ? graph->tensors[whole->gradient]
               : hada_tensor_channels(&graph->tensors[whole->gradient], it->alias_channel, it->channels);
}

hada_tensor hada_graph_colour(const hada_graph *graph, const hada_tensor *tensor, int colour)
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

hada_batch_norm hada_graph_norm(const hada_graph *graph, int node, int colour)
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

hada_planar hada_graph_flat(const hada_graph *graph, const hada_tensor *tensor, size_t offset)
{
    const size_t cols = (size_t)tensor->cols, plane = cols * (size_t)tensor->rows;
    return (hada_planar){.mem = graph->extras.mem,
                         .offset = offset,
                         .image_stride = plane * (size_t)tensor->channels,
                         .channel_stride = plane,
                         .row_stride = cols};
}
