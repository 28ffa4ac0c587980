/* Plans of graphs: the steps in the order of their work, the lifetimes of values, and their places in memory. A value
 * lives from the first step that uses it to the last; step number s of the list is number s + 1 of the lifetimes, and
 * at 0 the input comes in. */
#include "net/graph_plan.h"

/* The nodes of a graph: what is fused into one launch, and which values alias the memory of another. In inference
 * convolutions also take over bilinear doubling and concatenation (the way up of a U-net) before them, whose results
 * are then never written. */

static int same_size(const graph_node *a, const graph_node *b)
{
    return a->rows == b->rows && a->cols == b->cols;
}

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
    if (!value || node->alias_of != value || node->layer->kind == HADA_LAYER_CONCAT || !same_size(node, whole))
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
        level[i] = level[i - 1] + (i == 1 || !same_size(node, before));
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

/* Fills the nodes: sizes, what is fused, aliased, recomputed, masked. */
static hada_status graph_nodes_make(graph_plan *plan, const hada_context *context, hada_error *err)
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

/* The steps of backward are made one after the other. */
typedef struct backward_pass {
    graph_plan *plan;
    unsigned char *has_gradient; /* per node: its gradient has been written to */
} backward_pass;

static void use_piece(graph_plan *plan, int *piece, const graph_node *node, int now, const char *what)
{
    if (*piece < 0) {
        *piece = plan->piece_count++;
        plan->tensors[*piece] = (graph_piece){.channels = node->channels, .rows = node->rows, .cols = node->cols};
        const size_t floats = hada_tensor_image_floats(plan->block, node->channels, node->rows, node->cols);
        const size_t bytes = hada_size_product(hada_size_product(floats, (size_t)plan->images), sizeof(float));
        plan->pieces[*piece] = (hada_piece){.what = what, .bytes = bytes, .first = now, .last = now};
    }
    if (plan->pieces[*piece].last < now)
        plan->pieces[*piece].last = now;
}

static void use_value(graph_plan *plan, int value, int now, int for_backward)
{
    graph_node *node = &plan->nodes[value], *whole = &plan->nodes[node->alias_of];
    if (for_backward && node->recompute)
        use_piece(plan, &node->recomputed, node, now, "an activation computed again");
    else
        use_piece(plan, &whole->value, whole, now, "an activation of the net");
}

static void use_gradient(graph_plan *plan, int value, int now)
{
    graph_node *whole = &plan->nodes[plan->nodes[value].alias_of];
    use_piece(plan, &whole->gradient, whole, now, "a gradient of the net");
}

static graph_step *add_step(graph_plan *plan, graph_step_kind kind, int node)
{
    graph_step *step = &plan->steps[plan->step_count++];
    *step = (graph_step){.kind = kind, .node = node, .spare = -1};
    return step;
}

static void forward_step(graph_plan *plan, int i, int recompute)
{
    const graph_node *node = &plan->nodes[i];
    const int now = plan->step_count + 1;
    add_step(plan, recompute ? GRAPH_RECOMPUTE : GRAPH_FORWARD, i);
    for (int k = 0; k < node->layer->input_count; k++)
        use_value(plan, node->inputs[k], now, recompute);
    if (node->low >= 0)
        use_value(plan, node->low, now, 0);
    use_value(plan, i, now, recompute);
    if (node->fused_pool >= 0)
        use_value(plan, node->fused_pool, now, 0);
}

/* Kinds whose operation replaces the gradient of its input and cannot add to it. */
static int replaces(hada_layer_kind kind)
{
    return kind == HADA_LAYER_NORM || kind == HADA_LAYER_DROPOUT || kind == HADA_LAYER_LINEAR ||
           kind == HADA_LAYER_ACTIVATION;
}

/* Whether backward through a node reads the values of its inputs, and its own. */
static int backward_reads_input(const graph_plan *plan, const graph_node *node)
{
    switch (node->layer->kind) {
    case HADA_LAYER_CONV:
        return plan->options.weight_gradients ||
               (plan->nodes[node->inputs[0]].needs_gradient && plan->nodes[node->inputs[0]].masked);
    case HADA_LAYER_LINEAR: return plan->options.weight_gradients;
    case HADA_LAYER_POOL:
    case HADA_LAYER_NORM: return 1;
    default: return 0;
    }
}

static int backward_reads_output(const graph_node *node)
{
    return (node->activation && !node->masked) || node->layer->kind == HADA_LAYER_POOL;
}

static void backward_step(backward_pass *pass, int i)
{
    graph_plan *plan = pass->plan;
    const graph_node *node = &plan->nodes[i];
    const hada_layer_kind kind = node->layer->kind;
    const int now = plan->step_count + 1;
    graph_step *step = add_step(plan, GRAPH_BACKWARD, i);
    use_gradient(plan, i, now);
    if (backward_reads_output(node))
        use_value(plan, i, now, 1);
    for (int k = 0; k < node->layer->input_count; k++) {
        const int in = node->inputs[k];
        const graph_node *giver = &plan->nodes[in];
        if (backward_reads_input(plan, node))
            use_value(plan, in, now, 1);
        if (!giver->needs_gradient) {
            if (kind == HADA_LAYER_NORM) /* its operation gives this gradient, wanted
                                            or not */
                use_piece(plan, &step->spare, giver, now, "a gradient of the net");
            continue;
        }
        use_gradient(plan, in, now);
        step->wanted[k] = !(kind == HADA_LAYER_CONCAT && giver->alias_of == i); /* a part in place has it already */
        step->accumulate[k] = pass->has_gradient[in];
        pass->has_gradient[in] = 1;
        if (replaces(kind) && step->accumulate[k])
            use_piece(plan, &step->spare, giver, now, "a gradient of the net");
    }
}

/* Backward through a level: its values that were not kept are recomputed first. */
static void backward_steps(backward_pass *pass)
{
    graph_plan *plan = pass->plan;
    for (int last = plan->node_count - 1; last > 0;) {
        int first = last;
        while (first > 1 && same_size(&plan->nodes[first - 1], &plan->nodes[last]))
            first--;
        for (int i = first; i <= last; i++)
            if (plan->nodes[i].recompute)
                forward_step(plan, i, 1);
        for (int i = last; i >= first; i--)
            if (!plan->nodes[i].fused && plan->nodes[i].needs_gradient)
                backward_step(pass, i);
        last = first - 1;
    }
}

/* Rows of the table of pieces: at most values, those computed again, gradients, and a spare one for each step. */
static hada_status make_room(graph_plan *plan, unsigned char **has_gradient, hada_error *err)
{
    const size_t nodes = (size_t)plan->node_count, steps = 3 * nodes + 1;
    HADA_TRY(HADA_NEW(plan->steps, steps, "a net's plan", err));
    HADA_TRY(HADA_NEW(plan->pieces, 4 * nodes, "a net's plan", err));
    HADA_TRY(HADA_NEW(plan->tensors, 4 * nodes, "a net's plan", err));
    return HADA_NEW(*has_gradient, nodes, "a net's plan", err);
}

static size_t rounded(size_t floats)
{
    return hada_round_up(floats, 64); /* a cache line of most devices, four times */
}

static void count_extras(graph_plan *plan)
{
    size_t in = 0, out = 0, unwanted = 0;
    plan->saved = 0;
    for (int i = 1; i < plan->node_count; i++) {
        const graph_node *node = &plan->nodes[i];
        if (node->layer->kind == HADA_LAYER_NORM && plan->options.training) {
            const size_t floats = 2 * (size_t)node->channels;
            plan->saved += floats * (size_t)plan->net->colours;
            unwanted = floats > unwanted ? floats : unwanted;
        }
        if (node->layer->kind != HADA_LAYER_LINEAR)
            continue;
        const size_t takes = (size_t)node->layer->in * (size_t)plan->images;
        const size_t gives = (size_t)node->channels * (size_t)plan->images;
        in = takes > in ? takes : in;
        out = gives > out ? gives : out;
    }
    plan->flat_in = rounded(plan->saved);
    plan->flat_out = plan->flat_in + rounded(in);
    plan->unwanted = plan->flat_out + rounded(out);
    plan->extras = plan->unwanted + rounded(unwanted);
}

static hada_status make_steps(graph_plan *plan, hada_error *err)
{
    backward_pass pass = {.plan = plan};
    HADA_TRY(make_room(plan, &pass.has_gradient, err));
    use_value(plan, 0, 0, 0);
    for (int i = 1; i < plan->node_count; i++)
        if (!plan->nodes[i].fused && !plan->nodes[i].pooled)
            forward_step(plan, i, 0);
    use_value(plan, plan->output, plan->step_count + 1, 0);
    if (plan->options.training) {
        add_step(plan, GRAPH_LOSS, plan->output);
        use_gradient(plan, plan->output, plan->step_count);
        pass.has_gradient[plan->output] = 1;
        backward_steps(&pass);
        if (plan->options.input_gradient)
            use_gradient(plan, 0, plan->step_count + 1);
    }
    count_extras(plan);
    free(pass.has_gradient);
    return HADA_OK;
}

size_t hada_graph_saved_at(const graph_plan *plan, int node, int colour)
{
    size_t at = 0;
    for (int i = 1; i < node; i++)
        if (plan->nodes[i].layer->kind == HADA_LAYER_NORM)
            at += 2 * (size_t)plan->nodes[i].channels * (size_t)plan->net->colours;
    return at + 2 * (size_t)plan->nodes[node].channels * (size_t)colour;
}

/* Pieces that share memory with others need their halo cleared each time. */
static void find_shared(graph_plan *plan)
{
    for (int a = 0; a < plan->piece_count; a++)
        for (int b = 0; b < plan->piece_count; b++) {
            const hada_piece *one = &plan->pieces[a], *other = &plan->pieces[b];
            if (a != b && one->arena == other->arena && one->offset < other->offset + other->bytes &&
                other->offset < one->offset + one->bytes)
                plan->tensors[a].shared = 1;
        }
}

static size_t norm_scratch(const graph_plan *plan, const hada_context *context)
{
    size_t most = 0;
    for (int i = 1; i < plan->node_count; i++) {
        const graph_node *node = &plan->nodes[i];
        if (node->layer->kind != HADA_LAYER_NORM || !plan->options.training)
            continue;
        const hada_tensor x =
            hada_tensor_at(context, NULL, 0, plan->options.images, node->channels, node->rows, node->cols);
        const size_t bytes = hada_batch_norm_scratch(&x);
        most = bytes > most ? bytes : most;
    }
    return most;
}

hada_status hada_graph_plan_make(graph_plan *plan, const hada_context *context, const hada_net *net,
                                 const hada_graph_options *options, hada_error *err)
{
    *plan = (graph_plan){.net = net, .options = *options, .block = hada_net_block(context)};
    plan->images = options->images * net->colours;
    const size_t alignment = context->info.alignment_bytes > 128 ? context->info.alignment_bytes : 128;
    const uint64_t largest = context->info.max_allocation_bytes;
    if (options->images > 65536 / net->colours)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a net for %d images: 1 to %d can be", options->images,
                         65536 / net->colours);
    HADA_TRY(graph_nodes_make(plan, context, err));
    HADA_TRY(make_steps(plan, err));
    HADA_TRY(hada_lifetimes_plan(plan->pieces, plan->piece_count, alignment,
                                 largest < SIZE_MAX / 4 ? (size_t)largest : SIZE_MAX / 4, &plan->arenas, err));
    find_shared(plan);
    plan->norm_scratch = norm_scratch(plan, context);
    return HADA_OK;
}

void hada_graph_plan_free(graph_plan *plan)
{
    hada_arenas_free(&plan->arenas);
    HADA_FREE(plan->nodes, plan->steps, plan->pieces, plan->tensors);
    *plan = (graph_plan){0};
}
