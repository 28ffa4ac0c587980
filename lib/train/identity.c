#include "train/identity.h"

#include <stdlib.h>
#include <string.h>

/* For each layer: the channel from which on it holds the net's input; -1: nowhere. */
enum { NOWHERE = -1 };

static int passes(hada_activation activation)
{
    return activation == HADA_ACTIVATION_NONE || activation == HADA_ACTIVATION_RELU ||
           activation == HADA_ACTIVATION_LEAKY_RELU;
}

static int keeps_size(const hada_layer *layer)
{
    return !layer->transposed && layer->stride == 1 && layer->kernel % 2 == 1 && layer->pad == layer->kernel / 2;
}

/* Where a layer holds the input, given where those before it do. */
static int held_at(const hada_net *net, int index, const int *held)
{
    const hada_layer *layer = &net->layers[index];
    const int channels = net->layers[net->count - 1].channels, from = held[layer->inputs[0]];
    switch (layer->kind) {
    case HADA_LAYER_INPUT: return 0;
    case HADA_LAYER_CONV:
        return from >= 0 && keeps_size(layer) && passes(layer->activation) && layer->channels >= channels ? 0 : NOWHERE;
    case HADA_LAYER_ACTIVATION: return passes(layer->activation) ? from : NOWHERE;
    case HADA_LAYER_CONCAT:
        for (int i = 0, first = 0; i < layer->input_count; i++) {
            if (held[layer->inputs[i]] >= 0)
                return first + held[layer->inputs[i]];
            first += net->layers[layer->inputs[i]].channels;
        }
        return NOWHERE;
    default: return NOWHERE;
    }
}

/* The first channels of a convolution become copies of those that hold the input. */
static void copy_through(hada_net *net, int index, int from)
{
    const hada_layer *layer = &net->layers[index];
    const hada_parameter *weight = hada_net_parameter(net, index, 0, 0);
    const size_t taps = (size_t)layer->kernel * (size_t)layer->kernel, each = (size_t)weight->shape[1] * taps;
    for (int c = 0; c < net->layers[net->count - 1].channels; c++) {
        float *row = net->values + weight->offset + (size_t)c * each;
        memset(row, 0, each * sizeof *row);
        row[(size_t)(from + c) * taps + taps / 2] = 1.0f;
        if (layer->bias)
            net->values[hada_net_parameter(net, index, 0, 1)->offset + (size_t)c] = 0.0f;
    }
}

int hada_net_start_as_identity(hada_net *net)
{
    const int last = net->count - 1;
    int *held = calloc((size_t)net->count, sizeof *held);
    if (!held)
        return 0;
    for (int i = 0; i < net->count; i++)
        held[i] = held_at(net, i, held);
    const int found = net->layers[last].kind == HADA_LAYER_CONV && held[last] == 0 &&
                      net->layers[last].channels <= net->layers[0].channels;
    for (int i = 1; found && i < net->count; i++)
        if (net->layers[i].kind == HADA_LAYER_CONV && held[i] == 0)
            copy_through(net, i, held[net->layers[i].inputs[0]]);
    free(held);
    return found;
}
