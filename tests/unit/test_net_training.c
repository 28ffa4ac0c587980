/* Optimisers, norms, learning rates and first weights as training uses them. */
#include "net/layers.h"
#include "net/optimizer.h"
#include "net_fixture.h"
#include "netlist/net_list.h"
#include "train/trainer.h"

enum { COUNT = 5000 };

/* Arrays of parameters, gradients and state, and a rule. */
typedef struct trainee {
    hada_buffer parameters, gradients, state;
    hada_optimizer_desc desc;
} trainee;

static trainee begin(net_device *device, hada_optimizer optimizer)
{
    trainee t;
    hada_optimizer_desc_init(&t.desc, optimizer);
    const size_t state = hada_optimizer_state_floats(&t.desc, COUNT) * sizeof(float);
    SCOPED_MEMORY float *start = calloc(COUNT, sizeof *start);
    net_fill(start, COUNT, 1);
    ASSERT_OK(hada_buffer_create_from(&t.parameters, device->slot, start, COUNT * sizeof(float), "parameters", err));
    ASSERT_OK(hada_buffer_create(&t.gradients, device->context, COUNT * sizeof(float), "gradients", err));
    ASSERT_OK(hada_buffer_create(&t.state, device->context, state, "state", err));
    ASSERT_OK(hada_buffer_clear(&t.state, device->slot, 0, state, err));
    return t;
}

static void end(trainee *t)
{
    HADA_DESTROY_BUFFERS(&t->parameters, &t->gradients, &t->state);
}

static double read_back(net_device *device, const trainee *t, float *out)
{
    double norm = 0.0;
    ASSERT_OK(hada_buffer_read(&t->parameters, device->slot, 0, out, COUNT * sizeof(float), err));
    for (size_t i = 0; i < COUNT; i++)
        norm += (double)out[i] * out[i];
    return norm;
}

/* Steps first ... last with the gradient of |p|^2 / 2 plus noise of the step. */
static void steps(net_device *device, trainee *t, int first, int last)
{
    static float p[COUNT], noise[COUNT];
    for (int step = first; step <= last; step++) {
        read_back(device, t, p);
        net_fill(noise, COUNT, (uint64_t)step);
        for (size_t i = 0; i < COUNT; i++)
            p[i] += 0.01f * noise[i];
        ASSERT_OK(hada_buffer_write(&t->gradients, device->slot, 0, p, sizeof p, err));
        ASSERT_OK(hada_optimizer_step(device->slot, &t->desc, (uint64_t)step, 0.02, (hada_floats){t->gradients.mem, 0},
                                      (hada_floats){t->parameters.mem, 0}, (hada_floats){t->state.mem, 0}, COUNT, err));
    }
}

TEST(optimizers_go_down)
{
    net_device *device = *state;
    static float p[COUNT];
    for (int kind = HADA_OPTIMIZER_RMSPROP; kind <= HADA_OPTIMIZER_ADAM; kind++) {
        trainee t = begin(device, (hada_optimizer)kind);
        const double before = read_back(device, &t, p);
        steps(device, &t, 1, 60);
        assert_true(read_back(device, &t, p) < 0.5 * before);
        end(&t);
    }
}

/* Saved in the midst and gone on with elsewhere: the same bits. */
TEST(training_resumes)
{
    net_device *device = *state;
    static float straight[COUNT], resumed[COUNT];
    for (int kind = HADA_OPTIMIZER_RMSPROP; kind <= HADA_OPTIMIZER_ADAM; kind++) {
        trainee a = begin(device, (hada_optimizer)kind), b = begin(device, (hada_optimizer)kind);
        const size_t bytes = hada_optimizer_state_floats(&a.desc, COUNT) * sizeof(float);
        float *saved = malloc(bytes);
        steps(device, &a, 1, 4);
        read_back(device, &a, resumed);
        ASSERT_OK(hada_buffer_read(&a.state, device->slot, 0, saved, bytes, err));
        ASSERT_OK(hada_buffer_write(&b.parameters, device->slot, 0, resumed, sizeof resumed, err));
        ASSERT_OK(hada_buffer_write(&b.state, device->slot, 0, saved, bytes, err));
        steps(device, &a, 5, 8);
        steps(device, &b, 5, 8);
        read_back(device, &a, straight);
        read_back(device, &b, resumed);
        assert_memory_equal(straight, resumed, sizeof straight);
        free(saved);
        end(&a);
        end(&b);
    }
}

/* An array in two parts, at odd offsets, gives what it gives in one. */
TEST(arrays_may_be_split)
{
    net_device *device = *state;
    static float whole[COUNT], parts[COUNT];
    const size_t cut = 1237;
    trainee a = begin(device, HADA_OPTIMIZER_ADAM), b = begin(device, HADA_OPTIMIZER_ADAM);
    net_fill(parts, COUNT, 3);
    ASSERT_OK(hada_buffer_write(&a.gradients, device->slot, 0, parts, sizeof parts, err));
    ASSERT_OK(hada_buffer_write(&b.gradients, device->slot, 0, parts, sizeof parts, err));
    for (uint64_t step = 1; step <= 3; step++) {
        ASSERT_OK(hada_optimizer_step(device->slot, &a.desc, step, 0.1, (hada_floats){a.gradients.mem, 0},
                                      (hada_floats){a.parameters.mem, 0}, (hada_floats){a.state.mem, 0}, COUNT, err));
        ASSERT_OK(hada_optimizer_step(device->slot, &b.desc, step, 0.1, (hada_floats){b.gradients.mem, 0},
                                      (hada_floats){b.parameters.mem, 0}, (hada_floats){b.state.mem, 0}, cut, err));
        ASSERT_OK(hada_optimizer_step(device->slot, &b.desc, step, 0.1, (hada_floats){b.gradients.mem, cut},
                                      (hada_floats){b.parameters.mem, cut}, (hada_floats){b.state.mem, 2 * cut},
                                      COUNT - cut, err));
    }
    read_back(device, &a, whole);
    read_back(device, &b, parts);
    assert_memory_equal(whole, parts, sizeof whole);
    end(&a);
    end(&b);
}

TEST(no_gradient_is_no_trouble)
{
    net_device *device = *state;
    static float p[COUNT], after[COUNT];
    float squares;
    for (int kind = HADA_OPTIMIZER_RMSPROP; kind <= HADA_OPTIMIZER_ADAM; kind++) {
        trainee t = begin(device, (hada_optimizer)kind);
        const hada_gradient_part part = {{t.gradients.mem, 0}, COUNT};
        hada_buffer scratch;
        ASSERT_OK(
            hada_buffer_create(&scratch, device->context, hada_squares_scratch(&part, 1) + sizeof squares, "", err));
        ASSERT_OK(hada_buffer_clear(&t.gradients, device->slot, 0, COUNT * sizeof(float), err));
        const hada_floats to = {scratch.mem, hada_squares_scratch(&part, 1) / sizeof(float)};
        ASSERT_OK(hada_gradient_squares(device->slot, &part, 1, to, scratch.mem, err));
        ASSERT_OK(hada_buffer_read(&scratch, device->slot, to.offset * sizeof(float), &squares, sizeof squares, err));
        assert_true(squares == 0.0f);
        read_back(device, &t, p);
        ASSERT_OK(hada_optimizer_step(device->slot, &t.desc, 1, 0.1, part.values, (hada_floats){t.parameters.mem, 0},
                                      (hada_floats){t.state.mem, 0}, COUNT, err));
        read_back(device, &t, after);
        assert_memory_equal(p, after, sizeof p);
        hada_buffer_destroy(&scratch);
        end(&t);
    }
}

/* Cross-entropy of `count` logits against a label, and its gradient. */
static float cross_entropy(const float *x, int count, float label, float *dx)
{
    float sum = 0.0f;
    for (int i = 0; i < count; i++) {
        sum += fmaxf(x[i], 0.0f) - x[i] * label + log1pf(expf(-fabsf(x[i])));
        dx[i] = (1.0f / (1.0f + expf(-x[i])) - label) / (float)count;
    }
    return sum / (float)count;
}

/* A layer learns to tell two heaps of points apart: linear layer, cross-entropy, RMSprop. */
TEST(a_layer_learns)
{
    net_device *device = *state;
    enum { IMAGES = 32, IN = 5, FLOATS = 4096, W = 0, BIAS = 16, X = 32, Y = 512, DY = 576, DW = 640, S = 800 };
    static float all[FLOATS];
    hada_slot *slot = device->slot;
    SCOPED(hada_buffer) memory;
    net_fill(all + X, 2 * IMAGES * IN, 1);
    for (int i = 0; i < 2 * IMAGES * IN; i++)
        all[X + i] += i < IMAGES * IN ? 0.7f : -0.7f;
    ASSERT_OK(hada_buffer_create_from(&memory, slot, all, sizeof all, "everything", err));
    const cl_mem mem = memory.mem;
#define AT(place) ((hada_floats){mem, (place)})
    const hada_linear shape = {2 * IMAGES, IN, 1};
    hada_optimizer_desc desc;
    hada_optimizer_desc_init(&desc, HADA_OPTIMIZER_RMSPROP);
    float first[2], last[2], y[2 * IMAGES], dy[2 * IMAGES];
    for (uint64_t step = 1; step <= 100; step++) {
        float *value = step == 1 ? first : last;
        ASSERT_OK(hada_linear_forward(slot, &shape, AT(W), AT(BIAS), AT(X), AT(Y), err));
        ASSERT_OK(hada_buffer_read(&memory, slot, Y * sizeof(float), y, sizeof y, err));
        value[0] = cross_entropy(y, IMAGES, 1.0f, dy);
        value[1] = cross_entropy(y + IMAGES, IMAGES, 0.0f, dy + IMAGES);
        ASSERT_OK(hada_buffer_write(&memory, slot, DY * sizeof(float), dy, sizeof dy, err));
        ASSERT_OK(hada_linear_backward_weights(slot, &shape, AT(X), AT(DY), AT(DW), AT(DW + BIAS), 0, err));
        ASSERT_OK(hada_optimizer_step(slot, &desc, step, 0.02, AT(DW), AT(W), AT(S), 17, err));
    }
    assert_true(fabsf(first[0] - 0.693147f) < 1e-5f && fabsf(first[1] - 0.693147f) < 1e-5f);
    assert_true(last[0] < 0.25f && last[1] < 0.25f);
}

/* Bits that every machine must give; an implementation of the generators in Python gave the same. Kaiming's for a
 * convolution with a ReLU, PyTorch's for one without; the fan is 27. */
TEST(first_weights_are_the_same_everywhere)
{
    static const uint32_t normal[4] = {0x3e175fde, 0x3e823bc2, 0xbeb3be75, 0x3ee399dd};
    static const uint32_t uniform[4] = {0x3d93e019, 0x3dfe722f, 0xbd256e65, 0x3d517a3e};
    for (int relu = 0; relu < 2; relu++) {
        SCOPED(hada_net) * net;
        char text[256];
        snprintf(text, sizeof text,
                 "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 3}, {\"layer\": "
                 "\"conv\", \"name\": \"conv\", \"channels\": 16, \"activation\": \"%s\"}]}",
                 relu ? "relu" : "none");
        ASSERT_OK(hada_net_create(&net, text, 2022, err));
        assert_memory_equal(net->values + hada_net_find(net, "conv.weight")->offset, relu ? normal : uniform,
                            sizeof normal);
        assert_true(net->values[hada_net_find(net, "conv.bias")->offset] == 0.0f);
    }
}

TEST(rates)
{
    hada_train_options options = {.schedule = HADA_RATE_CONSTANT, .steps = 14, .warmup = 4, .last_rate = 0.25};
    assert_true(hada_train_rate(&options, 0) == 0.1 && hada_train_rate(&options, 2) == 0.55);
    assert_true(hada_train_rate(&options, 4) == 1.0 && hada_train_rate(&options, UINT64_MAX) == 1.0);
    options.schedule = HADA_RATE_COSINE;
    assert_true(hada_train_rate(&options, 4) == 1.0 && hada_train_rate(&options, 14) == 0.25);
    assert_true(hada_train_rate(&options, 15) == 0.25);
    assert_true(fabs(hada_train_rate(&options, 9) - 0.625) < 1e-12);
}

FIXTURE(net_device_open, net_device_close)
