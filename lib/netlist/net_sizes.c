/* What the layers of a list make of an image: its rows and columns. */
#include "netlist/net_list.h"

/* Pixels along one axis; 0 or less: none are left. Pads may be as large as kernels. */
static int conv_pixels(const hada_layer *layer, int in)
{
    if (layer->transposed) {
        const int64_t out = ((int64_t)in - 1) * layer->stride - 2 * layer->pad + layer->kernel + layer->output_pad;
        return out > HADA_NET_MOST_PIXELS ? HADA_NET_MOST_PIXELS + 1 : (int)out;
    }
    return in + 2 * layer->pad < layer->kernel ? 0 : (in + 2 * layer->pad - layer->kernel) / layer->stride + 1;
}

static int pool_pixels(const hada_layer *layer, int in)
{
    return in < layer->kernel ? 0 : (in - layer->kernel) / layer->stride + 1;
}

static hada_size size_of(const hada_layer *layer, const hada_size *sizes)
{
    const hada_size in = sizes[layer->inputs[0]];
    switch (layer->kind) {
    case HADA_LAYER_CONV: return (hada_size){conv_pixels(layer, in.rows), conv_pixels(layer, in.cols)};
    case HADA_LAYER_POOL: return (hada_size){pool_pixels(layer, in.rows), pool_pixels(layer, in.cols)};
    case HADA_LAYER_RESIZE: return layer->like >= 0 ? sizes[layer->like] : (hada_size){layer->rows, layer->cols};
    case HADA_LAYER_LINEAR: return (hada_size){1, 1};
    default: return in;
    }
}

hada_status hada_net_sizes(const hada_net *net, int rows, int cols, hada_size *sizes, hada_error *err)
{
    for (int i = 0; i < net->count; i++) {
        const hada_layer *layer = &net->layers[i];
        const hada_size size = i ? size_of(layer, sizes) : (hada_size){rows, cols};
        if (size.rows < 1 || size.cols < 1 || size.rows > HADA_NET_MOST_PIXELS || size.cols > HADA_NET_MOST_PIXELS)
            return hada_fail(err, HADA_ERROR_SIZE,
                             "an image of %d x %d pixels is too %s for this net: "
                             "layer %d (%s %s) gives %d x %d",
                             rows, cols,
                             size.rows > HADA_NET_MOST_PIXELS || size.cols > HADA_NET_MOST_PIXELS ? "large" : "small",
                             i, hada_layer_kind_name((int)layer->kind), layer->name, size.rows, size.cols);
        if (layer->kind == HADA_LAYER_LINEAR) {
            const hada_size in = sizes[layer->inputs[0]];
            const long long values = (long long)net->layers[layer->inputs[0]].channels * in.rows * in.cols;
            if (values != layer->in)
                return hada_fail(err, HADA_ERROR_SIZE,
                                 "layer %d (linear %s) takes %d values of an image, "
                                 "but %lld come from %d x %d pixels: "
                                 "resize the image, or change the list",
                                 i, layer->name, layer->in, values, rows, cols);
        }
        sizes[i] = size;
    }
    return HADA_OK;
}
