/* The references of layers, losses and optimisers against PyTorch (tests/golden/make_layers.py), in double precision.
 */
#include "io/safetensors.h"
#include "ref/ref_layers.h"
#include "ref/ref_loss.h"
#include "ref/ref_optimizer.h"
#include "testing.h"
#include "train/trainer.h"

static hada_tensors *file;

static int open_file(void **state)
{
    (void)state;
    return (int)hada_tensors_open(&file, HADALENS_SOURCE_DIR "/tests/golden/layers.safetensors", NULL);
}

static int close_file(void **state)
{
    (void)state;
    hada_tensors_close(&file);
    return 0;
}

/* The values of CASE.NAME, to be freed, and how many. */
static double *golden(const char *name, const char *part, size_t *count)
{
    char full[128];
    snprintf(full, sizeof full, "%s.%s", name, part);
    const hada_stored_tensor *tensor = hada_tensors_find(file, full);
    if (!tensor)
        fail_msg("there is no %s in the golden file", full);
    assert_int_equal(tensor->type, HADA_F64);
    double *values = malloc(tensor->bytes ? tensor->bytes : 1);
    memcpy(values, tensor->data, tensor->bytes);
    if (count)
        *count = tensor->bytes / sizeof *values;
    return values;
}

static hada_ref_shape golden_shape(const char *name, const char *part)
{
    char full[128];
    snprintf(full, sizeof full, "%s.%s", name, part);
    const hada_stored_tensor *tensor = hada_tensors_find(file, full);
    assert_non_null(tensor);
    assert_int_equal(tensor->dims, 4);
    const int64_t *s = tensor->shape;
    return (hada_ref_shape){(int)s[0], (int)s[1], (int)s[2], (int)s[3]};
}

/* Fails where `values` differ from the golden ones by more than rounding. */
static void same(const char *name, const char *part, const double *values)
{
    size_t count;
    SCOPED_MEMORY double *expected = golden(name, part, &count);
    for (size_t i = 0; i < count; i++)
        if (!(fabs(values[i] - expected[i]) <= 1e-11 * (1.0 + fabs(expected[i]))))
            fail_msg("%s.%s: value %zu is %.15g, PyTorch has %.15g", name, part, i, values[i], expected[i]);
}

/* A layer's golden x and dy, and room for y and dx. */
typedef struct layer {
    hada_ref_shape in, out;
    size_t in_count, out_count;
    double *x, *dy, *y, *dx;
} layer;

static layer begin(const char *name)
{
    layer l = {.in = golden_shape(name, "x"), .out = golden_shape(name, "y")};
    l.x = golden(name, "x", &l.in_count);
    l.dy = golden(name, "dy", &l.out_count);
    l.y = calloc(l.out_count, sizeof *l.y);
    l.dx = calloc(l.in_count, sizeof *l.dx);
    assert_non_null(l.y);
    assert_non_null(l.dx);
    return l;
}

static void end(const char *name, layer *l)
{
    same(name, "y", l->y);
    same(name, "dx", l->dx);
    HADA_FREE(l->x, l->dy, l->y, l->dx);
}

TEST(activations)
{
    layer l = begin("relu");
    hada_ref_leaky(l.in_count, 0.0, l.x, l.y);
    hada_ref_leaky_backward(l.in_count, 0.0, l.y, l.dy, l.dx);
    end("relu", &l);
    l = begin("leaky");
    hada_ref_leaky(l.in_count, 0.2, l.x, l.y);
    hada_ref_leaky_backward(l.in_count, 0.2, l.y, l.dy, l.dx);
    end("leaky", &l);
    l = begin("sigmoid");
    hada_ref_sigmoid(l.in_count, l.x, l.y);
    hada_ref_sigmoid_backward(l.in_count, l.y, l.dy, l.dx);
    end("sigmoid", &l);
}

TEST(pooling)
{
    static const int windows[][2] = {{2, 2}, {3, 2}, {3, 1}, {2, 3}};
    for (int mean = 0; mean < 2; mean++)
        for (size_t i = 0; i < HADA_COUNT(windows); i++) {
            const int size = windows[i][0], stride = windows[i][1];
            char name[32];
            snprintf(name, sizeof name, "%s_pool_%d_%d", mean ? "mean" : "max", size, stride);
            layer l = begin(name);
            const hada_ref_shape out = hada_ref_pool_shape(&l.in, size, stride);
            assert_memory_equal(&out, &l.out, sizeof out);
            hada_ref_pool(&l.in, mean, size, stride, l.x, l.y);
            hada_ref_pool_backward(&l.in, mean, size, stride, l.x, l.dy, l.dx);
            end(name, &l);
        }
}

TEST(resizing)
{
    static const struct {
        const char *name;
        int taps, aligned;
    } ways[] = {{"nearest", 1, 0}, {"linear", 2, 0}, {"linear", 2, 1}, {"cubic", 4, 0}, {"cubic", 4, 1}};
    static const int sizes[][4] = {{5, 7, 13, 16}, {9, 8, 4, 5}, {4, 5, 8, 10}, {1, 3, 2, 1}};
    for (size_t w = 0; w < HADA_COUNT(ways); w++)
        for (size_t i = 0; i < HADA_COUNT(sizes); i++) {
            const int *s = sizes[i], taps = ways[w].taps, aligned = ways[w].aligned;
            char name[64];
            snprintf(name, sizeof name, "%s_%d_%d_%d_%d_%d", ways[w].name, aligned, s[0], s[1], s[2], s[3]);
            layer l = begin(name);
            hada_ref_resize(&l.in, l.out.rows, l.out.cols, taps, aligned, l.x, l.y);
            hada_ref_resize_backward(&l.in, l.out.rows, l.out.cols, taps, aligned, l.dy, l.dx);
            end(name, &l);
        }
}

TEST(placing)
{
    layer l = begin("place");
    hada_ref_place(&l.in, &l.out, 1, -2, 2, l.x, l.y);
    hada_ref_place_backward(&l.in, &l.out, 1, -2, 2, l.dy, l.dx);
    end("place", &l);
}

TEST(batch_norm)
{
    layer l = begin("norm");
    SCOPED_MEMORY double *weight = golden("norm", "weight", NULL), *bias = golden("norm", "bias", NULL);
    SCOPED_MEMORY double *mean = golden("norm", "mean", NULL), *variance = golden("norm", "variance", NULL);
    double batch_mean[3], batch_variance[3], dweight[3] = {0}, dbias[3] = {0};
    hada_ref_batch_norm(&l.in, weight, bias, mean, variance, 1e-3, l.x, l.y);
    same("norm", "infer", l.y);
    hada_ref_batch_statistics(&l.in, l.x, batch_mean, batch_variance);
    hada_ref_batch_norm(&l.in, weight, bias, batch_mean, batch_variance, 1e-3, l.x, l.y);
    ASSERT_OK(hada_ref_batch_norm_backward(&l.in, weight, 1e-3, l.x, l.dy, l.dx, dweight, dbias, err));
    same("norm", "dweight", dweight);
    same("norm", "dbias", dbias);
    /* the running values take the unbiased variance: 2 x 4 x 5 values */
    for (int c = 0; c < 3; c++) {
        mean[c] += 0.25 * (batch_mean[c] - mean[c]);
        variance[c] += 0.25 * (batch_variance[c] * 40.0 / 39.0 - variance[c]);
    }
    same("norm", "mean_after", mean);
    same("norm", "variance_after", variance);
    end("norm", &l);
}

TEST(linear)
{
    SCOPED_MEMORY double *x = golden("linear", "x", NULL), *w = golden("linear", "weight", NULL),
                         *b = golden("linear", "bias", NULL);
    SCOPED_MEMORY double *dy = golden("linear", "dy", NULL);
    double y[12], dx[21] = {0}, dw[28] = {0}, db[4] = {0};
    hada_ref_linear(3, 7, 4, w, b, x, y);
    hada_ref_linear_backward(3, 7, 4, w, x, dy, dx, dw, db);
    same("linear", "y", y);
    same("linear", "dx", dx);
    same("linear", "dweight", dw);
    same("linear", "dbias", db);
}

static double loss_of(const char *name, const hada_ref_shape *shape, const double *x, const double *t, double *dx)
{
    const size_t count = hada_ref_values(shape);
    if (!strcmp(name, "mse"))
        return hada_ref_mse(count, 1.5, x, t, dx);
    if (!strcmp(name, "l1"))
        return hada_ref_l1(count, 1.5, x, t, dx);
    if (!strcmp(name, "logits"))
        return hada_ref_logits(count, 1.5, x, t, dx);
    return hada_ref_variation(shape, !strcmp(name, "tv_squared"), 1.5, x, dx);
}

TEST(losses)
{
    static const char *const names[] = {"mse", "l1", "logits", "tv", "tv_squared"};
    for (size_t i = 0; i < HADA_COUNT(names); i++) {
        const hada_ref_shape shape = golden_shape(names[i], "x");
        SCOPED_MEMORY double *x = golden(names[i], "x", NULL), *t = golden(names[i], "t", NULL);
        SCOPED_MEMORY double *dx = calloc(hada_ref_values(&shape), sizeof *dx);
        const double value = loss_of(names[i], &shape, x, t, dx), alone = loss_of(names[i], &shape, x, t, NULL);
        same(names[i], "value", &value);
        same(names[i], "value", &alone);
        same(names[i], "dx", dx);
    }
}

enum { PARAMETERS = 6, STEPS = 4 };

TEST(adam)
{
    double *p = golden("adam", "p", NULL), *g = golden("adam", "g", NULL), m[PARAMETERS] = {0}, v[PARAMETERS] = {0};
    double after[STEPS * PARAMETERS];
    for (int t = 1; t <= STEPS; t++) {
        const hada_ref_adam rule = {.rate = 0.01 / t, .beta1 = 0.9, .beta2 = 0.999, .eps = 1e-8};
        hada_ref_adam_step(&rule, t, PARAMETERS, g + (t - 1) * PARAMETERS, p, m, v);
        memcpy(after + (t - 1) * PARAMETERS, p, sizeof v);
    }
    same("adam", "after", after);
    HADA_FREE(p, g);
}

/* Keras's RMSprop by hand: v = 0.9 * 0 + 0.1 * 4 = 0.4, then 0.36 + 0.1 * 1 = 0.46. */
TEST(keras)
{
    const hada_ref_rmsprop rule = {.rate = 0.5, .decay = 0.9, .eps = 0.09};
    double p = 1.0, v = 0.0, g = 2.0;
    hada_ref_rmsprop_step(&rule, 1, &g, &p, &v);
    const double first = 0.5 * 2.0 / sqrt(0.49);
    assert_true(fabs(p - (1.0 - first)) < 1e-15);
    g = -1.0;
    hada_ref_rmsprop_step(&rule, 1, &g, &p, &v);
    assert_true(fabs(p - (1.0 - first + 0.5 / sqrt(0.46 + 0.09))) < 1e-15);
    assert_true(fabs(v - 0.46) < 1e-15);
}

TEST(cosine_rates)
{
    const hada_train_options options = {.schedule = HADA_RATE_COSINE, .steps = 12, .last_rate = 0.1};
    double values[12];
    for (uint64_t step = 0; step < 12; step++)
        values[step] = 0.1 * hada_train_rate(&options, step);
    same("cosine", "rates", values);
}

FIXTURE(open_file, close_file)
