/* Plans of graphs: from a list to places in memory. */
#include "net/graph_plan.h"

#include <stdlib.h>

#include "core/alloc.h"

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
    HADA_TRY(hada_graph_steps_make(plan, err));
    HADA_TRY(hada_lifetimes_plan(plan->pieces, plan->piece_count, alignment,
                                 largest < SIZE_MAX / 4 ? (size_t)largest : SIZE_MAX / 4, &plan->arenas, err));
    find_shared(plan);
    plan->norm_scratch = norm_scratch(plan, context);
    return HADA_OK;
}

void hada_graph_plan_free(graph_plan *plan)
{
    hada_arenas_free(&plan->arenas);
    free(plan->nodes);
    free(plan->steps);
    free(plan->pieces);
    free(plan->tensors);
    *plan = (graph_plan){0};
}
