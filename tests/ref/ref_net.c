#include "ref/ref_net.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What a layer gives: [image][channel][row][col]. */
typedef struct block {
    int images, channels, rows, cols;
    double *data;
} block;

static double *at(const block *b, int image, int channel, int row, int col)
{
    return b->data +
           (((size_t)image * (size_t)b->channels + (size_t)channel) * (size_t)b->rows + (size_t)row) * (size_t)b->cols +
           (size_t)col;
}

static double inside(const block *b, int image, int channel, int row, int col)
{
    return row < 0 || row >= b->rows || col < 0 || col >= b->cols ? 0.0 : *at(b, image, channel, row, col);
}

static int clamped(int value, int count)
{
    return value < 0 ? 0 : value >= count ? count - 1 : value;
}

static double activated(const hada_layer *layer, double x)
{
    switch (layer->activation) {
    case HADA_ACTIVATION_RELU: return x > 0 ? x : 0;
    case HADA_ACTIVATION_LEAKY_RELU: return x > 0 ? x : layer->slope * x;
    case HADA_ACTIVATION_SIGMOID: return 1 / (1 + exp(-x));
    case HADA_ACTIVATION_NONE: break;
    }
    return x;
}

/* One value of a convolution; transposed: the values x that meet this pixel are those with
 * r * stride + u - pad = row. */
static double conv_at(const hada_layer *l, const double *w, const block *x, int n, int o, int row, int col)
{
    double sum = 0;
    for (int i = 0; i < x->channels; i++)
        for (int u = 0; u < l->kernel; u++)
            for (int v = 0; v < l->kernel; v++) {
                if (!l->transposed) {
                    const double weight = w[((o * x->channels + i) * l->kernel + u) * l->kernel + v];
                    sum += weight * inside(x, n, i, row * l->stride + u - l->pad, col * l->stride + v - l->pad);
                    continue;
                }
                const int r = row + l->pad - u, c = col + l->pad - v;
                if (r < 0 || c < 0 || r % l->stride || c % l->stride)
                    continue;
                const double weight = w[((i * l->channels + o) * l->kernel + u) * l->kernel + v];
                sum += weight * inside(x, n, i, r / l->stride, c / l->stride);
            }
    return sum;
}

static double pool_at(const hada_layer *l, const block *x, int n, int c, int row, int col)
{
    double most = -INFINITY, sum = 0;
    for (int u = 0; u < l->kernel; u++)
        for (int v = 0; v < l->kernel; v++) {
            const double value = *at(x, n, c, row * l->stride + u, col * l->stride + v);
            most = fmax(most, value);
            sum += value;
        }
    return l->pool == HADA_POOL_MAX ? most : sum / (l->kernel * l->kernel);
}

/* Places and weights of four pixels along one axis. */
typedef struct taps {
    int place[4];
    double weight[4];
} taps;

static double cubic(double t)
{
    const double a = -0.75;
    t = fabs(t);
    return t <= 1 ? ((a + 2) * t - (a + 3)) * t * t + 1 : t < 2 ? ((a * t - 5 * a) * t + 8 * a) * t - 4 * a : 0;
}

static taps taps_of(hada_resize resize, int in, int out, int place)
{
    taps t = {{0, 0, 0, 0}, {0, 0, 0, 0}};
    if (resize == HADA_RESIZE_NEAREST) {
        t.place[0] = clamped((int)((long long)place * in / out), in);
        t.weight[0] = 1;
        return t;
    }
    const int aligned = resize == HADA_RESIZE_LINEAR_ALIGNED || resize == HADA_RESIZE_CUBIC_ALIGNED;
    const int linear = resize == HADA_RESIZE_LINEAR || resize == HADA_RESIZE_LINEAR_ALIGNED;
    double source =
        aligned ? (out > 1 ? (double)place * (in - 1) / (out - 1) : 0) : (place + 0.5) * (double)in / (double)out - 0.5;
    if (linear && source < 0)
        source = 0;
    const int first = (int)floor(source) - (linear ? 0 : 1);
    for (int k = 0; k < (linear ? 2 : 4); k++) {
        t.place[k] = clamped(first + k, in);
        t.weight[k] = linear ? fmax(0, 1 - fabs(source - (first + k))) : cubic(source - (first + k));
    }
    return t;
}

static double resized_at(const hada_layer *l, const block *x, const block *y, int n, int c, int row, int col)
{
    const taps down = taps_of(l->resize, x->rows, y->rows, row), right = taps_of(l->resize, x->cols, y->cols, col);
    double sum = 0;
    for (int u = 0; u < 4; u++)
        for (int v = 0; v < 4; v++)
            sum += down.weight[u] * right.weight[v] * *at(x, n, c, down.place[u], right.place[v]);
    return sum;
}

/* Which part of a concatenation a channel belongs to; *channel becomes its number there. */
static const block *part_of(const hada_layer *layer, const block *blocks, int *channel)
{
    int k = 0;
    while (*channel >= blocks[layer->inputs[k]].channels)
        *channel -= blocks[layer->inputs[k++]].channels;
    return &blocks[layer->inputs[k]];
}

static void norm(const hada_net *net, int layer, const double *values, int training, const block *x, block *y)
{
    const size_t pixels = (size_t)x->rows * (size_t)x->cols;
    for (int colour = 0; colour < net->colours; colour++)
        for (int c = 0; c < x->channels; c++) {
            const double *part[4];
            for (int i = 0; i < 4; i++)
                part[i] = values + hada_net_parameter(net, layer, colour, i)->offset + c;
            double mean = 0, variance = 0, count = 0;
            for (int n = colour; n < x->images; n += net->colours)
                for (size_t p = 0; p < pixels; p++, count++)
                    mean += at(x, n, c, 0, 0)[p];
            mean /= count;
            for (int n = colour; n < x->images; n += net->colours)
                for (size_t p = 0; p < pixels; p++)
                    variance += (at(x, n, c, 0, 0)[p] - mean) * (at(x, n, c, 0, 0)[p] - mean) / count;
            if (!training) {
                mean = *part[2];
                variance = *part[3];
            }
            const double scale = *part[0] / sqrt(variance + net->layers[layer].eps);
            for (int n = colour; n < x->images; n += net->colours)
                for (size_t p = 0; p < pixels; p++)
                    at(y, n, c, 0, 0)[p] = (at(x, n, c, 0, 0)[p] - mean) * scale + *part[1];
        }
}

static double linear_at(const hada_layer *l, const double *w, const block *x, int n, int o)
{
    double sum = 0;
    for (int i = 0; i < l->in; i++)
        sum += w[(size_t)o * (size_t)l->in + (size_t)i] * x->data[(size_t)n * (size_t)l->in + (size_t)i];
    return sum;
}

static double value_at(const hada_net *net, int index, const double *values, const block *blocks, int n, int c, int row,
                       int col)
{
    const hada_layer *l = &net->layers[index];
    const block *x = &blocks[l->inputs[0]];
    const double *w = NULL;
    double bias = 0;
    if (l->kind == HADA_LAYER_CONV || l->kind == HADA_LAYER_LINEAR) {
        w = values + hada_net_parameter(net, index, 0, 0)->offset;
        bias = l->bias ? values[hada_net_parameter(net, index, 0, 1)->offset + (size_t)c] : 0;
    }
    switch (l->kind) {
    case HADA_LAYER_CONV: return activated(l, conv_at(l, w, x, n, c, row, col) + bias);
    case HADA_LAYER_LINEAR: return activated(l, linear_at(l, w, x, n, c) + bias);
    case HADA_LAYER_ACTIVATION: return activated(l, *at(x, n, c, row, col));
    case HADA_LAYER_POOL: return pool_at(l, x, n, c, row, col);
    case HADA_LAYER_RESIZE: return resized_at(l, x, &blocks[index], n, c, row, col);
    case HADA_LAYER_CONCAT: {
        const block *part = part_of(l, blocks, &c);
        return inside(part, n, c, row, col);
    }
    default: return *at(x, n, c, row, col);
    }
}

static void run_layer(const hada_net *net, int index, const double *values, int training, block *blocks)
{
    block *y = &blocks[index];
    if (net->layers[index].kind == HADA_LAYER_NORM) {
        norm(net, index, values, training, &blocks[net->layers[index].inputs[0]], y);
        return;
    }
    for (int n = 0; n < y->images; n++)
        for (int c = 0; c < y->channels; c++)
            for (int row = 0; row < y->rows; row++)
                for (int col = 0; col < y->cols; col++)
                    *at(y, n, c, row, col) = value_at(net, index, values, blocks, n, c, row, col);
}

hada_status hada_ref_net_forward(const hada_net *net, const double *values, int training, int images, int rows,
                                 int cols, const double *x, double *y, hada_error *err)
{
    block *blocks = NULL;
    hada_size *sizes = NULL;
    hada_status status =
        hada_allocated(blocks = hada_alloc((size_t)net->count, sizeof *blocks, "a reference net", err));
    if (!status)
        status = hada_allocated(sizes = hada_alloc((size_t)net->count, sizeof *sizes, "a reference net", err));
    if (!status)
        status = hada_net_sizes(net, rows, cols, sizes, err);
    for (int i = 0; !status && i < net->count; i++) {
        /* the channels of the caller are images here, which changes nothing in their order */
        block *b = &blocks[i];
        *b = (block){images * net->colours, net->layers[i].channels, sizes[i].rows, sizes[i].cols, NULL};
        const size_t count = (size_t)b->images * (size_t)b->channels * (size_t)b->rows * (size_t)b->cols;
        status = hada_allocated(b->data = hada_alloc(count, sizeof(double), "a reference net", err));
        if (!status && i)
            run_layer(net, i, values, training, blocks);
        else if (!status)
            memcpy(b->data, x, count * sizeof(double));
        if (!status && i == net->count - 1)
            memcpy(y, b->data, count * sizeof(double));
    }
    for (int i = 0; blocks && i < net->count; i++)
        free(blocks[i].data);
    HADA_FREE(blocks, sizes);
    return status;
}
