/* How badly planes explain what the channels have in common (refine_score): energies within a band. */
#include "check.h"
#include "filter/bank.h"
#include "launch/refine.h"
#include "ref/ref_spectrum.h"

enum { SLICE = 2048, MAX_DEPTHS = 8, MAX_CHANNELS = 4 };

typedef struct score_state {
    hada_buffer otf, data, planes, prior, variance, list;
    hada_spectrum_layout layout;
    int channels, sets, depths, has_prior, has_variance, band_rows, band_cols;
    size_t slices;
} score_state;

typedef struct inputs {
    float *otf, *data, *planes, *prior, *variance; /* in the layout, padding included */
    int list[64];
} inputs;

/* One more depth has an OTF than a set has depths, so that the list matters. */
static void make_inputs(check_state *state, const score_state *own, inputs *in)
{
    const size_t values = (size_t)own->channels * own->layout.count, depths = (size_t)own->depths;
    const size_t otf = (depths + 1) * values, planes = (size_t)own->sets * (depths ? depths : 1) * values;
    struct {
        float **to;
        size_t count;
        int square;
    } rows[] = {{&in->otf, 2 * otf, 0},
                {&in->data, 2 * values, 0},
                {&in->planes, 2 * planes, 0},
                {&in->prior, values, 1},
                {&in->variance, otf, 1}};
    for (size_t k = 0; k < HADA_COUNT(rows); k++) {
        *rows[k].to = check_room(state, rows[k].count * sizeof(float));
        check_fill_normal(state, k + 1, *rows[k].to, rows[k].count);
        for (size_t i = 0; rows[k].square && i < rows[k].count; i++)
            (*rows[k].to)[i] *= 0.3f * (*rows[k].to)[i];
    }
    for (int i = 0; i < own->sets * own->depths; i++)
        in->list[i] = (i % own->depths + i / own->depths) % (own->depths + 1);
}

/* The energy of one value of the layout for one set. */
static double energy_at(const score_state *own, const inputs *in, int set, size_t at)
{
    const size_t count = own->layout.count, depths = (size_t)own->depths, channels = (size_t)own->channels;
    double h[2 * MAX_CHANNELS * MAX_DEPTHS], u[2 * MAX_CHANNELS * MAX_DEPTHS], b[2 * MAX_CHANNELS];
    double prior[MAX_CHANNELS], variance[MAX_CHANNELS * MAX_DEPTHS];
    for (size_t c = 0; c < channels; c++) {
        prior[c] = in->prior[c * count + at];
        for (size_t part = 0; part < 2; part++)
            b[2 * c + part] = in->data[2 * (c * count + at) + part];
        for (size_t s = 0; s < depths; s++) {
            const size_t z = (size_t)in->list[(size_t)set * depths + s], place = (size_t)set * depths + s;
            variance[c * depths + s] = in->variance[(z * channels + c) * count + at];
            for (size_t part = 0; part < 2; part++) {
                h[2 * (c * depths + s) + part] = in->otf[2 * ((z * channels + c) * count + at) + part];
                u[2 * (c * depths + s) + part] = in->planes[2 * ((place * channels + c) * count + at) + part];
            }
        }
    }
    return hada_ref_score(own->channels, own->depths, h, u, b, own->has_prior ? prior : NULL,
                          own->has_variance ? variance : NULL);
}

static void expect(check_state *state, const score_state *own, const inputs *in)
{
    const hada_spectrum_layout *layout = &own->layout;
    for (int set = 0; set < own->sets; set++)
        for (int ky = 0; ky < layout->rows; ky++)
            for (int kx = 0; kx <= layout->cols / 2; kx++) {
                const int row = ky < layout->rows - ky ? ky : layout->rows - ky;
                const size_t at = hada_spectrum_index(layout, ky, kx);
                if (2 * row < own->band_rows && 2 * kx < own->band_cols)
                    state->expected[(size_t)set * own->slices + at / SLICE] +=
                        (kx == 0 || 2 * kx == layout->cols ? 1.0 : 2.0) * energy_at(own, in, set, at);
            }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    score_state *own = check_room(state, 1 * sizeof *own);
    inputs in = {0};
    state->own = own;
    const int rows = check_get(state, 'r', 16), cols = check_get(state, 'c', 16), block = check_get(state, 'b', 8);
    const int blocks = (cols / 2 + block) / block;
    own->layout = (hada_spectrum_layout){rows, cols, block, blocks, (size_t)blocks * (size_t)rows * (size_t)block};
    own->channels = check_get(state, 'k', 1);
    own->sets = check_get(state, 's', 1);
    own->depths = check_get(state, 'd', 2);
    own->has_prior = check_get(state, 'p', 0);
    own->has_variance = check_get(state, 'q', 0);
    own->band_rows = check_get(state, 'h', rows + 1);
    own->band_cols = check_get(state, 'w', cols + 1);
    own->slices = (own->layout.count + SLICE - 1) / SLICE;
    if (own->depths > MAX_DEPTHS || own->channels > MAX_CHANNELS || own->sets * own->depths > (int)HADA_COUNT(in.list))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d depths and %d channels", MAX_DEPTHS, MAX_CHANNELS);
    make_inputs(state, own, &in);
    HADA_TRY(check_output(state, (size_t)own->sets * own->slices, err));
    expect(state, own, &in);
    const size_t values = own->layout.count * (size_t)own->channels, all = values * (size_t)(own->depths + 1);
    const size_t planes = values * (size_t)(own->sets * (own->depths ? own->depths : 1));
    HADA_TRY(check_upload(state, &own->otf, in.otf, 8 * all, err));
    HADA_TRY(check_upload(state, &own->data, in.data, 8 * values, err));
    HADA_TRY(check_upload(state, &own->planes, in.planes, 8 * planes, err));
    HADA_TRY(check_upload(state, &own->prior, in.prior, 4 * values, err));
    HADA_TRY(check_upload(state, &own->variance, in.variance, 4 * all, err));
    HADA_TRY(check_upload(state, &own->list, in.list, sizeof in.list, err));
    state->tolerance = 2e-6; /* sums of up to 2048 values, one after the other */
    state->bytes = (double)values * own->sets * (2.0 * own->depths + 1.0) * 2.0 * sizeof(float);
    state->flops = (double)values * own->sets * (12.0 * own->depths + 6.0);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    score_state *own = state->own;
    const hada_program_refine program = state->slot->context->shape == HADA_SHAPE_GROUPS ? HADA_PROGRAM_REFINE_GROUPS
                                        : own->layout.block % 8                          ? HADA_PROGRAM_REFINE_SCALAR
                                                                                         : HADA_PROGRAM_REFINE_DEFAULT;
    const hada_refine_problem problem = {.spectrum = hada_spectrum_shape_of(&own->layout),
                                         .depths = own->depths,
                                         .channels = (unsigned)own->channels,
                                         .sums = {.slice = SLICE}};
    const hada_refine_band band = {(unsigned)own->band_rows, (unsigned)own->band_cols, own->has_prior,
                                   own->has_variance};
    const hada_range range = hada_range_groups(own->slices, check_local(state, 64), (size_t)own->sets, 1);
    cl_mem partial = state->region[0];
    if (!state->regions)
        HADA_TRY(check_region(state, 0, state->out_count, &partial, err));
    return hada_launch_refine_score(state->slot, program, &range, err, .otf = own->otf.mem, .list = own->list.ints,
                                    .frame = own->data.mem, .now_u = own->planes.mem, .prior = own->prior.mem,
                                    .variance = own->variance.mem, .partial = partial, .problem = problem,
                                    .band = band);
}

const check_op check_score = {
    "refine_score",
    "r rows, c columns, b columns of a block, k channels, d depths in a set, s sets, p1 with a prior, q1 with a variance, h "
    "and w rows and columns of the band",
    prepare, launch, NULL};
