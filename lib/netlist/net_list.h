/* A net as data: a list of layers, the table of its parameters, and their values on the host. Internal. Needs no
 * OpenCL.
 *
 * Layer 0 is the input; each layer takes what earlier ones give, and the last one gives the net's output. Rows and
 * columns follow from the input's (hada_net_sizes), so that a list serves any image size. */
#ifndef HADA_NETLIST_NET_LIST_H
#define HADA_NETLIST_NET_LIST_H

#include <hadalens/net.h>

#include "core/error.h"
#include "netlist/kinds.h"

/* Of a side of an image, a kernel, a stride, at most: products of two do not overflow. */
#define HADA_NET_MOST_PIXELS (1 << 20)

enum { HADA_LAYER_INPUTS = 8, HADA_LAYER_NAME = 64 };

typedef struct hada_layer {
    hada_layer_kind kind;
    char name[HADA_LAYER_NAME]; /* of its parameters: "down.0.0" has down.0.0.weight; "" where it has none */
    int inputs[HADA_LAYER_INPUTS], input_count;
    int channels;            /* INPUT, CONV, LINEAR: what it gives; the others: worked out */
    int kernel, stride, pad; /* CONV, POOL (no pad) */
    int transposed, output_pad;
    int bias;                   /* CONV, LINEAR */
    int in;                     /* LINEAR: values of an image that it takes */
    hada_activation activation; /* CONV, LINEAR, ACTIVATION */
    float slope;
    hada_pool pool;
    hada_resize resize;
    int like, rows, cols; /* RESIZE: to the size of layer `like`; -1: to rows x cols */
    float eps, momentum;  /* NORM */
    float p;              /* DROPOUT */
    int parameter;        /* out: its first one in the table; -1: none */
} hada_layer;

/* A parameter of the state dict. Values stand one after the other in one flat array: first all that training changes,
 * then the running statistics. */
typedef struct hada_parameter {
    char name[HADA_LAYER_NAME + 24];
    int dims;
    int64_t shape[4];
    size_t offset, count; /* floats */
    int trained;
    int layer;
} hada_parameter;

struct hada_net {
    hada_layer *layers;
    int count, room;
    /* Channels of an image of which each is an image of its own to the net; 1: an image is one. Batch norms then have
     * parameters for each of them (name.0.weight, name.1.weight, ...). */
    int colours;
    int shares; /* 1: of planes that explain a frame together it says whose light is whose, and leaves their sum */
    hada_parameter *parameters;
    int parameter_count;
    uint64_t most; /* of floats, for a list that others wrote; 0: what memory takes */
    size_t trained, floats;
    float *values;
    hada_net_info info; /* set where the list is finished */
};

/* An empty list; layers are added one after the other, *index (may be NULL) is the place of the new one; finish checks
 * the whole, works out what is left to be worked out, and makes the parameters (zero). */
hada_status hada_net_begin(hada_net **out, int colours, hada_error *err);
hada_status hada_net_add(hada_net *net, const hada_layer *layer, int *index, hada_error *err);
hada_status hada_net_finish(hada_net *net, hada_error *err);

/* The layer with the values that most have: kernel 3, stride 1, pad 1, a bias, no activation, one input, PyTorch's eps
 * and momentum. */
hada_layer hada_layer_of(hada_layer_kind kind, const char *name, int input);

/* First values: Kaiming for weights, PyTorch's own where no activation follows, 1 and 0 for batch norms. */
hada_status hada_net_init(hada_net *net, uint64_t seed, hada_error *err);

/* Pixels that each layer gives (count pairs) for an input of rows x cols; HADA_ERROR_SIZE where nothing is left. */
typedef struct hada_size {
    int rows, cols;
} hada_size;
hada_status hada_net_sizes(const hada_net *net, int rows, int cols, hada_size *sizes, hada_error *err);

/* As hada_net_create(), of at most `most` parameters: HADA_ERROR_MODEL before memory for more is taken. */
hada_status hada_net_create_within(hada_net **out, const char *description, uint64_t most, uint64_t seed,
                                   hada_error *err);

/* A copy with its values. */
hada_status hada_net_copy(hada_net **out, const hada_net *net, hada_error *err);

/* The parameter of a name, NULL where there is none. */
const hada_parameter *hada_net_find(const hada_net *net, const char *name);

/* A parameter of a layer: the weight (0) or the bias (1) of a convolution or linear layer; weight, bias, running mean
 * and running variance (0 to 3) of a batch norm for one colour. */
const hada_parameter *hada_net_parameter(const hada_net *net, int layer, int colour, int which);

#endif
