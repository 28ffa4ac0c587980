/* Graphs: making, weights, running. */

#include "net/conv.h"
#include "net/graph_plan.h"

/* Zero everywhere: halos that nobody writes stay zero for good. */
static hada_status make_buffer(hada_graph *graph, hada_buffer *buffer, size_t bytes, const char *what, hada_error *err)
{
    if (!bytes)
        return HADA_OK;
    HADA_TRY(hada_buffer_create(buffer, graph->slot->context, bytes, what, err));
    return hada_buffer_clear(buffer, graph->slot, 0, bytes, err);
}

static hada_status make_memory(hada_graph *graph, hada_error *err)
{
    graph_plan *plan = &graph->plan;
    const hada_context *context = graph->slot->context;
    HADA_TRY(HADA_NEW(graph->arenas, (size_t)plan->arenas.count, "a net", err));
    HADA_TRY(HADA_NEW(graph->tensors, (size_t)plan->piece_count, "a net", err));
    for (int i = 0; i < plan->arenas.count; i++)
        HADA_TRY(make_buffer(graph, &graph->arenas[i], plan->arenas.bytes[i], "the net's activations", err));
    HADA_TRY(make_buffer(graph, &graph->extras, plan->extras * sizeof(float), "the net's statistics", err));
    HADA_TRY(make_buffer(graph, &graph->scratch, plan->norm_scratch, "the net's sums", err));
    for (int i = 0; i < plan->piece_count; i++) {
        const graph_piece *piece = &plan->tensors[i];
        graph->tensors[i] =
            hada_tensor_at(context, graph->arenas[plan->pieces[i].arena].mem, plan->pieces[i].offset / sizeof(float),
                           plan->images, piece->channels, piece->rows, piece->cols);
    }
    return HADA_OK;
}

static hada_status make_convs(hada_graph *graph, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    HADA_TRY(HADA_NEW(graph->convs, (size_t)plan->node_count, "a net", err));
    for (int i = 1; i < plan->node_count; i++) {
        if (plan->nodes[i].layer->kind != HADA_LAYER_CONV)
            continue;
        const hada_conv_desc desc = hada_graph_conv_desc(plan, &plan->nodes[i]);
        HADA_TRY(hada_conv_create(&graph->convs[i], graph->slot, &desc, err));
    }
    return HADA_OK;
}

hada_status hada_graph_create(hada_graph **out, hada_slot *slot, const hada_net *net, const hada_graph_options *options,
                              hada_error *err)
{
    hada_status status = HADA_OK;
    hada_graph *graph = NULL;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(graph, 1, "a net", err));
    graph->slot = slot;
    HADA_TRY_OR_DONE(hada_conv_tf32_try(slot, err)); /* what serves has to stand before plans are made */
    HADA_TRY_OR_DONE(hada_graph_plan_make(&graph->plan, slot->context, net, options, err));
    HADA_TRY_OR_DONE(make_memory(graph, err));
    HADA_TRY_OR_DONE(make_convs(graph, err));
done:
    if (status)
        hada_graph_destroy(&graph);
    *out = graph;
    return status;
}

hada_status hada_graph_bytes(const hada_context *context, const hada_net *net, const hada_graph_options *options,
                             size_t *bytes, hada_error *err)
{
    hada_dry dry;
    hada_graph *graph;
    hada_dry_begin(&dry, context);
    const hada_status status = hada_graph_create(&graph, &dry.slot, net, options, err);
    *bytes = (size_t)hada_context_bytes(&dry.context);
    hada_graph_destroy(&graph);
    hada_dry_end(&dry);
    return status;
}

void hada_graph_destroy(hada_graph **pointer)
{
    hada_graph *graph = hada_taken(pointer);
    if (!graph)
        return;
    for (int i = 0; graph->convs && i < graph->plan.node_count; i++)
        hada_conv_destroy(&graph->convs[i]);
    for (int i = 0; graph->arenas && i < graph->plan.arenas.count; i++)
        hada_buffer_destroy(&graph->arenas[i]);
    hada_buffer_destroy(&graph->extras);
    hada_buffer_destroy(&graph->scratch);
    hada_graph_plan_free(&graph->plan);
    HADA_FREE(graph->convs, graph->arenas, graph->tensors, graph);
}

hada_status hada_graph_set_weights(hada_graph *graph, hada_floats values, hada_error *err)
{
    graph->values = values;
    for (int i = 1; i < graph->plan.node_count; i++) {
        if (!graph->convs[i])
            continue;
        HADA_TRY(hada_conv_set_weights(graph->convs[i], hada_graph_parameter(graph, values, i, 0, 0), err));
    }
    return HADA_OK;
}

void hada_graph_set_images(hada_graph *graph, int images)
{
    for (int i = 0; i < graph->plan.piece_count; i++)
        graph->tensors[i].images = images * graph->plan.net->colours;
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

/* Planar images to or from a tensor; the images of a net shared by colours are channels of the caller's. */
static hada_status transfer(hada_graph *graph, const hada_tensor *tensor, const hada_planar *planar, int load,
                            hada_error *err)
{
    const int colours = graph->plan.net->colours, images = colours > 1 ? graph->plan.options.images : 1;
    for (int n = 0; n < images; n++) {
        hada_planar part = *planar;
        hada_tensor view = *tensor;
        if (colours > 1) {
            part.offset += (size_t)n * planar->image_stride;
            part.image_stride = (size_t)tensor->channels * planar->channel_stride;
            view = hada_tensor_images(tensor, n * colours, colours);
        }
        HADA_TRY(load ? hada_tensor_load(graph->slot, &part, &view, err)
                      : hada_tensor_store(graph->slot, &view, &part, err));
    }
    return HADA_OK;
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

/* What begins at a step where other things stood before has its halo cleared. */
static hada_status clear_halos(hada_graph *graph, int now, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    for (int i = 0; i < plan->piece_count; i++)
        if (plan->tensors[i].shared && plan->pieces[i].first == now)
            HADA_TRY(hada_tensor_clear_halo(graph->slot, &graph->tensors[i], err));
    return HADA_OK;
}

static hada_status run_step(hada_graph *graph, const graph_step *step, hada_error *err)
{
    const hada_status status = step->kind == GRAPH_BACKWARD ? hada_graph_run_backward(graph, step, err)
                                                            : hada_graph_run_forward(graph, step, err);
    if (status)
        hada_error_prefix(err, "layer %d (%s): ", step->node, graph->plan.nodes[step->node].layer->name);
    return status;
}

/* Parameters stand in the layers' order, those that are trained first: where they begin that belong to `layer` and to
 * those behind it, which are done by then. */
static size_t final_from(const hada_net *net, int layer)
{
    size_t from = net->trained;
    for (int i = net->parameter_count - 1; i >= 0; i--) {
        const hada_parameter *parameter = &net->parameters[i];
        if (!parameter->trained)
            continue;
        if (parameter->layer < layer || parameter->offset + parameter->count != from)
            break;
        from = parameter->offset;
    }
    return from;
}

/* Runs the steps from `first` up to the loss, which is the caller's, or the end. */
static hada_status run(hada_graph *graph, int first, hada_error *err)
{
    const graph_plan *plan = &graph->plan;
    for (int i = first; i < plan->step_count; i++) {
        HADA_TRY(clear_halos(graph, i + 1, err));
        if (plan->steps[i].kind == GRAPH_LOSS)
            break;
        HADA_TRY(run_step(graph, &plan->steps[i], err));
        if (graph->ready && graph->gradients.mem && plan->steps[i].kind == GRAPH_BACKWARD)
            HADA_TRY(graph->ready(graph->ready_user, final_from(plan->net, plan->steps[i].node), err));
    }
    return HADA_OK;
}

hada_status hada_graph_forward(hada_graph *graph, hada_error *err)
{
    if (!graph->values.mem && graph->plan.net->floats)
        return hada_fail(err, HADA_ERROR_STATE, "a net without weights: hada_graph_set_weights() comes first");
    return run(graph, 0, err);
}

void hada_graph_watch(hada_graph *graph, hada_graph_ready ready, void *user)
{
    graph->ready = ready;
    graph->ready_user = user;
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
