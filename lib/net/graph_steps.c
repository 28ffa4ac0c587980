/* The steps of a graph and the lifetimes of its memory. Step number s of the
 * list is number s + 1 of the lifetimes: at 0 the input comes in. */
#include <stdlib.h>

#include "core/alloc.h"
#include "net/graph_plan.h"

/* Takes the steps one after the other. */
typedef struct graph_walk {
    graph_plan *plan;
    unsigned char *started; /* per node: something stands in its gradient */
} graph_walk;

static void touch(graph_plan *plan, int *piece, const graph_node *node, int now, const char *what)
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

static void touch_value(graph_plan *plan, int value, int now, int again)
{
    graph_node *node = &plan->nodes[value], *root = &plan->nodes[node->root];
    if (again && node->dropped)
        touch(plan, &node->again, node, now, "an activation computed again");
    else
        touch(plan, &root->value, root, now, "an activation of the net");
}

static void touch_gradient(graph_plan *plan, int value, int now)
{
    graph_node *root = &plan->nodes[plan->nodes[value].root];
    touch(plan, &root->gradient, root, now, "a gradient of the net");
}

static graph_step *add_step(graph_plan *plan, graph_step_kind kind, int node)
{
    graph_step *step = &plan->steps[plan->step_count++];
    *step = (graph_step){.kind = kind, .node = node, .spare = -1};
    return step;
}

static void forward_step(graph_plan *plan, int i, int again)
{
    const graph_node *node = &plan->nodes[i];
    const int now = plan->step_count + 1;
    add_step(plan, again ? GRAPH_AGAIN : GRAPH_FORWARD, i);
    for (int k = 0; k < node->layer->input_count; k++)
        touch_value(plan, node->inputs[k], now, again);
    touch_value(plan, i, now, again);
    if (node->pooled_by >= 0)
        touch_value(plan, node->pooled_by, now, 0);
}

/* Kinds whose operation replaces the gradient of its input and cannot add to
 * it. */
static int replaces(hada_layer_kind kind)
{
    return kind == HADA_LAYER_NORM || kind == HADA_LAYER_DROPOUT || kind == HADA_LAYER_LINEAR ||
           kind == HADA_LAYER_ACTIVATION;
}

/* Whether backward through a node looks at what it took, and at what it gave.
 */
static int looks_at_input(const graph_plan *plan, const graph_node *node)
{
    switch (node->layer->kind) {
    case HADA_LAYER_CONV:
        return plan->options.weight_gradients ||
               (plan->nodes[node->inputs[0]].needs && plan->nodes[node->inputs[0]].masked);
    case HADA_LAYER_LINEAR: return plan->options.weight_gradients;
    case HADA_LAYER_POOL:
    case HADA_LAYER_NORM: return 1;
    default: return 0;
    }
}

static int looks_at_output(const graph_node *node)
{
    return (node->activation && !node->masked) || node->layer->kind == HADA_LAYER_POOL;
}

static void backward_step(graph_walk *walk, int i)
{
    graph_plan *plan = walk->plan;
    const graph_node *node = &plan->nodes[i];
    const hada_layer_kind kind = node->layer->kind;
    const int now = plan->step_count + 1;
    graph_step *step = add_step(plan, GRAPH_BACKWARD, i);
    touch_gradient(plan, i, now);
    if (looks_at_output(node))
        touch_value(plan, i, now, 1);
    for (int k = 0; k < node->layer->input_count; k++) {
        const int in = node->inputs[k];
        const graph_node *giver = &plan->nodes[in];
        if (looks_at_input(plan, node))
            touch_value(plan, in, now, 1);
        if (!giver->needs) {
            if (kind == HADA_LAYER_NORM) /* its operation gives this gradient, wanted
                                            or not */
                touch(plan, &step->spare, giver, now, "a gradient of the net");
            continue;
        }
        touch_gradient(plan, in, now);
        step->wanted[k] = !(kind == HADA_LAYER_CONCAT && giver->root == i); /* a part in place has it already */
        step->accumulate[k] = walk->started[in];
        walk->started[in] = 1;
        if (replaces(kind) && step->accumulate[k])
            touch(plan, &step->spare, giver, now, "a gradient of the net");
    }
}

static int same_level(const graph_node *a, const graph_node *b)
{
    return a->rows == b->rows && a->cols == b->cols;
}

/* Backward through a level: what was dropped there is computed again before. */
static void backward_steps(graph_walk *walk)
{
    graph_plan *plan = walk->plan;
    for (int last = plan->node_count - 1; last > 0;) {
        int first = last;
        while (first > 1 && same_level(&plan->nodes[first - 1], &plan->nodes[last]))
            first--;
        for (int i = first; i <= last; i++)
            if (plan->nodes[i].dropped)
                forward_step(plan, i, 1);
        for (int i = last; i >= first; i--)
            if (!plan->nodes[i].folded && plan->nodes[i].needs)
                backward_step(walk, i);
        last = first - 1;
    }
}

/* Rows of the table of pieces: at most values, those computed again, gradients,
 * and a spare one for each step. */
static hada_status make_room(graph_plan *plan, unsigned char **started, hada_error *err)
{
    const size_t nodes = (size_t)plan->node_count, steps = 3 * nodes + 1;
    plan->piece_room = 4 * plan->node_count;
    hada_status status = hada_alloc((void **)&plan->steps, steps, sizeof *plan->steps, "a net's plan", err);
    if (!status)
        status = hada_alloc((void **)&plan->pieces, 4 * nodes, sizeof *plan->pieces, "a net's plan", err);
    if (!status)
        status = hada_alloc((void **)&plan->tensors, 4 * nodes, sizeof *plan->tensors, "a net's plan", err);
    if (!status)
        status = hada_alloc((void **)started, nodes, 1, "a net's plan", err);
    return status;
}

static size_t rounded(size_t floats)
{
    return (floats + 63) / 64 * 64;
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

hada_status hada_graph_steps_make(graph_plan *plan, hada_error *err)
{
    graph_walk walk = {.plan = plan};
    hada_status status = make_room(plan, &walk.started, err);
    if (status)
        return status;
    touch_value(plan, 0, 0, 0);
    for (int i = 1; i < plan->node_count; i++)
        if (!plan->nodes[i].folded && !plan->nodes[i].pooled)
            forward_step(plan, i, 0);
    touch_value(plan, plan->output, plan->step_count + 1, 0);
    if (plan->options.training) {
        add_step(plan, GRAPH_LOSS, plan->output);
        touch_gradient(plan, plan->output, plan->step_count);
        walk.started[plan->output] = 1;
        backward_steps(&walk);
        if (plan->options.input_gradient)
            touch_gradient(plan, 0, plan->step_count + 1);
    }
    count_extras(plan);
    free(walk.started);
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
