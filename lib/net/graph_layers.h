/* A graph on its device. Internal to lib/net. */
#ifndef HADA_NET_GRAPH_LAYERS_H
#define HADA_NET_GRAPH_LAYERS_H

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

/* A parameter of a node in an array of all of them. */
hada_floats hada_graph_parameter(const hada_graph *graph, hada_floats all, int node, int colour, int which);

/* One layer. */
hada_status hada_graph_run_forward(hada_graph *graph, const graph_step *step, hada_error *err);
hada_status hada_graph_run_backward(hada_graph *graph, const graph_step *step, hada_error *err);

#endif
