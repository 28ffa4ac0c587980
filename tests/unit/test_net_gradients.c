/* Every gradient of the references of layers and losses against central differences of their forward direction: for a
 * random c, the slope of sum(c * y) along each value of x must be what backward gives for dy = c. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/random.h"
#include "ref/ref_layers.h"
#include "ref/ref_loss.h"
#include "runtime/slot.h"
#include "testing.h"

#define STEP 1e-5
/* Central differences err by STEP^2 times a third derivative, some 1e-10, and by rounding over STEP, some 1e-10. */
#define TOLERANCE 1e-7

enum { MOST = 2048 };

/* A function of `inputs` values with `outputs` values, and its gradient (added to dx). */
typedef struct function {
    const char *name;
    size_t inputs, outputs;
    void (*forward)(const void *own, const double *x, double *y);
    void (*backward)(const void *own, const double *x, const double *dy, double *dx);
    const void *own;
} function;

static double slope(const function *f, double *x, size_t i, const double *c)
{
    static double low[MOST], high[MOST];
    const double was = x[i];
    x[i] = was - STEP;
    f->forward(f->own, x, low);
    x[i] = was + STEP;
    f->forward(f->own, x, high);
    x[i] = was;
    double sum = 0.0;
    for (size_t k = 0; k < f->outputs; k++)
        sum += c[k] * (high[k] - low[k]);
    return sum / (2.0 * STEP);
}

static void hold(const function *f)
{
    static double x[MOST], c[MOST], dx[MOST];
    hada_random random;
    hada_random_seed(&random, 7, 0);
    assert_true(f->inputs <= MOST && f->outputs <= MOST);
    for (size_t i = 0; i < f->inputs; i++) {
        x[i] = hada_random_normal(&random);
        dx[i] = 0.0;
    }
    for (size_t i = 0; i < f->outputs; i++)
        c[i] = hada_random_normal(&random);
    f->backward(f->own, x, c, dx);
    double difference = 0.0, norm = 0.0;
    for (size_t i = 0; i < f->inputs; i++) {
        const double d = dx[i] - slope(f, x, i, c);
        difference += d * d;
        norm += dx[i] * dx[i];
    }
    assert_true(norm > 0.0);
    if (!(sqrt(difference / norm) <= TOLERANCE))
        fail_msg("%s: the gradient is off by %g", f->name, sqrt(difference / norm));
}

static const hada_ref_shape small = {2, 3, 7, 9};
enum { SMALL = 2 * 3 * 7 * 9 };

static void leaky_forward(const void *own, const double *x, double *y)
{
    hada_ref_leaky(SMALL, *(const double *)own, x, y);
}

static void leaky_backward(const void *own, const double *x, const double *dy, double *dx)
{
    double y[SMALL];
    hada_ref_leaky(SMALL, *(const double *)own, x, y);
    hada_ref_leaky_backward(SMALL, *(const double *)own, y, dy, dx);
}

static void sigmoid_forward(const void *own, const double *x, double *y)
{
    (void)own;
    hada_ref_sigmoid(SMALL, x, y);
}

static void sigmoid_backward(const void *own, const double *x, const double *dy, double *dx)
{
    double y[SMALL];
    sigmoid_forward(own, x, y);
    hada_ref_sigmoid_backward(SMALL, y, dy, dx);
}

TEST(activations)
{
    static const double slopes[] = {0.0, 0.2, 1.0};
    for (size_t i = 0; i < HADA_COUNT(slopes); i++)
        hold(&(function){"leaky", SMALL, SMALL, leaky_forward, leaky_backward, &slopes[i]});
    hold(&(function){"sigmoid", SMALL, SMALL, sigmoid_forward, sigmoid_backward, NULL});
}

typedef struct window {
    int mean, size, stride;
} window;

static void pool_forward(const void *own, const double *x, double *y)
{
    const window *w = own;
    hada_ref_pool(&small, w->mean, w->size, w->stride, x, y);
}

static void pool_backward(const void *own, const double *x, const double *dy, double *dx)
{
    const window *w = own;
    hada_ref_pool_backward(&small, w->mean, w->size, w->stride, x, dy, dx);
}

TEST(pooling)
{
    static const window windows[] = {{0, 2, 2}, {0, 3, 2}, {0, 3, 1}, {0, 2, 3}, {1, 2, 2}, {1, 3, 2}, {1, 3, 1}};
    for (size_t i = 0; i < HADA_COUNT(windows); i++) {
        const hada_ref_shape out = hada_ref_pool_shape(&small, windows[i].size, windows[i].stride);
        hold(&(function){"pool", SMALL, hada_ref_values(&out), pool_forward, pool_backward, &windows[i]});
    }
}

typedef struct resize {
    int rows, cols, taps, aligned;
} resize;

static void resize_forward(const void *own, const double *x, double *y)
{
    const resize *r = own;
    hada_ref_resize(&small, r->rows, r->cols, r->taps, r->aligned, x, y);
}

static void resize_backward(const void *own, const double *x, const double *dy, double *dx)
{
    const resize *r = own;
    (void)x;
    hada_ref_resize_backward(&small, r->rows, r->cols, r->taps, r->aligned, dy, dx);
}

TEST(resizing)
{
    static const int sizes[][2] = {{14, 18}, {3, 4}, {11, 5}, {1, 1}}, taps[] = {1, 2, 4};
    for (size_t i = 0; i < HADA_COUNT(sizes); i++)
        for (size_t k = 0; k < HADA_COUNT(taps); k++)
            for (int aligned = 0; aligned < 2; aligned++) {
                const resize r = {sizes[i][0], sizes[i][1], taps[k], aligned};
                hold(&(function){"resize", SMALL, (size_t)(6 * r.rows * r.cols), resize_forward, resize_backward, &r});
            }
}

static const hada_ref_shape whole = {2, 8, 6, 12};

static void place_forward(const void *own, const double *x, double *y)
{
    (void)own;
    memset(y, 0, hada_ref_values(&whole) * sizeof *y);
    hada_ref_place(&small, &whole, -2, 4, 3, x, y);
}

static void place_backward(const void *own, const double *x, const double *dy, double *dx)
{
    (void)own;
    (void)x;
    hada_ref_place_backward(&small, &whole, -2, 4, 3, dy, dx);
}

TEST(placing)
{
    hold(&(function){"place", SMALL, hada_ref_values(&whole), place_forward, place_backward, NULL});
}

/* Batch normalisation as a function of x, then weight, then bias. */
#define EPS 1e-3

static void norm_forward(const void *own, const double *x, double *y)
{
    double mean[3], variance[3];
    (void)own;
    hada_ref_batch_statistics(&small, x, mean, variance);
    hada_ref_batch_norm(&small, x + SMALL, x + SMALL + 3, mean, variance, EPS, x, y);
}

static void norm_backward(const void *own, const double *x, const double *dy, double *dx)
{
    (void)own;
    ASSERT_OK(hada_ref_batch_norm_backward(&small, x + SMALL, EPS, x, dy, dx, dx + SMALL, dx + SMALL + 3, err));
}

TEST(batch_norm)
{
    hold(&(function){"batch norm", SMALL + 6, SMALL, norm_forward, norm_backward, NULL});
}

/* Dropout is linear, and its own gradient. */
static void dropout_forward(const void *own, const double *x, double *y)
{
    (void)own;
    hada_ref_dropout(&small, 0.3, 5, 9, x, y);
}

static void dropout_backward(const void *own, const double *x, const double *dy, double *dx)
{
    (void)x;
    dropout_forward(own, dy, dx);
}

TEST(dropout)
{
    hold(&(function){"dropout", SMALL, SMALL, dropout_forward, dropout_backward, NULL});
}

/* Fully connected, as a function of weights, bias, x. */
enum { IMAGES = 3, IN = 7, OUT = 5 };

static void linear_forward(const void *own, const double *x, double *y)
{
    (void)own;
    hada_ref_linear(IMAGES, IN, OUT, x, x + IN * OUT, x + IN * OUT + OUT, y);
}

static void linear_backward(const void *own, const double *x, const double *dy, double *dx)
{
    (void)own;
    hada_ref_linear_backward(IMAGES, IN, OUT, x, x + IN * OUT + OUT, dy, dx + IN * OUT + OUT, dx, dx + IN * OUT);
}

TEST(linear)
{
    hold(&(function){"linear", IN * OUT + OUT + IMAGES * IN, IMAGES * OUT, linear_forward, linear_backward, NULL});
}

/* Losses have one output; their gradient is for a weight, so it is the weight that dy scales. */
static const hada_ref_shape picture = {2, 1, 13, 14};
enum { PICTURE = 2 * 13 * 14 };
static double target[PICTURE];

static double loss(int kind, double weight, const double *x, double *dx)
{
    switch (kind) {
    case 0: return hada_ref_mse(PICTURE, weight, x, target, dx);
    case 1: return hada_ref_l1(PICTURE, weight, x, target, dx);
    case 2: return hada_ref_logits(PICTURE, weight, x, target, dx);
    case 3: return hada_ref_variation(&picture, 0, weight, x, dx);
    case 4: return hada_ref_variation(&picture, 1, weight, x, dx);
    default: return hada_ref_ssim(&picture, 2.0, weight, x, target, dx);
    }
}

static void loss_forward(const void *own, const double *x, double *y)
{
    *y = loss(*(const int *)own, 1.0, x, NULL);
}

static void loss_backward(const void *own, const double *x, const double *dy, double *dx)
{
    loss(*(const int *)own, *dy, x, dx);
}

TEST(losses)
{
    hada_random random;
    hada_random_seed(&random, 3, 0);
    for (size_t i = 0; i < PICTURE; i++)
        target[i] = hada_random_uniform(&random);
    for (int kind = 0; kind < 6; kind++)
        hold(&(function){"loss", PICTURE, 1, loss_forward, loss_backward, &kind});
}
