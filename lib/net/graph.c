/* Graphs: making, weights, running. */
#include "net/conv.h"
#include "net/graph_plan.h"

/* One layer of a graph, forward or backward: the tensors and parameters of its node, and the launches. */

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

/* A parameter of a node in an array of all of them. */
static hada_floats graph_parameter(const hada_graph *graph, hada_floats all, int node, int colour, int which)
{
    return (hada_floats){all.mem, all.offset + hada_net_parameter(graph->plan.net, node, colour, which)->offset};
}

/* The batch norm of one colour. */
static hada_batch_norm norm_of(const hada_graph *graph, int node, int colour)
{
    const hada_layer *layer = graph->plan.nodes[node].layer;
    hada_floats part[4];
    for (int i = 0; i < 4; i++)
        part[i] = graph_parameter(graph, graph->values, node, colour, i);
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
    return hada_planar_like(tensor, graph->extras.mem, offset);
}

static hada_status conv_forward(hada_graph *graph, int i, const hada_tensor *x, const hada_tensor *y, hada_error *err)
{
    const graph_node *node = &graph->plan.nodes[i];
    hada_floats bias = {0};
    hada_tensor pooled = {0}, low = {0};
    if (node->layer->bias)
        bias = graph_parameter(graph, graph->values, i, 0, 1);
    if (node->fused_pool >= 0)
        pooled = value_of(graph, node->fused_pool, 0);
    if (node->low >= 0)
        low = value_of(graph, node->low, 0);
    return hada_conv_forward(graph->convs[i], x, node->low >= 0 ? &low : NULL, bias, y,
                             node->fused_pool >= 0 ? &pooled : NULL, err);
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
    const hada_floats weight = graph_parameter(graph, graph->values, i, 0, 0);
    hada_floats bias = {0};
    if (node->layer->bias)
        bias = graph_parameter(graph, graph->values, i, 0, 1);
    HADA_TRY(hada_tensor_store(graph->slot, x, &flat_x, err));
    HADA_TRY(hada_linear_forward(graph->slot, &shape, weight, bias, (hada_floats){flat_x.mem, flat_x.offset},
                                 (hada_floats){flat_y.mem, flat_y.offset}, err));
    HADA_TRY(hada_tensor_load(graph->slot, &flat_y, y, err));
    if (node->activation)
        HADA_TRY(hada_activation_forward(graph->slot, node->activation, node->slope, y, y, err));
    return HADA_OK;
}

/* One layer. */
static hada_status graph_run_forward(hada_graph *graph, const graph_step *step, hada_error *err)
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
    return graph_parameter(graph, graph->gradients, node, colour, which);
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
        const hada_floats weight = graph_parameter(graph, graph->values, step->node, 0, 0);
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

static hada_status graph_run_backward(hada_graph *graph, const graph_step *step, hada_error *err)
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
    HADA_DESTROY_BUFFERS(&graph->extras, &graph->scratch);
    hada_graph_plan_free(&graph->plan);
    HADA_FREE(graph->convs, graph->arenas, graph->tensors, graph);
}

hada_status hada_graph_set_weights(hada_graph *graph, hada_floats values, hada_error *err)
{
    graph->values = values;
    for (int i = 1; i < graph->plan.node_count; i++) {
        if (!graph->convs[i])
            continue;
        HADA_TRY(hada_conv_set_weights(graph->convs[i], graph_parameter(graph, values, i, 0, 0), err));
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
    return transfer(graph, &graph->tensors[graph->plan.nodes[0].gradient], out, 0, err);
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
    const hada_status status =
        step->kind == GRAPH_BACKWARD ? graph_run_backward(graph, step, err) : graph_run_forward(graph, step, err);
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
    int first = 0;
    while (plan->steps[first].kind != GRAPH_LOSS)
        first++;
    graph->gradients = gradients;
    graph->accumulate = accumulate;
    return run(graph, first + 1, err);
}
