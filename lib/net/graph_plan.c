/* Plans of graphs: the steps in the order of their work, the lifetimes of values, and their places in memory. A value
 * lives from the first step that uses it to the last; step number s of the list is number s + 1 of the lifetimes, and
 * at 0 the input comes in. */
#include "net/graph_plan.h"

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

static int same_level(const graph_node *a, const graph_node *b)
{
    return a->rows == b->rows && a->cols == b->cols;
}

/* Backward through a level: its values that were not kept are recomputed first. */
static void backward_steps(backward_pass *pass)
{
    graph_plan *plan = pass->plan;
    for (int last = plan->node_count - 1; last > 0;) {
        int first = last;
        while (first > 1 && same_level(&plan->nodes[first - 1], &plan->nodes[last]))
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
    plan->piece_room = 4 * plan->node_count;
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

static hada_status check_options(const hada_net *net, const hada_graph_options *options, hada_error *err)
{
    if (options->images < 1 || options->images > 65536 / net->colours)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a net for %d images: 1 to %d can be", options->images,
                         65536 / net->colours);
    if (!options->training && (options->weight_gradients || options->input_gradient || options->recompute))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "gradients and recomputation are for training");
    return HADA_OK;
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
    HADA_TRY(check_options(net, options, err));
    HADA_TRY(hada_graph_nodes_make(plan, context, err));
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
