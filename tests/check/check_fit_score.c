/* Leave-one-out of one pair at five settings, what no linear camera explains, and the energies of planes. */
#include "check_fit.h"
#include "launch/fit_score.h"

enum { SETTINGS = HADA_FIT_TRIALS, CHUNK = 8 * HADA_FIT_CHUNK, PAIRS = 4 };
static const hada_fit_trials trials = {
    .penalty = {{0.0f, 0.03f}, {0.0f, 1.5f}, {0.1f, 0.06f}, {0.3f, 0.3f}, {1.0f, 3.0f}},
    .per_pair = 1.0f / PAIRS,
    .per_other = 0.5f};
static const float least = 1.5f;

typedef struct score_state {
    hada_buffer x, b, sums, pool, weights, planes;
    check_fit fit;
    float *weight;
    int rows, cols; /* of the planes */
    size_t chunks;
    size_t leak, unexplained, energy; /* the places of these in the output, behind the error spectra */
} score_state;

static size_t rounded(size_t n)
{
    return (n + 255) / 256 * 256;
}

/* Error spectra and leaks of one setting, from the filter fitted without the last pair. */
static void expect_trial(const score_state *own, int s, const double *left, const double *seen, double *filter,
                         double *error, double *leak)
{
    const check_fit *fit = &own->fit;
    const size_t n = fit->count;
    hada_ref_fit_filter(left, fit->other, n, trials.penalty[s].alpha, trials.penalty[s].ridge, fit->split, filter);
    for (size_t i = 0; i < n; i++) {
        const double wr = filter[2 * i], wi = filter[2 * i + 1], br = fit->b[2 * i], bi = fit->b[2 * i + 1];
        error[2 * i] = fit->x[2 * i] - (fit->split ? wr * br : wr * br - wi * bi);
        error[2 * i + 1] = fit->x[2 * i + 1] - (fit->split ? wi * bi : wr * bi + wi * br);
        leak[i / CHUNK] += own->weight[i] * (fit->split ? wr * wr * seen[n + i] + wi * wi * (seen[i] - seen[n + i])
                                                        : (wr * wr + wi * wi) * seen[i]);
    }
}

static void expect_unexplained(const check_fit *fit, const float *weight, double *out)
{
    for (size_t i = 0; i < fit->count; i++) {
        double one[HADA_REF_FIT_SUMS];
        const double w = weight[i];
        for (size_t k = 0; k < HADA_REF_FIT_SUMS; k++)
            one[k] = fit->sums[k * fit->count + i];
        out[i / CHUNK] += hada_ref_fit_unexplained(one, &w, 1, least);
    }
}

static void expect(check_state *state, const score_state *own, const float *planes)
{
    const check_fit *fit = &own->fit;
    const size_t n = fit->count;
    double *room = check_room(state, 14 * n * sizeof *room);
    double *left = room, *seen = room + HADA_REF_FIT_SUMS * n, *filter = seen + 2 * n;
    double *pair = filter + 2 * n;
    memcpy(left, fit->sums, HADA_REF_FIT_SUMS * n * sizeof *left);
    for (size_t i = 0; i < 2 * n; i++) {
        pair[i] = fit->x[i];
        pair[2 * n + i] = fit->b[i];
        seen[i] = fit->other[i] / PAIRS * trials.per_other;
    }
    hada_ref_fit_pair(pair, pair + 2 * n, n, -1.0, left);
    for (int s = 0; s < SETTINGS; s++)
        expect_trial(own, s, left, seen, filter, state->expected + (size_t)s * 2 * n,
                     state->expected + own->leak + (size_t)s * own->chunks);
    expect_unexplained(fit, own->weight, state->expected + own->unexplained);
    for (size_t i = 0; i < (size_t)(SETTINGS * own->rows * own->cols); i++)
        state->expected[own->energy + i / (size_t)own->cols] += (double)planes[i] * planes[i];
}

static hada_status upload(check_state *state, score_state *own, const float *planes, size_t pixels, hada_error *err)
{
    const check_fit *fit = &own->fit;
    HADA_TRY(check_upload(state, &own->x, fit->x, 64 * fit->vectors, err));
    HADA_TRY(check_upload(state, &own->b, fit->b, 64 * fit->vectors, err));
    HADA_TRY(check_upload(state, &own->sums, fit->device_sums, 8 * (size_t)fit->kept * fit->stride, err));
    HADA_TRY(check_upload(state, &own->pool, fit->device_pool, 20 * fit->stride, err));
    HADA_TRY(check_upload(state, &own->weights, own->weight, 4 * fit->stride, err));
    return check_upload(state, &own->planes, planes, pixels * sizeof *planes, err);
}

static hada_status prepare(check_state *state, hada_error *err)
{
    score_state *own = check_own(state, sizeof *own);
    check_fit *fit = &own->fit;
    const size_t n = (size_t)check_get(state, 'n', 16);
    own->rows = check_get(state, 'r', 5);
    own->cols = check_get(state, 'c', 19);
    const size_t pixels = SETTINGS * (size_t)own->rows * (size_t)own->cols;
    check_fit_make(fit, state, n, PAIRS, check_get(state, 's', 0));
    own->weight = check_room(state, fit->stride * sizeof(float));
    float *planes = check_room(state, pixels * sizeof *planes);
    own->chunks = (fit->vectors + HADA_FIT_CHUNK - 1) / HADA_FIT_CHUNK;
    own->leak = rounded(SETTINGS * 2 * n);
    own->unexplained = rounded(own->leak + SETTINGS * own->chunks);
    own->energy = rounded(own->unexplained + own->chunks);
    HADA_TRY(check_output(state, own->energy + (size_t)(SETTINGS * own->rows), err));
    check_fill_integers(state, 2, planes, pixels, 9);
    for (size_t i = 0; i < n; i++)
        own->weight[i] = (float)(i % 3); /* some are left out */
    expect(state, own, planes);
    HADA_TRY(upload(state, own, planes, pixels, err));
    state->tolerance = 2e-6; /* sums of up to 32 groups of eight, one after the other */
    state->bytes = (double)n * 4.0 * (4.0 + 2.0 * fit->kept + 4.0 + 2.0 * SETTINGS) + (double)pixels * 4.0;
    return HADA_OK;
}

static hada_program_fit_score program_of(const check_state *state)
{
    const score_state *own = state->own;
    return HADA_FIT_PROGRAM(FIT_SCORE, own->fit.split, check_local(state, 2) > 1);
}

static hada_status launch_trial(check_state *state, hada_error *err)
{
    const score_state *own = state->own;
    const hada_fit_image image = check_fit_image(&own->fit, 0);
    const hada_range range =
        hada_range_of(own->chunks * check_local(state, HADA_FIT_CHUNK), check_local(state, HADA_FIT_GROUP), 1, 1);
    HADA_TRY(hada_launch_fit_trial(state->slot, program_of(state), &range, err, .x = own->x.mem, .b = own->b.mem,
                                   .sums = own->sums.mem, .pool = own->pool.mem, .weights = own->weights.mem,
                                   .error = state->region[0], .leak = state->region[1], .image = image,
                                   .trials = trials));
    return hada_launch_fit_unexplained(state->slot, program_of(state), &range, err, .sums = own->sums.mem,
                                       .weights = own->weights.mem, .out = state->region[2], .image = image,
                                       .least = least);
}

static hada_status launch_energy(check_state *state, hada_error *err)
{
    const score_state *own = state->own;
    const hada_range range = hada_range_of((size_t)own->rows, check_local(state, 32), SETTINGS, 1);
    return hada_launch_fit_energy(state->slot, program_of(state), &range, err, .planes = own->planes.mem,
                                  .rows = own->rows, .cols = own->cols, .out = state->region[3]);
}

static hada_status launch(check_state *state, hada_error *err)
{
    const score_state *own = state->own;
    const size_t first[] = {0, own->leak, own->unexplained, own->energy, state->out_count};
    for (size_t i = 0; !state->region[3] && i < 4; i++) {
        cl_mem region;
        HADA_TRY(check_region(state, first[i], first[i + 1] - first[i], &region, err));
    }
    HADA_TRY(check_clear(state, 0, state->out_count, err));
    HADA_TRY(launch_trial(state, err));
    return launch_energy(state, err);
}

const check_op check_fit_score = {"fit_score", "n frequencies, r rows and c columns of the planes, s1 split", prepare,
                                  launch, NULL};
