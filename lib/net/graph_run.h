/* A graph on its device. Internal to lib/net. */
#ifndef HADA_NET_GRAPH_RUN_H
#define HADA_NET_GRAPH_RUN_H

#include "net/graph_plan.h"

struct hada_graph {
    hada_slot *slot;
    graph_plan plan;
    hada_buffer *arenas; /* plan.arenas.count */
    hada_buffer extras, scratch;
    hada_tensor *tensors; /* per piece */
    hada_conv **convs;    /* per node; NULL where it is none */
    hada_floats values;   /* the caller's */
    uint64_t seed, step;
    hada_floats gradients; /* during backward */
    int accumulate;
    hada_graph_ready ready; /* NULL: nobody watches */
    void *ready_user;
};

/* graph_views.c. The tensors of a node: its value (for_backward: the recomputed one where there is one) and the value's
 * gradient. */
hada_tensor hada_graph_value(const hada_graph *graph, int node, int for_backward);
hada_tensor hada_graph_gradient(const hada_graph *graph, int node);

/* The images of one colour among those of all. */
hada_tensor hada_graph_colour(const hada_graph *graph, const hada_tensor *tensor, int colour);

/* A parameter of a node in an array of all of them, and the batch norm of one colour. */
hada_floats hada_graph_parameter(const hada_graph *graph, hada_floats all, int node, int colour, int which);
hada_batch_norm hada_graph_norm(const hada_graph *graph, int node, int colour);

/* An image's values in channel, row, column order, one image after the other. */
hada_planar hada_graph_flat(const hada_graph *graph, const hada_tensor *tensor, size_t offset);

hada_status hada_graph_run_forward(hada_graph *graph, const graph_step *step, hada_error *err);
hada_status hada_graph_run_backward(hada_graph *graph, const graph_step *step, hada_error *err);

#endif
