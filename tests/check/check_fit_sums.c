/* The sums of a fit: pairs added and one taken out again, other sums merged in, pools over depths. Integers: exact,
 * also beyond the 24 bits of a float, since each sum is kept as two. */
#include "check.h"
#include "kernels/shared_fit.h"
#include "launch/fit_sums.h"
#include "ref/ref_fit.h"

enum { MAX_PAIRS = 64, POOLS = 5 };

typedef struct sums_state {
    hada_buffer x, b, more;
    size_t count, vectors, stride;
    int pairs, split, kept; /* kept: sums of a depth, 4 or 6 */
} sums_state;

/* A sum as the device keeps it: the nearest float, and what that leaves. */
static void put_pair(double value, size_t stride, double *sums)
{
    sums[0] = (float)value;
    sums[stride] = value - (float)value;
}

/* The output holds the sums of all pairs but the first one, plus `more`; then the pools of these, pushed twice. */
static void expect(check_state *state, const sums_state *own, const float *x, const float *b, float *more)
{
    const size_t n = own->count;
    double *values = check_room(state, 4 * n * sizeof *values);
    double *sums = check_room(state, HADA_REF_FIT_SUMS * n * sizeof *sums);
    for (size_t p = 1; p < (size_t)own->pairs; p++) {
        for (size_t i = 0; i < 2 * n; i++) {
            values[i] = x[2 * 8 * own->vectors * p + i];
            values[2 * n + i] = b[2 * 8 * own->vectors * p + i];
        }
        hada_ref_fit_pair(values, values + 2 * n, n, 1.0, sums);
    }
    double *pool = state->expected + 2 * (size_t)own->kept * own->stride;
    static const int pooled[POOLS] = {2, 2, 3, 5, 5};
    static const double share[POOLS] = {2.0, 0.5, 0.5, 2.0, 0.5};
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < (size_t)own->kept; k++) {
            double *to = state->expected + 2 * k * own->stride + i;
            float *from = more + 2 * k * own->stride + i;
            put_pair(sums[k * n + i] + from[0] + from[own->stride], own->stride, to);
        }
        for (size_t k = 0; k < (own->split ? 5u : 3u); k++)
            pool[k * own->stride + i] = (float)(share[k] * state->expected[2 * (size_t)pooled[k] * own->stride + i]);
    }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    sums_state *own = check_own(state, sizeof *own);
    own->count = (size_t)check_get(state, 'n', 16);
    own->pairs = check_get(state, 'p', 3);
    own->split = check_get(state, 's', 0);
    own->kept = own->split ? 6 : 4;
    own->vectors = (own->count + 7) / 8;
    own->stride = (own->vectors + 63) / 64 * 64 * 8;
    if (own->pairs < 2 || own->pairs > MAX_PAIRS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "2 to %d pairs", MAX_PAIRS);
    const size_t image = 16 * own->vectors, all = image * (size_t)own->pairs;
    const size_t sums = 2 * (size_t)own->kept * own->stride, pools = (own->split ? 5 : 3) * own->stride;
    float *x = check_room(state, all * sizeof *x);
    float *b = check_room(state, all * sizeof *b);
    float *more = check_room(state, sums * sizeof *more);
    hada_status status = check_output(state, sums + pools, err);
    for (size_t p = 0; !status && p < (size_t)own->pairs; p++) { /* padding stays 0 */
        check_fill_integers(state, 2 * p + 1, x + p * image, 2 * own->count, 2000);
        check_fill_integers(state, 2 * p + 2, b + p * image, 2 * own->count, 2000);
    }
    for (size_t k = 0; !status && k < (size_t)own->kept; k++) { /* high part multiples of 16, low part below that */
        float *high = more + 2 * k * own->stride, *low = high + own->stride;
        check_fill_integers(state, 1000 + k, high, own->count, 1 << 20);
        check_fill_integers(state, 2000 + k, low, own->count, 7);
        for (size_t i = 0; i < own->count; i++)
            high[i] *= 16.0f;
    }
    if (!status)
        expect(state, own, x, b, more);
    if (!status)
        status = check_upload(state, &own->x, x, all * sizeof *x, err);
    if (!status)
        status = check_upload(state, &own->b, b, all * sizeof *b, err);
    if (!status)
        status = check_upload(state, &own->more, more, sums * sizeof *more, err);
    state->bytes = (double)own->count * sizeof(float) * ((own->pairs + 1) * (4.0 + 4.0 * own->kept) + 6.0 * own->kept);
    return status;
}

static hada_program_fit_sums program_of(const sums_state *own)
{
    return own->split ? HADA_PROGRAM_FIT_SUMS_SPLIT : HADA_PROGRAM_FIT_SUMS_DEFAULT;
}

static hada_fit_image image_of(const sums_state *own, int pair)
{
    return (hada_fit_image){.first = (size_t)pair * HADA_FIT_VECTOR * own->vectors,
                            .count = own->count,
                            .vectors = own->vectors,
                            .stride = own->stride};
}

static hada_status add_pair(check_state *state, int pair, float sign, cl_mem sums, hada_error *err)
{
    const sums_state *own = state->own;
    const hada_range range = hada_range_of(own->vectors, 64, 1, 1);
    return hada_launch_fit_pair(state->slot, program_of(own), &range, err, .x = own->x.mem, .b = own->b.mem,
                                .sums = sums, .image = image_of(own, pair), .sign = sign);
}

static hada_status launch(check_state *state, hada_error *err)
{
    const sums_state *own = state->own;
    const size_t size = 2 * (size_t)own->kept * own->stride;
    const hada_range range = hada_range_of(own->vectors, 64, 1, 1);
    const hada_fit_image image = image_of(own, 0);
    cl_mem sums = state->region[0], pool = state->region[1];
    if (!state->regions) {
        HADA_TRY(check_region(state, 0, size, &sums, err));
        HADA_TRY(check_region(state, size, state->out_count - size, &pool, err));
    }
    HADA_TRY(check_clear(state, 0, state->out_count, err));
    for (int p = 0; p < own->pairs; p++)
        HADA_TRY(add_pair(state, p, 1.0f, sums, err));
    HADA_TRY(add_pair(state, 0, -1.0f, sums, err));
    HADA_TRY(hada_launch_fit_merge(state->slot, program_of(own), &range, err, .more = own->more.mem, .sums = sums,
                                   .image = image, .count = own->kept));
    for (int depth = 0; depth < 2; depth++)
        HADA_TRY(hada_launch_fit_pool(state->slot, program_of(own), &range, err, .sums = sums, .pool = pool,
                                      .image = image, .per_pair = 0.25f));
    return HADA_OK;
}

const check_op check_fit_sums = {"fit_sums", "n frequencies, p pairs, s1 split", prepare, launch, NULL};
