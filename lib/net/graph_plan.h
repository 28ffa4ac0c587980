/* The steps of a graph and the places of its values in memory, worked out before anything is allocated. Internal to
 * lib/net. */
#ifndef HADA_NET_GRAPH_PLAN_H
#define HADA_NET_GRAPH_PLAN_H

#include "net/graph.h"
#include "runtime/memory.h"

/* A layer in its graph, and the value that it gives. */
typedef struct graph_node {
    const hada_layer *layer;
    int inputs[HADA_LAYER_INPUTS]; /* as the layer's, with fused layers replaced by what they are fused into */
    int channels, rows, cols;
    int fused;                  /* done by another node: it does nothing and has no value */
    int fused_pool;             /* CONV: the pooling that is done in the same launch; -1: none */
    int pooled;                 /* POOL: done by the convolution before */
    int low;                    /* CONV: the value whose channels come behind those of its input, doubled; -1: none */
    hada_activation activation; /* of its own or fused into it */
    float slope;
    int alias_of, alias_channel; /* the node whose memory its value stands in (itself, or a concatenation), from which
                                    channel on */
    int recompute;               /* its value is not kept for backward but computed again */
    int needs_gradient;          /* a gradient of its value is wanted */
    int masked; /* 1: its readers mask its gradient by its ReLU; else its own backward begins with that */
    /* pieces of memory; -1: none. value and gradient are those of the node that it aliases. */
    int value, recomputed, gradient;
} graph_node;

typedef enum graph_step_kind {
    GRAPH_FORWARD = 0,
    GRAPH_LOSS = 1, /* the caller's: the output is there, its gradient is to be written */
    GRAPH_RECOMPUTE = 2,
    GRAPH_BACKWARD = 3
} graph_step_kind;

typedef struct graph_step {
    graph_step_kind kind;
    int node;
    /* BACKWARD, per input */
    unsigned char wanted[HADA_LAYER_INPUTS], accumulate[HADA_LAYER_INPUTS];
    int spare; /* BACKWARD: the piece that takes what cannot be added to the gradient directly; -1: none */
} graph_step;

/* A piece of memory is a tensor. */
typedef struct graph_piece {
    int channels, rows, cols;
    int shared; /* other pieces stand in its memory: its halo is cleared before its first step */
} graph_piece;

typedef struct graph_plan {
    const hada_net *net;
    hada_graph_options options;
    int images; /* of the net: with colours */
    int block;
    graph_node *nodes;
    int node_count, output;
    graph_step *steps;
    int step_count;
    hada_piece *pieces;
    graph_piece *tensors;
    int piece_count;
    hada_arenas arenas;
    /* floats in one more buffer: statistics that batch norms keep, flat values of linear layers */
    size_t saved, flat_in, flat_out, unwanted, extras;
    size_t norm_scratch; /* bytes */
} graph_plan;

/* Fills *plan; hada_graph_plan_free() also after a failure. */
hada_status hada_graph_plan_make(graph_plan *plan, const hada_context *context, const hada_net *net,
                                 const hada_graph_options *options, hada_error *err);
void hada_graph_plan_free(graph_plan *plan);

/* The convolution of a node. */
hada_conv_desc hada_graph_conv_desc(const graph_plan *plan, const graph_node *node);

/* Where statistics of a batch norm begin, in floats of the extra buffer. */
size_t hada_graph_saved_at(const graph_plan *plan, int node, int colour);

/* A graph on its device. */
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

#endif
