/* Nets against what PyTorch computed for them (tests/golden/make_nets.py): outputs, gradients, running statistics. */
#include "net_fixture.h"

#include "io/safetensors.h"

static hada_tensors *open_golden(const char *name, char *path, size_t size)
{
    hada_tensors *file;
    snprintf(path, size, "%s/tests/golden/net_%s.safetensors", HADALENS_SOURCE_DIR, name);
    ASSERT_OK(hada_tensors_open(&file, path, err));
    return file;
}

static double *golden(const hada_tensors *file, const char *name, size_t count)
{
    const hada_stored_tensor *stored = hada_tensors_find(file, name);
    assert_non_null(stored);
    assert_int_equal(stored->bytes, count * sizeof(float));
    SCOPED_MEMORY float *values = calloc(count, sizeof *values);
    double *out = calloc(count, sizeof *out);
    ASSERT_OK(hada_tensor_copy_f32(stored, 0, count, values, err));
    for (size_t i = 0; i < count; i++)
        out[i] = values[i];
    return out;
}

static void expect(const hada_tensors *file, const char *name, const float *got, size_t count, double tolerance)
{
    SCOPED_MEMORY double *want = golden(file, name, count);
    const double error = relative_error(got, want, count);
    if (!(error <= tolerance))
        fail_msg("%s: relative error %.2e above %.0e", name, error, tolerance);
}

static void take(const hada_tensors *file, const char *name, float *out, size_t count)
{
    SCOPED_MEMORY double *values = golden(file, name, count);
    for (size_t i = 0; i < count; i++)
        out[i] = (float)values[i];
}

static void check(net_device *device, const char *name, int recompute)
{
    char path[512];
    SCOPED(hada_net) * net;
    hada_tensors *file = open_golden(name, path, sizeof path);
    const hada_stored_tensor *x = hada_tensors_find(file, "golden.x");
    assert_non_null(x);
    ASSERT_OK(hada_net_load(&net, path, err));
    net_case c = net_case_make(net, (int)x->shape[0], (int)x->shape[2], (int)x->shape[3]);
    take(file, "golden.x", c.x, c.in_count);
    take(file, "golden.dy", c.dy, c.out_count);
    net_case_run(device, net, &c, (hada_graph_options){0}, 0);
    expect(file, "golden.y", c.y, c.out_count, 2e-6);
    const hada_graph_options training = {
        .training = 1, .weight_gradients = 1, .input_gradient = 1, .recompute = recompute};
    net_case_run(device, net, &c, training, 0);
    expect(file, "golden.y_training", c.y, c.out_count, 5e-6);
    expect(file, "golden.dx", c.dx, c.in_count, 1e-5);
    double difference = 0, size = 0;
    for (int i = 0; i < net->parameter_count; i++) {
        const hada_parameter *p = &net->parameters[i];
        char key[160];
        snprintf(key, sizeof key, "golden.%s%s", p->trained ? "grad." : "", p->name);
        /* parts may be small differences of large numbers; the whole gradient is not */
        expect(file, key, (p->trained ? c.gradients : net->values) + p->offset, p->count, 1e-4);
        SCOPED_MEMORY double *want = golden(file, key, p->count);
        for (size_t k = 0; p->trained && k < p->count; k++) {
            difference += pow((double)c.gradients[p->offset + k] - want[k], 2);
            size += want[k] * want[k];
        }
    }
    assert_true(sqrt(difference / size) < 1e-5);
    net_case_free(&c);
    hada_tensors_close(&file);
}

TEST(a_net_shared_by_colours)
{
    check(*state, "shared", 0);
    check(*state, "shared", 1);
}

TEST(transposed_convolutions_at_odd_sizes)
{
    check(*state, "transposed", 0);
    check(*state, "transposed", 1);
}

TEST(strides_cubic_resizing_and_linear_layers)
{
    check(*state, "small", 0);
    check(*state, "small", 1);
}

/* The public way gives the same as the graph. */
TEST(a_runner_gives_the_same)
{
    net_device *device = *state;
    char path[512];
    SCOPED(hada_net) * net;
    hada_net_runner *runner;
    hada_tensors *file = open_golden("shared", path, sizeof path);
    ASSERT_OK(hada_net_load(&net, path, err));
    uint64_t stated;
    const uint64_t before = hada_context_bytes(device->context);
    ASSERT_OK(hada_net_bytes(device->context, net, 10, 13, &stated, err));
    ASSERT_OK(hada_net_runner_create(&runner, device->context, net, 10, 13, err));
    assert_int_equal(hada_context_bytes(device->context) - before, stated);
    SCOPED(hada_image) in, out = {0};
    ASSERT_OK(hada_image_create(&in, 3, 10, 13, err));
    SCOPED_MEMORY float *x = calloc(2 * hada_image_count(&in), sizeof *x),
                        *y = calloc(2 * hada_image_count(&in), sizeof *y);
    take(file, "golden.x", x, 2 * hada_image_count(&in));
    for (int i = 0; i < 2; i++) {
        memcpy(in.data, x + (size_t)i * hada_image_count(&in), hada_image_count(&in) * sizeof(float));
        ASSERT_OK(hada_net_run(runner, &in, &out, err));
        memcpy(y + (size_t)i * hada_image_count(&in), out.data, hada_image_count(&in) * sizeof(float));
    }
    expect(file, "golden.y", y, 2 * hada_image_count(&in), 2e-6);
    in.rows = 9;
    ASSERT_FAILS(hada_net_run(runner, &in, &out, err), HADA_ERROR_SIZE, "");
    hada_net_runner_destroy(&runner);
    hada_tensors_close(&file);
}

FIXTURE(net_device_open, net_device_close)
