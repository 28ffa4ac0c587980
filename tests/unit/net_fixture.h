/* Nets on the tests' device: a list run forward and backward, with everything back on the host. */
#ifndef HADA_TESTS_NET_FIXTURE_H
#define HADA_TESTS_NET_FIXTURE_H

#include "testing.h"

#include "net/conv.h"
#include "net/graph.h"

typedef struct net_device {
    hada_context *context;
    hada_slot *slot;
} net_device;

static inline int net_device_open(void **state)
{
    static net_device device;
    hada_error error = {0};
    if (hada_context_create(&device.context, NULL, &error) || hada_slot_create(&device.slot, device.context, &error)) {
        print_error("%s\n", error.message);
        return -1;
    }
    *state = &device;
    return 0;
}

static inline int net_device_close(void **state)
{
    net_device *device = *state;
    hada_slot_destroy(&device->slot);
    const int left = hada_context_bytes(device->context) != 0;
    hada_context_destroy(&device->context);
    return left ? -1 : 0;
}

/* A convolution of 3 x 3 that keeps the size. */
static inline hada_conv_desc net_conv3(int images, int in_channels, int out_channels, int rows, int cols)
{
    return (hada_conv_desc){.images = images,
                            .in_channels = in_channels,
                            .out_channels = out_channels,
                            .in_rows = rows,
                            .in_cols = cols,
                            .kernel_rows = 3,
                            .kernel_cols = 3,
                            .stride = 1,
                            .pad_rows = 1,
                            .pad_cols = 1};
}

/* What goes in and comes out; arrays as the caller of a net has them, freed by net_case_free(). */
typedef struct net_case {
    int images, rows, cols, channels, out_channels, out_rows, out_cols;
    size_t in_count, out_count;
    float *x, *y, *dy, *dx, *gradients;
    size_t bytes; /* that the graph held */
} net_case;

static inline void net_fill(float *out, size_t count, uint64_t stream)
{
    hada_random random;
    hada_random_seed(&random, 5, stream);
    for (size_t i = 0; i < count; i++)
        out[i] = (float)hada_random_normal(&random);
}

static inline net_case net_case_make(const hada_net *net, int images, int rows, int cols)
{
    net_case c = {.images = images, .rows = rows, .cols = cols};
    SCOPED_MEMORY hada_size *sizes = calloc((size_t)net->count, sizeof *sizes);
    const hada_net_info *info = hada_net_get_info(net);
    ASSERT_OK(hada_net_sizes(net, rows, cols, sizes, err));
    c.channels = info->channels;
    c.out_channels = info->out_channels;
    c.out_rows = sizes[net->count - 1].rows;
    c.out_cols = sizes[net->count - 1].cols;
    c.in_count = (size_t)images * (size_t)c.channels * (size_t)rows * (size_t)cols;
    c.out_count = (size_t)images * (size_t)c.out_channels * (size_t)c.out_rows * (size_t)c.out_cols;
    c.x = calloc(c.in_count, sizeof(float));
    c.dx = calloc(c.in_count, sizeof(float));
    c.y = calloc(c.out_count, sizeof(float));
    c.dy = calloc(c.out_count, sizeof(float));
    c.gradients = calloc(net->trained + 1, sizeof(float));
    net_fill(c.x, c.in_count, 1);
    net_fill(c.dy, c.out_count, 2);
    return c;
}

static inline void net_case_free(net_case *c)
{
    HADA_FREE(c->x, c->dx, c->y, c->dy, c->gradients);
}

static inline hada_planar net_planar(cl_mem mem, int channels, int rows, int cols)
{
    const size_t plane = (size_t)rows * (size_t)cols;
    return (hada_planar){mem, 0, plane * (size_t)channels, plane, (size_t)cols};
}

/* Runs forward and, for training graphs, backward; values of the net take the running statistics. */
static inline void net_case_run(net_device *device, hada_net *net, net_case *c, hada_graph_options options,
                                uint64_t step)
{
    SCOPED(hada_graph) * graph;
    SCOPED(hada_buffer) values, in, out, gradients;
    hada_slot *slot = device->slot;
    options.images = c->images;
    options.rows = c->rows;
    options.cols = c->cols;
    const uint64_t before = hada_context_bytes(device->context);
    ASSERT_OK(hada_graph_create(&graph, slot, net, &options, err));
    c->bytes = (size_t)(hada_context_bytes(device->context) - before);
    ASSERT_OK(hada_buffer_create_from(&values, slot, net->values, net->floats * sizeof(float), "values", err));
    ASSERT_OK(hada_buffer_create_from(&in, slot, c->x, c->in_count * sizeof(float), "x", err));
    ASSERT_OK(hada_buffer_create_from(&out, slot, c->dy, c->out_count * sizeof(float), "y", err));
    ASSERT_OK(hada_buffer_create(&gradients, device->context, net->trained * sizeof(float), "gradients", err));
    ASSERT_OK(hada_graph_set_weights(graph, (hada_floats){values.mem, 0}, err));
    hada_graph_set_step(graph, 9, step);
    const hada_planar x = net_planar(in.mem, c->channels, c->rows, c->cols);
    const hada_planar y = net_planar(out.mem, c->out_channels, c->out_rows, c->out_cols);
    ASSERT_OK(hada_graph_load(graph, &x, err));
    ASSERT_OK(hada_graph_forward(graph, err));
    if (options.training) {
        ASSERT_OK(hada_graph_load_gradient(graph, &y, err));
        ASSERT_OK(hada_graph_store(graph, &y, err));
        ASSERT_OK(hada_graph_backward(
            graph, options.weight_gradients ? (hada_floats){gradients.mem, 0} : (hada_floats){0}, 0, err));
        ASSERT_OK(hada_buffer_read(&gradients, slot, 0, c->gradients, net->trained * sizeof(float), err));
        ASSERT_OK(hada_graph_store_gradient(graph, &x, err));
        ASSERT_OK(hada_buffer_read(&in, slot, 0, c->dx, c->in_count * sizeof(float), err));
        ASSERT_OK(hada_buffer_read(&values, slot, 0, net->values, net->floats * sizeof(float), err));
    } else {
        ASSERT_OK(hada_graph_store(graph, &y, err));
    }
    ASSERT_OK(hada_buffer_read(&out, slot, 0, c->y, c->out_count * sizeof(float), err));
}

#endif
