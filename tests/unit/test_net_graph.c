/* Whole nets on the device: against the reference in double precision, its differences, and themselves. */
#include "net_fixture.h"
#include "ref/ref_net.h"

/* Every kind of layer; branches that meet, values taken several times, channels that are no multiple of a block. */
static const char *const lists[] = {
    "{\"format\":\"hadalens-net-1\",\"layers\":["
    "{\"layer\":\"input\",\"channels\":3},"
    "{\"layer\":\"conv\",\"name\":\"a\",\"channels\":10,\"activation\":\"relu\"},"
    "{\"layer\":\"conv\",\"name\":\"b\",\"channels\":6},"
    "{\"layer\":\"activation\",\"activation\":\"leaky_relu\",\"slope\":0.1},"
    "{\"layer\":\"pool\"},"
    "{\"layer\":\"conv\",\"name\":\"c\",\"channels\":12,\"kernel\":5,\"pad\":2,\"activation\":\"sigmoid\"},"
    "{\"layer\":\"resize\",\"resize\":\"cubic\",\"like\":1},"
    "{\"layer\":\"concat\",\"from\":[1,6,3]},"
    "{\"layer\":\"norm\",\"name\":\"n\"},"
    "{\"layer\":\"activation\",\"activation\":\"relu\"},"
    "{\"layer\":\"conv\",\"name\":\"d\",\"channels\":2,\"kernel\":1,\"pad\":0}]}",

    "{\"format\":\"hadalens-net-1\",\"layers\":["
    "{\"layer\":\"input\",\"channels\":2},"
    "{\"layer\":\"resize\",\"resize\":\"linear_aligned\",\"rows\":12,\"cols\":10},"
    "{\"layer\":\"conv\",\"name\":\"a\",\"channels\":8,\"stride\":2,\"activation\":\"leaky_relu\",\"slope\":0.2},"
    "{\"layer\":\"pool\",\"pool\":\"mean\",\"kernel\":2,\"stride\":1},"
    "{\"layer\":\"linear\",\"name\":\"f\",\"in\":160,\"channels\":7,\"activation\":\"leaky_relu\",\"slope\":0.2},"
    "{\"layer\":\"linear\",\"name\":\"g\",\"in\":7,\"channels\":1,\"bias\":false}]}",

    "{\"format\":\"hadalens-net-1\",\"colours\":3,\"layers\":["
    "{\"layer\":\"input\",\"channels\":1},"
    "{\"layer\":\"conv\",\"name\":\"a\",\"channels\":16,\"activation\":\"relu\"},"
    "{\"layer\":\"pool\"},"
    "{\"layer\":\"conv\",\"name\":\"b\",\"channels\":16,\"activation\":\"relu\"},"
    "{\"layer\":\"conv\",\"name\":\"up\",\"channels\":16,\"kernel\":2,\"stride\":2,\"pad\":0,\"transposed\":true},"
    "{\"layer\":\"concat\",\"from\":[1,4]},"
    "{\"layer\":\"conv\",\"name\":\"c\",\"channels\":9,\"activation\":\"relu\"},"
    "{\"layer\":\"norm\",\"name\":\"n\"},"
    "{\"layer\":\"conv\",\"name\":\"d\",\"channels\":1}]}",
};
enum { LISTS = sizeof lists / sizeof *lists };

static hada_net *net_of(const char *description)
{
    hada_net *net;
    ASSERT_OK(hada_net_create(&net, description, 3, err));
    hada_random random;
    hada_random_seed(&random, 4, 0);
    for (int i = 0; i < net->parameter_count; i++) /* biases and statistics that are not 0 and 1 */
        for (size_t k = 0; net->parameters[i].dims == 1 && k < net->parameters[i].count; k++)
            net->values[net->parameters[i].offset + k] += (float)hada_random_range(&random, -0.2, 0.2);
    return net;
}

static const hada_graph_options with_gradients = {.training = 1, .weight_gradients = 1, .input_gradient = 1};

TEST(outputs_follow_the_reference)
{
    for (int i = 0; i < LISTS; i++)
        for (int training = 0; training < 2; training++) {
            SCOPED(hada_net) *net = net_of(lists[i]);
            net_case c = net_case_make(net, 2, 14 + i, 11);
            SCOPED_MEMORY double *values = doubles(net->values, net->floats), *x = doubles(c.x, c.in_count);
            SCOPED_MEMORY double *y = calloc(c.out_count, sizeof *y);
            ASSERT_OK(hada_ref_net_forward(net, values, training, c.images, c.rows, c.cols, x, y, err));
            net_case_run(*state, net, &c, training ? with_gradients : (hada_graph_options){0}, 0);
            assert_true(relative_error(c.y, y, c.out_count) < 2e-6);
            net_case_free(&c);
        }
}

/* sum dy y, whose gradient backward gives. */
static double loss_of(const hada_net *net, const net_case *c, const double *values, const double *x, double *y)
{
    double sum = 0;
    ASSERT_OK(hada_ref_net_forward(net, values, 1, c->images, c->rows, c->cols, x, y, err));
    for (size_t i = 0; i < c->out_count; i++)
        sum += (double)c->dy[i] * y[i];
    return sum;
}

/* Compares `probes` places of a gradient with central differences of the reference. */
static void check_differences(const hada_net *net, const net_case *c, double *values, double *x, double *moved,
                              size_t count, const float *gradient, int probes)
{
    const double h = 1e-6;
    double difference = 0, size = 0, *y = calloc(c->out_count, sizeof *y);
    hada_random random;
    hada_random_seed(&random, 8, count);
    for (int i = 0; i < probes; i++) {
        const size_t at = (size_t)hada_random_below(&random, (uint32_t)count);
        const double value = moved[at];
        moved[at] = value + h;
        const double above = loss_of(net, c, values, x, y);
        moved[at] = value - h;
        const double below = loss_of(net, c, values, x, y);
        moved[at] = value;
        const double slope = (above - below) / (2 * h);
        difference += (slope - (double)gradient[at]) * (slope - (double)gradient[at]);
        size += slope * slope;
    }
    free(y);
    assert_true(size > 0);
    assert_true(sqrt(difference / size) < 1e-3);
}

TEST(gradients_follow_differences_of_the_reference)
{
    for (int i = 0; i < LISTS; i++) {
        SCOPED(hada_net) *net = net_of(lists[i]);
        net_case c = net_case_make(net, 2, 12, 9 + i);
        SCOPED_MEMORY double *values = doubles(net->values, net->floats), *x = doubles(c.x, c.in_count);
        net_case_run(*state, net, &c, with_gradients, 0);
        check_differences(net, &c, values, x, values, net->trained, c.gradients, 40);
        check_differences(net, &c, values, x, x, c.in_count, c.dx, 20);
        net_case_free(&c);
    }
}

/* One training step, twice and with recomputation: the same bits, less memory. */
TEST(steps_repeat_bit_for_bit)
{
    DEFAULTS(hada_unet_options, unet);
    unet.down = "16,16,16,16|32,32,32,32";
    unet.up = "16,16,16,16";
    unet.last_norm = 1;
    hada_net *nets[3];
    net_case cases[3];
    for (int i = 0; i < 3; i++) {
        hada_graph_options options = with_gradients;
        options.recompute = i == 2;
        ASSERT_OK(hada_net_create_unet(&nets[i], &unet, 1, err));
        cases[i] = net_case_make(nets[i], 2, 40, 33);
        net_case_run(*state, nets[i], &cases[i], options, 0);
    }
    for (int i = 1; i < 3; i++) {
        assert_memory_equal(cases[0].y, cases[i].y, cases[0].out_count * sizeof(float));
        assert_memory_equal(cases[0].dx, cases[i].dx, cases[0].in_count * sizeof(float));
        assert_memory_equal(cases[0].gradients, cases[i].gradients, nets[0]->trained * sizeof(float));
        assert_memory_equal(nets[0]->values, nets[i]->values, nets[0]->floats * sizeof(float));
    }
    assert_int_equal(cases[0].bytes, cases[1].bytes);
    assert_true(cases[2].bytes < cases[0].bytes);
    for (int i = 0; i < 3; i++) {
        net_case_free(&cases[i]);
        hada_net_destroy(&nets[i]);
    }
}

TEST(an_image_does_not_depend_on_its_batch)
{
    SCOPED(hada_net) * net;
    ASSERT_OK(hada_net_create_preset(&net, "compact", 3, 1, err));
    net_case both = net_case_make(net, 2, 32, 48), one = net_case_make(net, 1, 32, 48);
    memcpy(one.x, both.x + one.in_count, one.in_count * sizeof(float));
    net_case_run(*state, net, &both, (hada_graph_options){0}, 0);
    net_case_run(*state, net, &one, (hada_graph_options){0}, 0);
    assert_memory_equal(one.y, both.y + one.out_count, one.out_count * sizeof(float));
    net_case_free(&both);
    net_case_free(&one);
}

/* Bytes are stated before anything is allocated, and activations share them. */
TEST(memory_is_stated_and_shared)
{
    net_device *device = *state;
    SCOPED(hada_net) * net;
    hada_graph *graph;
    ASSERT_OK(hada_net_create_preset(&net, "compact", 3, 1, err));
    const struct {
        hada_graph_options options;
    } cases[] = {{{.images = 1, .rows = 256, .cols = 256, .method = HADA_CONV_DIRECT}},
                 {{.images = 2, .rows = 75, .cols = 61, .training = 1, .weight_gradients = 1}},
                 {{.images = 2, .rows = 75, .cols = 61, .training = 1, .weight_gradients = 1, .recompute = 1}}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        size_t stated;
        const uint64_t before = hada_context_bytes(device->context);
        ASSERT_OK(hada_graph_bytes(device->context, net, &cases[i].options, &stated, err));
        ASSERT_OK(hada_graph_create(&graph, device->slot, net, &cases[i].options, err));
        assert_int_equal(hada_context_bytes(device->context) - before, stated);
        hada_graph_destroy(&graph);
        /* the top level: the skip and what comes from below (48 channels), one more of 16, the input; the rest of the
         * net fits beside */
        if (!i)
            assert_true(stated < (size_t)258 * 258 * (48 + 16 + 16 + 16) * 4 + 20000000);
    }
}

static const char *const dropping = "{\"format\":\"hadalens-net-1\",\"layers\":["
                                    "{\"layer\":\"input\",\"channels\":4},"
                                    "{\"layer\":\"dropout\",\"p\":0.5},"
                                    "{\"layer\":\"dropout\",\"p\":0.25}]}";

TEST(dropout_draws_by_step_and_layer)
{
    SCOPED(hada_net) *net = net_of(dropping);
    net_case first = net_case_make(net, 1, 32, 32), again = net_case_make(net, 1, 32, 32);
    net_case other = net_case_make(net, 1, 32, 32), calm = net_case_make(net, 1, 32, 32);
    const hada_graph_options options = {.training = 1, .input_gradient = 1};
    for (size_t i = 0; i < first.in_count; i++)
        first.x[i] = again.x[i] = other.x[i] = calm.x[i] = 3.0f;
    memcpy(first.dy, first.x, first.in_count * sizeof(float)); /* so that backward gives what forward gave */
    net_case_run(*state, net, &first, options, 1);
    net_case_run(*state, net, &again, options, 1);
    net_case_run(*state, net, &other, options, 2);
    net_case_run(*state, net, &calm, (hada_graph_options){0}, 1);
    size_t kept = 0;
    for (size_t i = 0; i < first.in_count; i++) {
        kept += first.y[i] != 0;
        assert_true(first.y[i] == 0 || fabsf(first.y[i] - 8.0f) < 1e-5f);
        assert_true(calm.y[i] == 3.0f);
    }
    /* 3/8 of 4096 are 1536, their deviation is 31: layers that drew alike would keep 2048 or 3072 */
    assert_in_range(kept, 1536 - 155, 1536 + 155);
    assert_memory_equal(first.y, again.y, first.in_count * sizeof(float));
    assert_memory_equal(first.y, first.dx, first.in_count * sizeof(float));
    assert_memory_not_equal(first.y, other.y, first.in_count * sizeof(float));
    net_case_free(&first);
    net_case_free(&again);
    net_case_free(&other);
    net_case_free(&calm);
}

TEST(wrong_use_is_refused)
{
    net_device *device = *state;
    SCOPED(hada_graph) * graph;
    SCOPED(hada_net) *net = net_of(lists[0]);
    hada_graph_options options = {.images = 65537, .rows = 8, .cols = 8};
    ASSERT_FAILS(hada_graph_create(&graph, device->slot, net, &options, err), HADA_ERROR_ARGUMENT, "");
    options.images = 1;
    options.cols = 1;
    ASSERT_FAILS(hada_graph_create(&graph, device->slot, net, &options, err), HADA_ERROR_SIZE, "");
    assert_null(graph);
}

FIXTURE(net_device_open, net_device_close)
