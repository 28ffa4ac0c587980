/* Training: gradients of filters, the squared error of planes, the gradient of clipping. Integers: exact. */
#include "check.h"
#include "kernels/shared_train.h"
#include "launch/train.h"

enum { MAX_PAIRS = 16 };

typedef struct train_state {
    hada_buffer a, b, weights;
    size_t count; /* frequencies of a channel; values of planes */
    int channels, pairs, split;
} train_state;

static hada_status begin(check_state *state, train_state **out, hada_error *err)
{
    HADA_TRY(hada_allocated(*out = hada_alloc(1, sizeof **out, "the check", err)));
    state->own = *out;
    (*out)->count = (size_t)check_get(state, 'n', 16);
    (*out)->channels = check_get(state, 'k', 1);
    (*out)->pairs = check_get(state, 'p', 2);
    (*out)->split = check_get(state, 's', 0);
    if ((*out)->pairs < 1 || (*out)->pairs > MAX_PAIRS)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "1 to %d pairs", MAX_PAIRS));
    return HADA_OK;
}

/* How often a frequency counts: 2, 1, 0. */
static float weight_of(size_t i)
{
    static const float weights[] = {2.0f, 2.0f, 1.0f, 2.0f, 0.0f};
    return weights[i % HADA_COUNT(weights)];
}

/* What the pairs p = 0, 1, ... give to frequency i of a channel, times 1/2; a and b as on the device. */
static void add_pair(const train_state *own, const float *a, const float *b, size_t i, double weight, double *sum)
{
    const double ar = a[2 * i], ai = a[2 * i + 1], br = b[2 * i], bi = b[2 * i + 1];
    sum[0] += 0.5 * weight * (own->split ? ar * br : ar * br + ai * bi);
    sum[1] += 0.5 * weight * (own->split ? ai * bi : ar * bi - ai * br);
}

static hada_status prepare_filter(check_state *state, hada_error *err)
{
    train_state *own;
    float *a = NULL, *b = NULL, *weights = NULL;
    HADA_TRY(begin(state, &own, err));
    const size_t n = own->count, image = n * (size_t)own->channels, all = image * (size_t)own->pairs;
    a = check_room(state, 2 * all * sizeof *a);
    b = check_room(state, 2 * image * sizeof *b);
    weights = check_room(state, n * sizeof *weights);
    HADA_TRY(check_output(state, 2 * image, err));
    check_fill_integers(state, 1, a, 2 * all, 99);
    check_fill_integers(state, 2, b, 2 * image, 99);
    for (size_t i = 0; i < n; i++)
        weights[i] = weight_of(i);
    for (size_t p = 0; p < (size_t)own->pairs; p++)
        for (size_t i = 0; i < image; i++) {
            float *raw = a + 2 * (p * image + i);
            if (weights[i % n] == 0.0f) /* padding holds anything */
                raw[0] = raw[1] = b[2 * i] = p ? INFINITY : NAN;
            else
                add_pair(own, a + 2 * p * image, b, i, weights[i % n], state->expected + 2 * i);
        }
    HADA_TRY(check_upload(state, &own->a, a, 2 * all * sizeof *a, err));
    HADA_TRY(check_upload(state, &own->b, b, 2 * image * sizeof *b, err));
    HADA_TRY(check_upload(state, &own->weights, weights, n * sizeof *weights, err));
    state->bytes = (double)image * own->pairs * 32.0;
    state->flops = (double)image * own->pairs * 10.0;
    return HADA_OK;
}

static hada_status launch_filter(check_state *state, hada_error *err)
{
    const train_state *own = state->own;
    const size_t channels = (size_t)own->channels;
    const hada_range range = hada_range_of(hada_divide_up(own->count, HADA_TRAIN_VECTOR), 64, channels, 1);
    cl_mem out = state->region[0];
    if (!state->regions)
        HADA_TRY(check_region(state, 0, state->out_count, &out, err));
    HADA_TRY(check_clear(state, 0, state->out_count, err));
    for (size_t p = 0; p < (size_t)own->pairs; p++)
        HADA_TRY(hada_launch_train_filter(state->slot, HADA_PROGRAM_TRAIN_DEFAULT, &range, err, .b = own->a.mem,
                                          .offset = p * own->count * channels, .g = own->b.mem,
                                          .weights = own->weights.mem, .gradient = out, .count = own->count,
                                          .scale = 0.5f, .split = own->split));
    return HADA_OK;
}

/* Two arrays of `count` integers on the device. */
static hada_status prepare_planes(check_state *state, train_state *own, float **a, float **b, hada_error *err)
{
    HADA_TRY(hada_allocated(*a = hada_alloc(own->count, sizeof **a, "the check", err)));
    HADA_TRY(hada_allocated(*b = hada_alloc(own->count, sizeof **b, "the check", err)));
    check_fill_integers(state, 1, *a, own->count, 20);
    check_fill_integers(state, 2, *b, own->count, 20);
    HADA_TRY(check_upload(state, &own->a, *a, own->count * sizeof **a, err));
    return check_upload(state, &own->b, *b, own->count * sizeof **b, err);
}

static size_t items_of(const train_state *own)
{
    return hada_divide_up(own->count, HADA_TRAIN_RUN);
}

/* The place of the sums in the output, behind the planes. */
static size_t sums_at(const train_state *own)
{
    return (own->count + 255) / 256 * 256;
}

static hada_status prepare_error(check_state *state, hada_error *err)
{
    train_state *own;
    float *x = NULL, *target = NULL;
    HADA_TRY(begin(state, &own, err));
    HADA_TRY(prepare_planes(state, own, &x, &target, err));
    HADA_TRY(check_output(state, sums_at(own) + items_of(own), err));
    for (size_t i = 0; i < own->count; i++) {
        const double d = (double)x[i] - target[i];
        state->expected[i] = 0.25 * d;
        state->expected[sums_at(own) + i / HADA_TRAIN_RUN] += d * d;
    }
    state->bytes = 12.0 * (state->own ? (double)own->count : 0.0);
    return HADA_OK;
}

/* The first values of the output are those of a buffer. */
static hada_status put(check_state *state, const hada_buffer *from, cl_mem to, hada_error *err)
{
    const cl_int code = clEnqueueCopyBuffer(state->slot->queue, from->mem, to, 0, 0, from->bytes, 0, NULL, NULL);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueCopyBuffer");
}

static size_t local_of(const check_state *state)
{
    return check_local(state, 64);
}

static hada_status launch_error(check_state *state, hada_error *err)
{
    train_state *own = state->own;
    const hada_range range = hada_range_of(items_of(own), local_of(state), 1, 1);
    cl_mem x = state->region[0], sums = state->region[1];
    if (!state->regions) {
        HADA_TRY(check_region(state, 0, own->count, &x, err));
        HADA_TRY(check_region(state, sums_at(own), items_of(own), &sums, err));
    }
    HADA_TRY(check_clear(state, 0, state->out_count, err));
    HADA_TRY(put(state, &own->a, x, err));
    return hada_launch_train_error(state->slot, HADA_PROGRAM_TRAIN_DEFAULT, &range, err, .x = x, .target = own->b.mem,
                                   .count = own->count, .scale = 0.25f, .sums = sums);
}

const check_op check_train_filter = {"train_filter", "n frequencies, k channels, p pairs, s1 split", prepare_filter,
                                     launch_filter, NULL};
const check_op check_train_error = {"train_error", "n values", prepare_error, launch_error, NULL};
