/* What convolutions take over where nobody trains. Doubling a part of their channels: the bits of resizing,
 * concatenating and convolving one after the other; nets that have it. */
#include "net_fixture.h"

typedef struct doubled_case {
    int images, before, doubled, out, rows, cols;
} doubled_case;

/* Sizes with tiles that overlap, edges that meet in a tile, one block of outputs and two, one launch and three. */
static const doubled_case cases[] = {{1, 16, 32, 16, 12, 20},
                                     {2, 32, 16, 32, 14, 18},
                                     {2, 16, 20, 24, 4, 4},
                                     {1, 48, 48, 20, 36, 6},
                                     {2, 80, 160, 32, 10, 16}};

static hada_conv_desc desc_of(const doubled_case *c)
{
    hada_conv_desc desc = net_conv3(c->images, c->before + c->doubled, c->out, c->rows, c->cols);
    desc.activation = HADA_ACTIVATION_RELU;
    desc.method = HADA_CONV_WINOGRAD4;
    return desc;
}

static hada_tensor tensor_of(net_device *device, hada_buffer *buffer, int images, int channels, int rows, int cols)
{
    hada_tensor tensor = hada_tensor_at(device->context, NULL, 0, images, channels, rows, cols);
    const size_t bytes = tensor.image_stride * (size_t)images * sizeof(float);
    ASSERT_OK(hada_buffer_create(buffer, device->context, bytes, "a tensor", err));
    ASSERT_OK(hada_buffer_clear(buffer, device->slot, 0, bytes, err));
    tensor.mem = buffer->mem;
    return tensor;
}

static hada_tensor noise_of(net_device *device, hada_buffer *buffer, int images, int channels, int rows, int cols,
                            uint64_t stream)
{
    SCOPED(hada_buffer) planes;
    const size_t plane = (size_t)rows * (size_t)cols, count = plane * (size_t)(images * channels);
    SCOPED_MEMORY float *values = calloc(count, sizeof *values);
    net_fill(values, count, stream);
    const hada_tensor tensor = tensor_of(device, buffer, images, channels, rows, cols);
    ASSERT_OK(hada_buffer_create_from(&planes, device->slot, values, count * sizeof(float), "planes", err));
    const hada_planar planar = {planes.mem, 0, plane * (size_t)channels, plane, (size_t)cols};
    ASSERT_OK(hada_tensor_load(device->slot, &planar, &tensor, err));
    return tensor;
}

static void same_bytes(net_device *device, const hada_buffer *a, const hada_buffer *b)
{
    SCOPED_MEMORY void *one = malloc(a->bytes), *other = malloc(b->bytes);
    ASSERT_OK(hada_buffer_read(a, device->slot, 0, one, a->bytes, err));
    ASSERT_OK(hada_buffer_read(b, device->slot, 0, other, b->bytes, err));
    assert_int_equal(a->bytes, b->bytes);
    assert_memory_equal(one, other, a->bytes);
}

static void one_case(net_device *device, const doubled_case *c)
{
    hada_buffer memory[10];
    hada_buffer *next = memory;
    hada_conv_desc whole = desc_of(c), apart = whole;
    hada_conv *convs[2];
    const size_t weights = 9 * (size_t)whole.in_channels * (size_t)c->out;
    float *values = calloc(weights + (size_t)c->out, sizeof *values);
    apart.doubled = c->doubled;
    if (!hada_conv_doubles(device->context, &apart)) { /* blocks or shapes of kernels that have no such way */
        assert_int_equal(hada_conv_create(&convs[0], device->slot, &apart, NULL), HADA_ERROR_UNSUPPORTED);
        free(values);
        return;
    }
    net_fill(values, weights + (size_t)c->out, 7);
    ASSERT_OK(
        hada_buffer_create_from(next, device->slot, values, (weights + (size_t)c->out) * sizeof(float), "w", err));
    const hada_floats w = {next->mem, 0}, bias = {next->mem, weights};
    next++;
    const hada_tensor x = noise_of(device, next++, c->images, c->before, c->rows, c->cols, 1);
    const hada_tensor low = noise_of(device, next++, c->images, c->doubled, c->rows / 2, c->cols / 2, 2);
    const hada_tensor high = tensor_of(device, next++, c->images, c->doubled, c->rows, c->cols);
    const hada_tensor all = tensor_of(device, next++, c->images, whole.in_channels, c->rows, c->cols);
    hada_buffer *const y = next;
    const hada_tensor y0 = tensor_of(device, next++, c->images, c->out, c->rows, c->cols);
    const hada_tensor y1 = tensor_of(device, next++, c->images, c->out, c->rows, c->cols);
    const hada_tensor pooled0 = tensor_of(device, next++, c->images, c->out, c->rows / 2, c->cols / 2);
    const hada_tensor pooled1 = tensor_of(device, next++, c->images, c->out, c->rows / 2, c->cols / 2);
    ASSERT_OK(hada_resize_forward(device->slot, HADA_RESIZE_LINEAR, &low, &high, err));
    ASSERT_OK(hada_place(device->slot, &x, &all, 0, 0, 0, 0, err));
    ASSERT_OK(hada_place(device->slot, &high, &all, 0, 0, c->before, 0, err));
    ASSERT_OK(hada_conv_create(&convs[0], device->slot, &whole, err));
    ASSERT_OK(hada_conv_create(&convs[1], device->slot, &apart, err));
    for (int i = 0; i < 2; i++)
        ASSERT_OK(hada_conv_set_weights(convs[i], w, err));
    ASSERT_OK(hada_conv_forward(convs[0], &all, NULL, bias, &y0, &pooled0, err));
    ASSERT_OK(hada_conv_forward(convs[1], &x, &low, bias, &y1, &pooled1, err));
    same_bytes(device, &y[0], &y[1]);
    same_bytes(device, &y[2], &y[3]);
    for (int i = 0; i < 2; i++)
        hada_conv_destroy(&convs[i]);
    while (next > memory)
        hada_buffer_destroy(--next);
    free(values);
}

TEST(bits)
{
    for (size_t i = 0; i < HADA_COUNT(cases); i++)
        one_case(*state, &cases[i]);
}

TEST(refusals)
{
    net_device *device = *state;
    const hada_conv_desc good = desc_of(&cases[0]);
    hada_conv_desc bad = good;
    assert_false(hada_conv_doubles(device->context, &good)); /* none of its channels */
    bad.doubled = 31;                                        /* no whole blocks before them */
    assert_false(hada_conv_doubles(device->context, &bad));
    bad.doubled = 48;
    assert_false(hada_conv_doubles(device->context, &bad));
    bad.doubled = 32;
    bad.in_rows = 13;
    assert_false(hada_conv_doubles(device->context, &bad));
    bad = good;
    bad.doubled = 32;
    bad.training = 1;
    assert_false(hada_conv_doubles(device->context, &bad));
    bad.training = 0;
    bad.method = HADA_CONV_DIRECT;
    assert_false(hada_conv_doubles(device->context, &bad));
}

/* Values that others read as well, resized differently or placed first stay as they are. */
#define HEAD                                                                                                           \
    "{\"format\":\"hadalens-net-1\",\"layers\":[{\"layer\":\"input\",\"channels\":3},"                                 \
    "{\"layer\":\"conv\",\"name\":\"a\",\"channels\":16,\"activation\":\"relu\"},{\"layer\":\"pool\"},"                \
    "{\"layer\":\"conv\",\"name\":\"b\",\"channels\":16},"
#define TAIL "{\"layer\":\"conv\",\"name\":\"c\",\"channels\":16},{\"layer\":\"conv\",\"name\":\"d\",\"channels\":3}]}"
static const char *const lists[] = {
    HEAD "{\"layer\":\"resize\",\"resize\":\"linear\",\"like\":1},{\"layer\":\"concat\",\"from\":[1,4]}," TAIL,
    HEAD "{\"layer\":\"resize\",\"resize\":\"nearest\",\"like\":1},{\"layer\":\"concat\",\"from\":[1,4]}," TAIL,
    HEAD "{\"layer\":\"resize\",\"resize\":\"linear\",\"like\":1},{\"layer\":\"concat\",\"from\":[4,1]}," TAIL,
    HEAD "{\"layer\":\"resize\",\"resize\":\"linear\",\"like\":1},{\"layer\":\"concat\",\"from\":[4,4]}," TAIL,
    HEAD
    "{\"layer\":\"resize\",\"resize\":\"linear\",\"like\":1},{\"layer\":\"concat\",\"from\":[1,4]}," /* read twice */
    "{\"layer\":\"conv\",\"name\":\"c\",\"channels\":16},{\"layer\":\"concat\",\"from\":[6,4]},"
    "{\"layer\":\"conv\",\"name\":\"d\",\"channels\":3}]}",
};

/* Nets without layers that training runs otherwise: inference has the bits of the forward pass of training. */
TEST(nets)
{
    static const int sizes[][2] = {{24, 32}, {26, 18}, {27, 21}};
    for (size_t n = 0; n < HADA_COUNT(lists); n++)
        for (size_t s = 0; s < HADA_COUNT(sizes); s++) {
            SCOPED(hada_net) * net;
            ASSERT_OK(hada_net_create(&net, lists[n], 3, err));
            net_case one = net_case_make(net, 2, sizes[s][0], sizes[s][1]);
            net_case other = net_case_make(net, 2, sizes[s][0], sizes[s][1]);
            net_case_run(*state, net, &one, (hada_graph_options){0}, 0);
            net_case_run(*state, net, &other,
                         (hada_graph_options){.training = 1, .weight_gradients = 1, .input_gradient = 1}, 0);
            assert_memory_equal(one.y, other.y, one.out_count * sizeof(float));
            net_case_free(&one);
            net_case_free(&other);
        }
}

FIXTURE(net_device_open, net_device_close)
