/* Layers and losses on the device, beyond their arithmetic (tests/check): in place, either block, odd inputs, refusals.
 */
#include "net/layers.h"
#include "net_fixture.h"
#include "ref/ref_layers.h"

/* A tensor of its own, normal numbers times `scale` plus `level`, in blocks of 8 or 16. */
typedef struct owned {
    hada_buffer buffer;
    hada_tensor tensor;
    hada_ref_shape shape;
    float *values; /* as plain array */
} owned;

static owned make(net_device *device, int block, hada_ref_shape shape, float scale, float level, uint64_t stream)
{
    owned o = {.shape = shape};
    const size_t count = hada_ref_values(&shape);
    const size_t image = hada_tensor_image_floats(block, shape.channels, shape.rows, shape.cols);
    SCOPED(hada_buffer) plain;
    o.values = calloc(count, sizeof *o.values);
    assert_non_null(o.values);
    net_fill(o.values, count, stream);
    for (size_t i = 0; i < count; i++)
        o.values[i] = o.values[i] * scale + level;
    ASSERT_OK(hada_buffer_create(&o.buffer, device->context, image * (size_t)shape.images * sizeof(float), "x", err));
    ASSERT_OK(hada_buffer_create_from(&plain, device->slot, o.values, count * sizeof(float), "x", err));
    o.tensor = (hada_tensor){o.buffer.mem, 0, image, shape.images, shape.channels, shape.rows, shape.cols, block};
    const hada_planar from = net_planar(plain.mem, shape.channels, shape.rows, shape.cols);
    ASSERT_OK(hada_tensor_load(device->slot, &from, &o.tensor, err));
    ASSERT_OK(hada_slot_finish(device->slot, err));
    return o;
}

/* Reads the tensor back into its values. */
static void fetch(net_device *device, owned *o)
{
    const size_t bytes = hada_ref_values(&o->shape) * sizeof(float);
    SCOPED(hada_buffer) plain;
    ASSERT_OK(hada_buffer_create(&plain, device->context, bytes, "y", err));
    const hada_planar to = net_planar(plain.mem, o->shape.channels, o->shape.rows, o->shape.cols);
    ASSERT_OK(hada_tensor_store(device->slot, &o->tensor, &to, err));
    ASSERT_OK(hada_buffer_read(&plain, device->slot, 0, o->values, bytes, err));
}

static void drop(owned *o)
{
    hada_buffer_destroy(&o->buffer);
    free(o->values);
}

static void equal(const owned *a, const owned *b)
{
    assert_memory_equal(a->values, b->values, hada_ref_values(&a->shape) * sizeof(float));
}

static const hada_ref_shape usual = {2, 11, 9, 13};

TEST(outputs_may_be_inputs)
{
    net_device *device = *state;
    for (int block = 8; block <= 16; block += 8) {
        owned x = make(device, block, usual, 1.0f, 0.0f, 1), y = make(device, block, usual, 1.0f, 0.0f, 2);
        ASSERT_OK(hada_activation_forward(device->slot, HADA_ACTIVATION_SIGMOID, 0.0f, &x.tensor, &y.tensor, err));
        ASSERT_OK(hada_activation_forward(device->slot, HADA_ACTIVATION_SIGMOID, 0.0f, &x.tensor, &x.tensor, err));
        fetch(device, &x);
        fetch(device, &y);
        equal(&x, &y);
        owned dy = make(device, block, usual, 1.0f, 0.0f, 3), dx = make(device, block, usual, 1.0f, 0.0f, 4);
        ASSERT_OK(hada_activation_backward(device->slot, HADA_ACTIVATION_LEAKY_RELU, 0.1f, &y.tensor, &dy.tensor,
                                           &dx.tensor, err));
        ASSERT_OK(hada_activation_backward(device->slot, HADA_ACTIVATION_LEAKY_RELU, 0.1f, &y.tensor, &dy.tensor,
                                           &dy.tensor, err));
        fetch(device, &dx);
        fetch(device, &dy);
        equal(&dx, &dy);
        drop(&x);
        drop(&y);
        drop(&dx);
        drop(&dy);
    }
}

TEST(blocks_give_the_same)
{
    net_device *device = *state;
    const hada_ref_shape half = {2, 11, 4, 6}, large = {2, 11, 17, 29};
    owned small[2], wide[2], dropped[2];
    for (int i = 0; i < 2; i++) {
        const int block = 8 << i;
        owned x = make(device, block, usual, 1.0f, 0.0f, 1);
        small[i] = make(device, block, half, 1.0f, 0.0f, 2);
        wide[i] = make(device, block, large, 1.0f, 0.0f, 3);
        dropped[i] = make(device, block, usual, 1.0f, 0.0f, 4);
        ASSERT_OK(hada_pool_forward(device->slot, HADA_POOL_MAX, 2, 2, &x.tensor, &small[i].tensor, err));
        ASSERT_OK(hada_resize_forward(device->slot, HADA_RESIZE_CUBIC, &x.tensor, &wide[i].tensor, err));
        ASSERT_OK(hada_dropout(device->slot, 0.3f, 5, 6, &x.tensor, &dropped[i].tensor, err));
        fetch(device, &small[i]);
        fetch(device, &wide[i]);
        fetch(device, &dropped[i]);
        drop(&x);
    }
    equal(&small[0], &small[1]);
    equal(&wide[0], &wide[1]);
    equal(&dropped[0], &dropped[1]);
    for (int i = 0; i < 2; i++) {
        drop(&small[i]);
        drop(&wide[i]);
        drop(&dropped[i]);
    }
}

/* Known answers of the generator's authors (Random123, kat_vectors). */
TEST(philox)
{
    uint32_t seven[4] = {0}, ten[4] = {0};
    hada_ref_philox(7, seven, 0, 0);
    hada_ref_philox(10, ten, 0, 0);
    static const uint32_t expected[2][4] = {{0x5f6fb709, 0x0d893f64, 0x4f121f81, 0x4f730a48},
                                            {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}};
    assert_memory_equal(seven, expected[0], sizeof seven);
    assert_memory_equal(ten, expected[1], sizeof ten);
}

/* How many of the values are not zero. */
static size_t kept(const owned *o)
{
    size_t count = 0;
    for (size_t i = 0; i < hada_ref_values(&o->shape); i++)
        count += o->values[i] != 0.0f;
    return count;
}

TEST(dropout_keeps_its_share)
{
    net_device *device = *state;
    const hada_ref_shape many = {2, 16, 64, 64};
    const double count = (double)hada_ref_values(&many), p = 0.3;
    owned x = make(device, 8, many, 0.0f, 1.0f, 1), y = make(device, 8, many, 1.0f, 0.0f, 2);
    size_t common = 0;
    float *first = calloc(hada_ref_values(&many), sizeof *first);
    for (uint64_t step = 1; step <= 2; step++) {
        ASSERT_OK(hada_dropout(device->slot, (float)p, 77, step, &x.tensor, &y.tensor, err));
        fetch(device, &y);
        /* five standard deviations */
        assert_true(fabs((double)kept(&y) - count * (1.0 - p)) < 5.0 * sqrt(count * p * (1.0 - p)));
        for (size_t i = 0; i < hada_ref_values(&many); i++) {
            assert_true(y.values[i] == 0.0f || fabsf(y.values[i] - 1.0f / 0.7f) < 1e-6f);
            common += step == 2 && y.values[i] != 0.0f && first[i] != 0.0f;
        }
        memcpy(first, y.values, hada_ref_values(&many) * sizeof *first);
    }
    /* two steps are independent */
    assert_true(fabs((double)common - count * 0.49) < 5.0 * sqrt(count * 0.49 * 0.51));
    ASSERT_OK(hada_dropout(device->slot, 0.0f, 77, 1, &x.tensor, &y.tensor, err));
    fetch(device, &y);
    equal(&x, &y);
    free(first);
    drop(&x);
    drop(&y);
}

/* A mean ten thousand times the deviation: a difference of sums of squares would have no digit left. */
TEST(batch_statistics_do_not_cancel)
{
    net_device *device = *state;
    const hada_ref_shape shape = {2, 3, 40, 50};
    owned x = make(device, 8, shape, 0.1f, 1000.0f, 1), y = make(device, 8, shape, 1.0f, 0.0f, 2);
    float values[4 * 3] = {1, 1, 1, 0, 0, 0, 0, 0, 0, 1, 1, 1}, saved[6];
    hada_buffer arrays, scratch;
    ASSERT_OK(hada_buffer_create(&arrays, device->context, sizeof values + sizeof saved, "values", err));
    ASSERT_OK(hada_buffer_write(&arrays, device->slot, 0, values, sizeof values, err));
    ASSERT_OK(hada_buffer_create(&scratch, device->context, hada_batch_norm_scratch(&x.tensor), "sums", err));
    const cl_mem mem = arrays.mem;
    const hada_batch_norm norm = {{mem, 0}, {mem, 3}, {mem, 6}, {mem, 9}, 0.0f, 1.0f};
    ASSERT_OK(
        hada_batch_norm_train(device->slot, &norm, &x.tensor, &y.tensor, (hada_floats){mem, 12}, scratch.mem, err));
    ASSERT_OK(hada_buffer_read(&arrays, device->slot, sizeof values, saved, sizeof saved, err));
    double *plain = calloc(hada_ref_values(&shape), sizeof *plain), mean[3], variance[3];
    for (size_t i = 0; i < hada_ref_values(&shape); i++)
        plain[i] = x.values[i];
    hada_ref_batch_statistics(&shape, plain, mean, variance);
    for (int c = 0; c < 3; c++) {
        assert_true(fabs(saved[c] - mean[c]) < 1e-4);
        assert_true(fabs(saved[3 + c] * sqrt(variance[c]) - 1.0) < 1e-5);
    }
    free(plain);
    HADA_DESTROY_BUFFERS(&arrays, &scratch);
    drop(&x);
    drop(&y);
}

/* Every refusal says why, and leaves the output as it was. */
TEST(what_does_not_fit_is_refused)
{
    net_device *device = *state;
    hada_slot *slot = device->slot;
    const int block = hada_net_block(device->context);
    owned x = make(device, block, usual, 1.0f, 0.0f, 1), y = make(device, block, usual, 1.0f, 0.0f, 2);
    const hada_tensor *in = &x.tensor, *out = &y.tensor;
    const cl_mem mem = x.buffer.mem;
    const hada_batch_norm norm = {{mem, 0}, {mem, 0}, {mem, 0}, {mem, 0}, 1e-5f, 0.1f};
    hada_tensor point = *out;
    point.images = point.rows = point.cols = 1;
    ASSERT_FAILS(hada_activation_forward(slot, HADA_ACTIVATION_LEAKY_RELU, -0.5f, in, out, err), HADA_ERROR_ARGUMENT,
                 "slope");
    ASSERT_FAILS(hada_batch_norm_train(slot, &norm, &point, &point, (hada_floats){mem, 0}, mem, err), HADA_ERROR_SIZE,
                 "one value per channel");
    const size_t bytes = hada_ref_values(&usual) * sizeof(float);
    float *before = malloc(bytes);
    memcpy(before, y.values, bytes);
    fetch(device, &y);
    assert_memory_equal(y.values, before, bytes);
    free(before);
    drop(&x);
    drop(&y);
}

FIXTURE(net_device_open, net_device_close)
