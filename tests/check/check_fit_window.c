/* One iteration of filters by the error in the window: a pair gathered, the product with T, the residual, filter and
 * direction. In the output, each at the next multiple of 256: what is gathered and then t, r, x, p (`c` channels of
 * complex numbers), and the partial sums of both reductions. All channels have the same sums. */
#include "check_fit.h"
#include "launch/fit_window.h"

enum { CHUNK = 8 * HADA_FIT_CHUNK, STATES = 4, PARTS = 6, PAIRS = 3 };
static const hada_fit_penalty penalty = {.alpha = 0.25f, .ridge = 0.5f};
static const float shift = 0.375f, step = 0.75f, along = 1.5f, zeta = 0.5f, beta = 0.25f;

typedef struct window_state {
    hada_buffer g, b, sums, pool, weights, start; /* start: the four states before the iteration */
    check_fit fit;
    float *weight, *frame, *before;
    int channels;
    size_t all, chunks; /* complex numbers of all channels */
    size_t at[PARTS + 1];
} window_state;

/* Double by double, from the sums: the denominator, with (1) or without (0) the depth's own part. */
static double under(const check_fit *fit, size_t i, int k, int whole)
{
    const size_t n = fit->count;
    double own = fit->sums[2 * n + i], other = fit->other[i], weight = 1.0;
    if (fit->split) {
        own = k ? own - fit->sums[5 * n + i] : fit->sums[5 * n + i];
        other = k ? other - fit->other[n + i] : fit->other[n + i];
        weight = 0.5;
    }
    return (whole ? own : 0.0) + penalty.alpha * other + weight * penalty.ridge;
}

static void expect(check_state *state, const window_state *own)
{
    const check_fit *fit = &own->fit;
    const size_t n = fit->count, all = own->all;
    double *t = state->expected + own->at[0], *r = state->expected + own->at[1], *x = state->expected + own->at[2],
           *p = state->expected + own->at[3];
    const float *start = own->before;
    for (size_t i = 0; i < all; i++) {
        const double gr = start[8 * all + 2 * i], gi = start[8 * all + 2 * i + 1], br = own->frame[2 * i],
                     bi = own->frame[2 * i + 1];
        t[2 * i] = start[2 * i] + (fit->split ? gr * br : gr * br + gi * bi);
        t[2 * i + 1] = start[2 * i + 1] + (fit->split ? gi * bi : gi * br - gr * bi);
    }
    for (size_t i = 0; i < 2 * all; i++) {
        const size_t c = i / 2 / n, f = i / 2 % n;
        const int k = (int)(i % 2);
        const double whole = under(fit, f, k, 1), direction = start[6 * all + i];
        t[i] = (t[i] + under(fit, f, k, 0) * direction) / whole + shift * direction;
        r[i] = start[2 * all + i] - step * t[i];
        x[i] = start[4 * all + i] + along * direction;
        p[i] = zeta * r[i] + beta * direction;
        double *sums = state->expected + c * own->chunks + f / CHUNK;
        sums[own->at[4]] += own->weight[f] * whole * direction * t[i];
        sums[own->at[5]] += own->weight[f] * whole * r[i] * r[i];
    }
}

static hada_status upload(check_state *state, window_state *own, hada_error *err)
{
    const check_fit *fit = &own->fit;
    HADA_TRY(check_upload(state, &own->b, own->frame, 8 * own->all + 64, err));
    HADA_TRY(check_upload(state, &own->g, own->before + 8 * own->all, 8 * own->all + 64, err));
    HADA_TRY(check_upload(state, &own->start, own->before, 32 * own->all, err));
    HADA_TRY(check_upload(state, &own->sums, fit->device_sums, 8 * (size_t)fit->kept * fit->stride, err));
    HADA_TRY(check_upload(state, &own->pool, fit->device_pool, 20 * fit->stride, err));
    return check_upload(state, &own->weights, own->weight, 4 * fit->stride, err);
}

static hada_status prepare(check_state *state, hada_error *err)
{
    window_state *own = check_own(state, sizeof *own);
    check_fit *fit = &own->fit;
    const size_t n = (size_t)check_get(state, 'n', 16);
    own->channels = check_get(state, 'c', 1);
    own->all = n * (size_t)own->channels;
    check_fit_make(fit, state, n, PAIRS, check_get(state, 's', 0));
    own->weight = check_room(state, fit->stride * sizeof(float));
    own->frame = check_room(state, (2 * own->all + 16) * sizeof(float));
    own->before = check_room(state, (10 * own->all + 16) * sizeof(float));
    own->chunks = (fit->vectors + HADA_FIT_CHUNK - 1) / HADA_FIT_CHUNK;
    for (size_t i = 0; i < PARTS; i++) {
        const size_t count = i < STATES ? 2 * own->all + 16 : (size_t)own->channels * own->chunks;
        own->at[i + 1] = (own->at[i] + count + 255) / 256 * 256;
    }
    HADA_TRY(check_output(state, own->at[PARTS], err));
    check_fill_normal(state, 1, own->frame, 2 * own->all);
    check_fill_normal(state, 2, own->before, 10 * own->all);
    for (size_t i = 0; i < n; i++)
        own->weight[i] = (float)(i % 3); /* some are left out */
    expect(state, own);
    state->tolerance = 2e-6; /* sums of up to 32 groups of eight, one after the other */
    state->bytes = (double)own->all * 8.0 * 14.0;
    return upload(state, own, err);
}

static hada_status set_up(check_state *state, hada_error *err)
{
    const window_state *own = state->own;
    for (size_t i = 0; !state->region[PARTS - 1] && i < PARTS; i++) {
        cl_mem region;
        HADA_TRY(check_region(state, own->at[i], own->at[i + 1] - own->at[i], &region, err));
    }
    HADA_TRY(check_clear(state, 0, state->out_count, err));
    for (size_t i = 0; i < STATES; i++) {
        const size_t bytes = 8 * own->all;
        const cl_int code = clEnqueueCopyBuffer(state->slot->queue, own->start.mem, state->region[i], i * bytes, 0,
                                                bytes, 0, NULL, NULL);
        if (code != CL_SUCCESS)
            HADA_TRY(hada_fail_cl(err, code, "clEnqueueCopyBuffer"));
    }
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const window_state *own = state->own;
    const check_fit *fit = &own->fit;
    const hada_program_fit_window program = HADA_FIT_PROGRAM(FIT_WINDOW, fit->split, check_local(state, 2) > 1);
    const size_t groups = hada_divide_up(own->all, HADA_FIT_VECTOR);
    const hada_range all = hada_range_of(groups, 64, 1, 1), vectors = hada_range_of(fit->vectors, 64, 1, 1);
    const hada_range chunks =
        hada_range_of(own->chunks * check_local(state, HADA_FIT_CHUNK), check_local(state, HADA_FIT_GROUP), 1, 1);
    HADA_TRY(set_up(state, err));
    const cl_mem t = state->region[0], r = state->region[1], x = state->region[2], p = state->region[3];
    HADA_TRY(hada_launch_fit_gather(state->slot, program, &all, err, .g = own->g.mem, .b = own->b.mem, .sum = t,
                                    .vectors = groups));
    for (int c = 0; c < own->channels; c++) {
        const hada_fit_image image = check_fit_image(fit, (size_t)c);
        HADA_TRY(hada_launch_fit_apply(state->slot, program, &chunks, err, .p = p, .t = t, .sums = own->sums.mem,
                                       .pool = own->pool.mem, .weights = own->weights.mem, .out = state->region[4],
                                       .image = image, .penalty = penalty, .shift = shift));
        HADA_TRY(hada_launch_fit_residual(state->slot, program, &chunks, err, .r = r, .t = t, .sums = own->sums.mem,
                                          .pool = own->pool.mem, .weights = own->weights.mem, .out = state->region[5],
                                          .image = image, .penalty = penalty, .step = step));
        HADA_TRY(hada_launch_fit_advance(state->slot, program, &vectors, err, .x = x, .p = p, .r = r, .image = image,
                                         .step = along, .zeta = zeta, .beta = beta));
    }
    return HADA_OK;
}

const check_op check_fit_window = {"fit_window", "n frequencies, c channels, s1 split", prepare, launch, NULL};
