/* How badly planes explain what the channels have in common (refine_score): energies within a band. */
#include "check_refine_sets.h"

enum { MAX_CHANNELS = 4 };

typedef struct score_state {
    refine_sets sets;
    hada_buffer prior, variance;
    float *prior_values, *variance_values;
    int has_prior, has_variance, band_rows, band_cols;
} score_state;

/* The squares of normal numbers. */
static hada_status squares(check_state *state, uint64_t stream, size_t count, float **values, hada_buffer *buffer,
                           hada_error *err)
{
    *values = check_room(state, count * sizeof **values);
    check_fill_normal(state, stream, *values, count);
    for (size_t i = 0; i < count; i++)
        (*values)[i] *= 0.3f * (*values)[i];
    return check_upload(state, buffer, *values, count * sizeof **values, err);
}

/* The energy of one value of the layout for one set. */
static double energy_at(const score_state *own, int set, size_t at)
{
    const refine_sets *in = &own->sets;
    const size_t count = in->layout.count, depths = (size_t)in->depths, channels = (size_t)in->channels;
    double h[2 * MAX_CHANNELS * MAX_DEPTHS], u[2 * MAX_CHANNELS * MAX_DEPTHS], b[2 * MAX_CHANNELS];
    double prior[MAX_CHANNELS], variance[MAX_CHANNELS * MAX_DEPTHS];
    for (size_t c = 0; c < channels; c++) {
        prior[c] = own->prior_values[c * count + at];
        for (size_t part = 0; part < 2; part++)
            b[2 * c + part] = in->data_values[2 * (c * count + at) + part];
        for (size_t s = 0; s < depths; s++) {
            const size_t z = (size_t)in->depth[(size_t)set * depths + s], place = (size_t)set * depths + s;
            variance[c * depths + s] = own->variance_values[(z * channels + c) * count + at];
            for (size_t part = 0; part < 2; part++) {
                h[2 * (c * depths + s) + part] = in->otf_values[2 * ((z * channels + c) * count + at) + part];
                u[2 * (c * depths + s) + part] = in->planes_values[2 * ((place * channels + c) * count + at) + part];
            }
        }
    }
    return hada_ref_score(in->channels, in->depths, h, u, b, own->has_prior ? prior : NULL,
                          own->has_variance ? variance : NULL);
}

static void expect(check_state *state, const score_state *own)
{
    const hada_spectrum_layout *layout = &own->sets.layout;
    for (int set = 0; set < own->sets.sets; set++)
        for (int ky = 0; ky < layout->rows; ky++)
            for (int kx = 0; kx <= layout->cols / 2; kx++) {
                const int row = ky < layout->rows - ky ? ky : layout->rows - ky;
                const size_t at = hada_spectrum_index(layout, ky, kx);
                if (2 * row < own->band_rows && 2 * kx < own->band_cols)
                    state->expected[(size_t)set * own->sets.slices + at / SLICE] +=
                        (kx == 0 || 2 * kx == layout->cols ? 1.0 : 2.0) * energy_at(own, set, at);
            }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    score_state *own = check_own(state, sizeof *own);
    const refine_sets *sets = &own->sets;
    HADA_TRY(sets_make(state, &own->sets, err));
    own->has_prior = check_get(state, 'p', 0);
    own->has_variance = check_get(state, 'q', 0);
    own->band_rows = check_get(state, 'h', sets->layout.rows + 1);
    own->band_cols = check_get(state, 'w', sets->layout.cols + 1);
    if (sets->channels > MAX_CHANNELS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d channels", MAX_CHANNELS);
    const size_t values = sets->layout.count * (size_t)sets->channels, all = values * (size_t)(sets->depths + 1);
    HADA_TRY(squares(state, 4, values, &own->prior_values, &own->prior, err));
    HADA_TRY(squares(state, 5, all, &own->variance_values, &own->variance, err));
    HADA_TRY(check_output(state, (size_t)sets->sets * sets->slices, err));
    expect(state, own);
    state->tolerance = 2e-6; /* sums of up to 2048 values, one after the other */
    state->bytes = (double)values * sets->sets * (2.0 * sets->depths + 1.0) * 2.0 * sizeof(float);
    state->flops = (double)values * sets->sets * (12.0 * sets->depths + 6.0);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    score_state *own = state->own;
    const refine_sets *sets = &own->sets;
    const hada_refine_band band = {(unsigned)own->band_rows, (unsigned)own->band_cols, own->has_prior,
                                   own->has_variance};
    const hada_range range = hada_range_groups(sets->slices, check_local(state, 64), (size_t)sets->sets, 1);
    cl_mem partial = state->region[0];
    if (!state->regions)
        HADA_TRY(check_region(state, 0, state->out_count, &partial, err));
    return hada_launch_refine_score(state->slot, sets_program(state, sets), &range, err, .otf = sets->otf.mem,
                                    .list = sets->list.ints, .frame = sets->data.mem, .now_u = sets->planes.mem,
                                    .prior = own->prior.mem, .variance = own->variance.mem, .partial = partial,
                                    .problem = sets_problem(sets), .band = band);
}

const check_op check_score = {
    "refine_score",
    "r rows, c columns, b columns of a block, k channels, d depths in a set, s sets, p1 with a prior, q1 with a variance, h "
    "and w rows and columns of the band",
    prepare, launch, NULL};
