/* Graphs: making, weights, running. */
#include <stdlib.h>

#include "core/alloc.h"
#include "net/graph_run.h"

hada_tensor hada_graph_value(const hada_graph *graph, int node, int again)
{
    const graph_node *it = &graph->plan.nodes[node];
    if (again && it->dropped)
        return graph->tensors[it->again];
    const graph_node *root = &graph->plan.nodes[it->root];
    return it->root == node ? graph->tensors[root->value]
                            : hada_tensor_channels(&graph->tensors[root->value], it->first, it->channels);
}

hada_tensor hada_graph_gradient(const hada_graph *graph, int node)
{
    const graph_node *it = &graph->plan.nodes[node], *root = &graph->plan.nodes[it->root];
    return it->root == node ? graph->tensors[root->gradient]
                            : hada_tensor_channels(&graph->tensors[root->gradient], it->first, it->channels);
}

hada_tensor hada_graph_colour(const hada_graph *graph, const hada_tensor *tensor, int colour)
{
    hada_tensor view = hada_tensor_images(tensor, colour, graph->plan.options.images);
    view.image_stride *= (size_t)graph->plan.net->colours;
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
    return (hada_batch_norm){.weight = part[0].mem,
                             .bias = part[1].mem,
                             .mean = part[2].mem,
                             .variance = part[3].mem,
                             .weight_offset = part[0].offset,
                             .bias_offset = part[1].offset,
                             .mean_offset = part[2].offset,
                             .variance_offset = part[3].offset,
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

static size_t bytes_of(const graph_plan *plan, const hada_context *context)
{
    size_t bytes = plan->extras * sizeof(float) + plan->norm_scratch;
    for (int i = 0; i < plan->arenas.count; i++)
        bytes += plan->arenas.bytes[i];
    for (int i = 1; i < plan->node_count; i++)
        if (plan->nodes[i].layer->kind == HADA_LAYER_CONV) {
            const hada_conv_desc desc = hada_graph_conv_desc(plan, &plan->nodes[i]);
            bytes += hada_conv_bytes(context, &desc);
        }
    return bytes;
}

hada_status hada_graph_bytes(const hada_context *context, const hada_net *net, const hada_graph_options *options,
                             size_t *bytes, hada_error *err)
{
    graph_plan plan;
    hada_status status = hada_graph_plan_make(&plan, context, net, options, err);
    *bytes = status ? 0 : bytes_of(&plan, context);
    hada_graph_plan_free(&plan);
    return status;
}

/* Zero everywhere: halos that nobody writes stay zero for good. */
static hada_status make_buffer(hada_graph *graph, hada_buffer *buffer, size_t bytes, const char *what, hada_error *err)
{
    if (!bytes)
        return HADA_OK;
    hada_status status = hada_buffer_create(buffer, graph->slot->context, bytes, what, err);
    return status ? status : hada_buffer_clear(buffer, graph->slot, 0, bytes, err);
}

static hada_status make_memory(hada_graph *graph, hada_error *err)
{
    graph_plan *plan = &graph->plan;
    const hada_context *context = graph->slot->context;
    hada_status status =
        hada_alloc((void **)&graph->arenas, (size_t)plan->arenas.count, sizeof *graph->arenas, "a net", err);
    if (!status)
        status = hada_alloc((void **)&graph->tensors, (size_t)plan->piece_count, sizeof *graph->tensors, "a net", err);
    for (int i = 0; !status && i < plan->arenas.count; i++)
        status = make_buffer(graph, &graph->arenas[i], plan->arenas.bytes[i], "the net's activations", err);
    if (!status)
        status = make_buffer(graph, &graph->extras, plan->extras * sizeof(float), "the net's statistics", err);
    if (!status)
        status = make_buffer(graph, &graph->scratch, plan->norm_scratch, "the net's sums", err);
    for (int i = 0; !status && i < plan->piece_count; i++) {
        const graph_piece *piece = &plan->tensors[i];
        graph->tensors[i] =
            hada_tensor_at(context, graph->arenas[plan->pieces[i].arena].mem, plan->pieces[i].offset / sizeof(float),
                           plan->images, piece->channels, piece->rows, piece->cols);
    }
    return status;
}

static hada_status make_convs(hada_graph *graph, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    hada_status status =
        hada_alloc((void **)&graph->convs, (size_t)plan->node_count, sizeof *graph->convs, "a net", err);
    for (int i = 1; !status && i < plan->node_count; i++) {
        if (plan->nodes[i].layer->kind != HADA_LAYER_CONV)
            continue;
        const hada_conv_desc desc = hada_graph_conv_desc(plan, &plan->nodes[i]);
        status = hada_conv_create(&graph->convs[i], graph->slot, &desc, err);
    }
    return status;
}

hada_status hada_graph_create(hada_graph **out, hada_slot *slot, const hada_net *net, const hada_graph_options *options,
                              hada_error *err)
{
    hada_graph *graph;
    *out = NULL;
    hada_status status = hada_alloc((void **)&graph, 1, sizeof *graph, "a net", err);
    if (status)
        return status;
    graph->slot = slot;
    status = hada_graph_plan_make(&graph->plan, slot->context, net, options, err);
    if (!status)
        status = make_memory(graph, err);
    if (!status)
        status = make_convs(graph, err);
    if (status)
        hada_graph_destroy(&graph);
    *out = graph;
    return status;
}

void hada_graph_destroy(hada_graph **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_graph *graph = *pointer;
    *pointer = NULL;
    for (int i = 0; graph->convs && i < graph->plan.node_count; i++)
        hada_conv_destroy(&graph->convs[i]);
    for (int i = 0; graph->arenas && i < graph->plan.arenas.count; i++)
        hada_buffer_destroy(&graph->arenas[i]);
    hada_buffer_destroy(&graph->extras);
    hada_buffer_destroy(&graph->scratch);
    hada_graph_plan_free(&graph->plan);
    free(graph->convs);
    free(graph->arenas);
    free(graph->tensors);
    free(graph);
}

hada_status hada_graph_set_weights(hada_graph *graph, hada_floats values, hada_error *err)
{
    hada_status status = HADA_OK;
    graph->values = values;
    for (int i = 1; !status && i < graph->plan.node_count; i++) {
        if (!graph->convs[i])
            continue;
        const hada_floats weight = hada_graph_parameter(graph, values, i, 0, 0);
        status = hada_conv_set_weights(graph->convs[i], weight.mem, weight.offset, err);
    }
    return status;
}

const hada_tensor *hada_graph_input(const hada_graph *graph)
{
    return &graph->tensors[graph->plan.nodes[0].value];
}

const hada_tensor *hada_graph_output(const hada_graph *graph)
{
    return &graph->tensors[graph->plan.nodes[graph->plan.output].value];
}

const hada_tensor *hada_graph_output_gradient(const hada_graph *graph)
{
    return &graph->tensors[graph->plan.nodes[graph->plan.output].gradient];
}

const hada_tensor *hada_graph_input_gradient(const hada_graph *graph)
{
    return &graph->tensors[graph->plan.nodes[0].gradient];
}

/* Planar images to or from a tensor; the images of a net shared by colours are
 * channels of the caller's. */
static hada_status transfer(hada_graph *graph, const hada_tensor *tensor, const hada_planar *planar, int load,
                            hada_error *err)
{
    const int colours = graph->plan.net->colours, images = colours > 1 ? graph->plan.options.images : 1;
    hada_status status = HADA_OK;
    for (int n = 0; !status && n < images; n++) {
        hada_planar part = *planar;
        hada_tensor view = *tensor;
        if (colours > 1) {
            part.offset += (size_t)n * planar->image_stride;
            part.image_stride = (size_t)tensor->channels * planar->channel_stride;
            view = hada_tensor_images(tensor, n * colours, colours);
        }
        status =
            load ? hada_tensor_load(graph->slot, &part, &view, err) : hada_tensor_store(graph->slot, &view, &part, err);
    }
    return status;
}

hada_status hada_graph_load(hada_graph *graph, const hada_planar *in, hada_error *err)
{
    return transfer(graph, hada_graph_input(graph), in, 1, err);
}

hada_status hada_graph_store(hada_graph *graph, const hada_planar *out, hada_error *err)
{
    return transfer(graph, hada_graph_output(graph), out, 0, err);
}

hada_status hada_graph_load_gradient(hada_graph *graph, const hada_planar *in, hada_error *err)
{
    return transfer(graph, hada_graph_output_gradient(graph), in, 1, err);
}

hada_status hada_graph_store_gradient(hada_graph *graph, const hada_planar *out, hada_error *err)
{
    return transfer(graph, hada_graph_input_gradient(graph), out, 0, err);
}

void hada_graph_set_step(hada_graph *graph, uint64_t seed, uint64_t step)
{
    graph->seed = seed;
    graph->step = step;
}

/* What begins at a step where other things stood before has its halo cleared.
 */
static hada_status clear_halos(hada_graph *graph, int now, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < plan->piece_count; i++)
        if (plan->tensors[i].shared && plan->pieces[i].first == now)
            status = hada_tensor_clear_halo(graph->slot, &graph->tensors[i], err);
    return status;
}

/* Runs the steps from `first` up to the caller's turn or the end. */
static hada_status run(hada_graph *graph, int first, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    hada_status status = HADA_OK;
    for (int i = first; !status && i < plan->step_count; i++) {
        const graph_step *step = &plan->steps[i];
        status = clear_halos(graph, i + 1, err);
        if (step->kind == GRAPH_LOSS)
            break;
        if (!status)
            status = step->kind == GRAPH_BACKWARD ? hada_graph_run_backward(graph, step, err)
                                                  : hada_graph_run_forward(graph, step, err);
        if (status)
            hada_error_prefix(err, "layer %d (%s): ", step->node, plan->nodes[step->node].layer->name);
    }
    return status;
}

hada_status hada_graph_forward(hada_graph *graph, hada_error *err)
{
    if (!graph->values.mem && graph->plan.net->floats)
        return hada_fail(err, HADA_ERROR_STATE, "a net without weights: hada_graph_set_weights() comes first");
    return run(graph, 0, err);
}

hada_status hada_graph_backward(hada_graph *graph, hada_floats gradients, int accumulate, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    if (!plan->options.training || (gradients.mem && !plan->options.weight_gradients))
        return hada_fail(err, HADA_ERROR_STATE, "a graph that was not made for these gradients");
    int first = 0;
    while (plan->steps[first].kind != GRAPH_LOSS)
        first++;
    graph->gradients = gradients;
    graph->accumulate = accumulate;
    return run(graph, first + 1, err);
}
