/* Running a list of layers on a device, forward and backward. Internal.
 *
 * A graph is a net for images of one size. Its bytes are known before anything is allocated; activations and gradients
 * stand in memory planned from their lifetimes. What the list allows is fused: convolution, bias, activation and 2 x 2
 * pooling are one launch; parts of a concatenation are written in place. Everything is enqueued on the slot and not
 * waited for; sums run in a fixed order, so a step repeated gives the same bits. */
#ifndef HADA_NET_GRAPH_H
#define HADA_NET_GRAPH_H

#include "net/layers.h"
#include "netlist/net_list.h"

typedef struct hada_graph_options {
    int images;           /* of the caller; a net shared by colours runs images * colours of its own */
    int rows, cols;       /* of the input */
    int training;         /* 1: batch norms take the batch's statistics, dropout drops, backward may be called */
    int weight_gradients; /* training: gradients of the parameters are wanted */
    int input_gradient;   /* training: the gradient of the input is wanted */
    int recompute;        /* training: what stays inside a level is computed again for backward, not kept */
    hada_conv_method method;
} hada_graph_options;

typedef struct hada_graph hada_graph;

/* Device bytes that a graph holds, without the weights, which are the caller's. */
hada_status hada_graph_bytes(const hada_context *context, const hada_net *net, const hada_graph_options *options,
                             size_t *bytes, hada_error *err);

/* The net's list must stay as it is while the graph lives; its values are not read. */
hada_status hada_graph_create(hada_graph **out, hada_slot *slot, const hada_net *net, const hada_graph_options *options,
                              hada_error *err);
void hada_graph_destroy(hada_graph **graph);

/* Takes over weights (enqueued): net->floats floats, parameters at their offsets. Convolutions keep a form of their
 * own, so this is called again whenever values changed; biases, batch norms and linear layers read `values` itself,
 * which must stay. Training updates running statistics in `values`. */
hada_status hada_graph_set_weights(hada_graph *graph, hada_floats values, hada_error *err);

/* The images that forward runs from now on, at most those of the options; all of them before (not for training). */
void hada_graph_set_images(hada_graph *graph, int images);

/* The input, to be written before forward with its halo (hada_tensor_load, or hada_graph_load): images * colours
 * images; and the output. The output of a net that ends in a linear layer has 1 x 1 pixels. */
const hada_tensor *hada_graph_input(const hada_graph *graph);
const hada_tensor *hada_graph_output(const hada_graph *graph);

/* From and to planar images with all their channels, [image][channel][row][column]. */
hada_status hada_graph_load(hada_graph *graph, const hada_planar *in, hada_error *err);
hada_status hada_graph_store(hada_graph *graph, const hada_planar *out, hada_error *err);

/* Which random numbers dropout takes (training). */
void hada_graph_set_step(hada_graph *graph, uint64_t seed, uint64_t step);

hada_status hada_graph_forward(hada_graph *graph, hada_error *err);

/* Training. The gradient of the output is written by the caller after forward; backward then gives the gradients of the
 * parameters, at the parameters' offsets of `gradients` (net->trained floats; accumulate: added to; mem NULL: not
 * wanted this time), and that of the input. The gradient of the output does not survive. */
const hada_tensor *hada_graph_output_gradient(const hada_graph *graph);
hada_status hada_graph_backward(hada_graph *graph, hada_floats gradients, int accumulate, hada_error *err);

/* Asked on the way of backward, layer by layer from the last: the gradients from float `from` on are final once what is
 * enqueued by now is done. NULL: nobody is. */
typedef hada_status (*hada_graph_ready)(void *user, size_t from, hada_error *err);
void hada_graph_watch(hada_graph *graph, hada_graph_ready ready, void *user);

/* The gradient of the output from planar images, and that of the input as such. */
hada_status hada_graph_load_gradient(hada_graph *graph, const hada_planar *in, hada_error *err);
hada_status hada_graph_store_gradient(hada_graph *graph, const hada_planar *out, hada_error *err);

#endif
