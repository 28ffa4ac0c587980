#include "lpips/lpips_stage.h"

#include <stdio.h>

#include "net/layer_launch.h"

/* A convolution with ReLU, or (channels 0) a maximum pooling; `number` is its place in torchvision's Sequential. After
 * a `tap` the features are compared. */
typedef struct part {
    int number, channels, kernel, stride, pad, tap;
} part;

/* Simonyan and Zisserman 2015, configuration D, up to relu5_3. */
static const part vgg[] = {{0, 64, 3, 1, 1, 0},   {2, 64, 3, 1, 1, 1},   {4, 0, 2, 2, 0, 0},
                           {5, 128, 3, 1, 1, 0},  {7, 128, 3, 1, 1, 1},  {9, 0, 2, 2, 0, 0},
                           {10, 256, 3, 1, 1, 0}, {12, 256, 3, 1, 1, 0}, {14, 256, 3, 1, 1, 1},
                           {16, 0, 2, 2, 0, 0},   {17, 512, 3, 1, 1, 0}, {19, 512, 3, 1, 1, 0},
                           {21, 512, 3, 1, 1, 1}, {23, 0, 2, 2, 0, 0},   {24, 512, 3, 1, 1, 0},
                           {26, 512, 3, 1, 1, 0}, {28, 512, 3, 1, 1, 1}, {0}};

/* Krizhevsky 2014, as torchvision has it. */
static const part alex[] = {{0, 64, 11, 4, 2, 1}, {2, 0, 3, 2, 0, 0},   {3, 192, 5, 1, 2, 1},  {5, 0, 3, 2, 0, 0},
                            {6, 384, 3, 1, 1, 1}, {8, 256, 3, 1, 1, 1}, {10, 256, 3, 1, 1, 1}, {0}};

/* The parts of a stage: from the one behind the last tap. *channels: what it takes. */
static const part *parts_of(hada_lpips_net net, int stage, int *channels)
{
    const part *at = net == HADA_LPIPS_ALEX ? alex : vgg;
    *channels = 3;
    while (stage)
        if (at++->tap) {
            *channels = at[-1].channels;
            stage--;
        }
    return at;
}

int hada_lpips_stage_channels(hada_lpips_net net, int stage)
{
    int channels;
    const part *at = parts_of(net, stage, &channels);
    while (!at->tap)
        at++;
    return at->channels;
}

int hada_lpips_least_size(hada_lpips_net net)
{
    return net == HADA_LPIPS_ALEX ? 31 : 16; /* one pixel is left at the end */
}

/* 0 ... 1 to -1 ... 1 and then (x - shift) / scale, with the constants of the package: a convolution of 1 x 1. */
static void fill_scaling(hada_net *net)
{
    static const double shift[3] = {-0.030, -0.088, -0.188}, scale[3] = {0.458, 0.448, 0.450};
    float *weight = net->values + hada_net_find(net, "scaling.weight")->offset;
    float *bias = net->values + hada_net_find(net, "scaling.bias")->offset;
    for (int c = 0; c < 3; c++) {
        weight[3 * c + c] = (float)(2.0 / scale[c]);
        bias[c] = (float)((-1.0 - shift[c]) / scale[c]);
    }
}

static hada_status list(hada_net *net, hada_lpips_net kind, int stage, hada_error *err)
{
    int at;
    hada_layer layer = hada_layer_of(HADA_LAYER_INPUT, "", 0);
    const part *parts = parts_of(kind, stage, &layer.channels);
    hada_status status = hada_net_add(net, &layer, &at, err);
    if (!status && !stage) {
        layer = hada_layer_of(HADA_LAYER_CONV, "scaling", at);
        layer.channels = 3;
        layer.kernel = 1;
        layer.pad = 0;
        status = hada_net_add(net, &layer, &at, err);
    }
    for (int last = 0; !status && !last; parts++) {
        layer = hada_layer_of(parts->channels ? HADA_LAYER_CONV : HADA_LAYER_POOL, "", at);
        layer.kernel = parts->kernel;
        layer.stride = parts->stride;
        if (parts->channels) {
            snprintf(layer.name, sizeof layer.name, "features.%d", parts->number);
            layer.channels = parts->channels;
            layer.pad = parts->pad;
            layer.activation = HADA_ACTIVATION_RELU;
        }
        status = hada_net_add(net, &layer, &at, err);
        last = parts->tap;
    }
    return status ? status : hada_net_finish(net, err);
}

hada_status hada_lpips_stage_make(hada_net **out, hada_lpips_net kind, int stage, const hada_tensors *file,
                                  hada_error *err)
{
    hada_status status = hada_net_begin(out, 1, err);
    if (!status)
        status = list(*out, kind, stage, err);
    if (!status && !stage)
        fill_scaling(*out);
    if (!status)
        status = hada_net_read_but(*out, file, "", "scaling.", err);
    if (status)
        hada_net_destroy(out);
    return status;
}

hada_status hada_lpips_distance(hada_slot *slot, const hada_tensor *x, hada_floats weights, hada_floats out,
                                hada_error *err)
{
    if (x->images < 2 || x->images % 2)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "LPIPS compares pairs, not %d images", x->images);
    const hada_tensor_place at = hada_tensor_place_of(x);
    const cl_int pairs = x->images / 2;
    const cl_ulong w_offset = weights.offset, out_offset = out.offset;
    hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    grid.global[2] = (size_t)pairs;
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at), HADA_ARG(x->channels), HADA_ARG(x->rows),     HADA_ARG(x->cols),
                             HADA_ARG(pairs),        HADA_ARG(grid.span),   HADA_ARG(weights.mem), HADA_ARG(w_offset),
                             HADA_ARG(out.mem),      HADA_ARG(out_offset)};
    const double pixels = (double)pairs * x->rows * x->cols;
    hada_slot_cost(slot, pixels * 4.0 * (2.0 * x->channels + 1.0), pixels * 9.0 * x->channels);
    return hada_layer_launch(slot, "lpips_distance", "lpips_distance", x, &grid, args, HADA_COUNT(args), err);
}
