/* What planes do not explain (refine_explain): the rest at every frequency and its energy. */
#include "check_refine_sets.h"

typedef struct explain_state {
    refine_sets sets;
    size_t partial_first; /* the partial sums' place in the output */
} explain_state;

/* One value of the layout: writes the rest and adds to its slice's sum. */
static void expect_value(check_state *state, const explain_state *own, int set, int channel, size_t at, int often)
{
    const refine_sets *in = &own->sets;
    const size_t count = in->layout.count, plane = (size_t)set * (size_t)in->channels + (size_t)channel;
    double h[2 * MAX_DEPTHS], u[2 * MAX_DEPTHS], b[2];
    for (int s = 0; s < in->depths; s++) {
        const size_t z = (size_t)in->depth[set * in->depths + s];
        const size_t from = (z * (size_t)in->channels + (size_t)channel) * count + at;
        const size_t place = ((size_t)(set * in->depths + s) * (size_t)in->channels + (size_t)channel) * count + at;
        for (size_t part = 0; part < 2; part++) {
            h[2 * (size_t)s + part] = in->otf_values[2 * from + part];
            u[2 * (size_t)s + part] = in->planes_values[2 * place + part];
        }
    }
    for (size_t part = 0; part < 2; part++)
        b[part] = in->data_values[2 * ((size_t)channel * count + at) + part];
    const double energy = hada_ref_explain(in->depths, h, u, b, state->expected + 2 * (plane * count + at));
    state->expected[own->partial_first + plane * in->slices + at / SLICE] += often * energy;
}

static void expect(check_state *state, const explain_state *own)
{
    const hada_spectrum_layout *layout = &own->sets.layout;
    for (int set = 0; set < own->sets.sets; set++)
        for (int c = 0; c < own->sets.channels; c++)
            for (int ky = 0; ky < layout->rows; ky++)
                for (int kx = 0; kx < layout->blocks * layout->block; kx++) {
                    const int once = kx == 0 || 2 * kx == layout->cols, padding = kx > layout->cols / 2;
                    expect_value(state, own, set, c, hada_spectrum_index(layout, ky, kx), padding ? 0 : once ? 1 : 2);
                }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    explain_state *own = check_own(state, sizeof *own);
    const refine_sets *sets = &own->sets;
    HADA_TRY(sets_make(state, &own->sets, err));
    const size_t planes = (size_t)(sets->sets * sets->channels), rest = 2 * planes * sets->layout.count;
    own->partial_first = (rest + 255) / 256 * 256;
    HADA_TRY(check_output(state, own->partial_first + planes * sets->slices, err));
    expect(state, own);
    state->tolerance = 2e-6; /* the energies weigh most: sums of up to 2048 values, one after the other */
    state->bytes = (double)rest * (2.0 * sets->depths + 2.0) * sizeof(float);
    state->flops = (double)rest * (6.0 * sets->depths + 3.0);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    explain_state *own = state->own;
    const refine_sets *sets = &own->sets;
    const hada_range range =
        hada_range_groups(sets->slices, check_local(state, 64), (size_t)sets->channels, (size_t)sets->sets);
    cl_mem rest = state->region[0], partial = state->region[1];
    if (!state->regions) {
        HADA_TRY(check_region(state, 0, own->partial_first, &rest, err));
        HADA_TRY(check_region(state, own->partial_first, state->out_count - own->partial_first, &partial, err));
    }
    HADA_TRY(check_clear(state, 0, own->partial_first, err));
    return hada_launch_refine_explain(state->slot, sets_program(state, sets), &range, err, .otf = sets->otf.mem,
                                      .list = sets->list.ints, .frame = sets->data.mem, .now_u = sets->planes.mem,
                                      .residual = rest, .has_residual = 1, .partial = partial,
                                      .problem = sets_problem(sets));
}

const check_op check_explain = {"refine_explain",
                                "r rows, c columns, b columns of a block, k channels, d depths in a set, s sets",
                                prepare, launch, NULL};
