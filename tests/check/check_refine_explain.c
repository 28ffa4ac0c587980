/* What planes do not explain (refine_explain): the rest at every frequency and its energy. */
#include "check.h"
#include "filter/bank.h"
#include "launch/refine.h"
#include "ref/ref_spectrum.h"

enum { SLICE = 2048, MAX_DEPTHS = 8 };

typedef struct explain_state {
    hada_buffer otf, data, planes, list;
    hada_spectrum_layout layout;
    int channels, sets, depths;
    size_t slices, partial_first; /* the partial sums' place in the output */
} explain_state;

typedef struct inputs {
    float *otf, *data, *planes; /* in the layout, padding included */
    int list[64];
} inputs;

/* One more depth has an OTF than a set has depths, so that the list matters. */
static void make_inputs(check_state *state, const explain_state *own, inputs *in)
{
    const size_t count = own->layout.count, channels = (size_t)own->channels, depths = (size_t)own->depths;
    const size_t otf = (depths + 1) * channels * count, planes = (size_t)own->sets * depths * channels * count;
    in->otf = check_room(state, 2 * otf * sizeof(float));
    in->data = check_room(state, 2 * channels * count * sizeof(float));
    in->planes = check_room(state, 2 * planes * sizeof(float));
    check_fill_normal(state, 1, in->otf, 2 * otf);
    check_fill_normal(state, 2, in->data, 2 * channels * count);
    check_fill_normal(state, 3, in->planes, 2 * planes);
    for (int i = 0; i < own->sets * own->depths; i++)
        in->list[i] = (i % own->depths + i / own->depths) % (own->depths + 1);
}

/* One value of the layout: writes the rest and adds to its slice's sum. */
static void expect_value(check_state *state, const explain_state *own, const inputs *in, int set, int channel,
                         size_t at, int often)
{
    const size_t count = own->layout.count, plane = (size_t)set * (size_t)own->channels + (size_t)channel;
    double h[2 * MAX_DEPTHS], u[2 * MAX_DEPTHS], b[2];
    for (int s = 0; s < own->depths; s++) {
        const size_t z = (size_t)in->list[set * own->depths + s];
        const size_t from = (z * (size_t)own->channels + (size_t)channel) * count + at;
        const size_t place = ((size_t)(set * own->depths + s) * (size_t)own->channels + (size_t)channel) * count + at;
        for (size_t part = 0; part < 2; part++) {
            h[2 * (size_t)s + part] = in->otf[2 * from + part];
            u[2 * (size_t)s + part] = in->planes[2 * place + part];
        }
    }
    for (size_t part = 0; part < 2; part++)
        b[part] = in->data[2 * ((size_t)channel * count + at) + part];
    const double energy = hada_ref_explain(own->depths, h, u, b, state->expected + 2 * (plane * count + at));
    state->expected[own->partial_first + plane * own->slices + at / SLICE] += often * energy;
}

static void expect(check_state *state, const explain_state *own, const inputs *in)
{
    const hada_spectrum_layout *layout = &own->layout;
    for (int set = 0; set < own->sets; set++)
        for (int c = 0; c < own->channels; c++)
            for (int ky = 0; ky < layout->rows; ky++)
                for (int kx = 0; kx < layout->blocks * layout->block; kx++) {
                    const int once = kx == 0 || 2 * kx == layout->cols, padding = kx > layout->cols / 2;
                    expect_value(state, own, in, set, c, hada_spectrum_index(layout, ky, kx),
                                 padding ? 0
                                 : once  ? 1
                                         : 2);
                }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    explain_state *own = check_room(state, 1 * sizeof *own);
    inputs in = {0};
    state->own = own;
    const int rows = check_get(state, 'r', 16), cols = check_get(state, 'c', 16), block = check_get(state, 'b', 8);
    const int blocks = (cols / 2 + block) / block;
    own->layout = (hada_spectrum_layout){rows, cols, block, blocks, (size_t)blocks * (size_t)rows * (size_t)block};
    own->channels = check_get(state, 'k', 1);
    own->sets = check_get(state, 's', 1);
    own->depths = check_get(state, 'd', 2);
    own->slices = (own->layout.count + SLICE - 1) / SLICE;
    if (own->depths > MAX_DEPTHS || own->sets * own->depths > (int)HADA_COUNT(in.list))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d depths", MAX_DEPTHS);
    const size_t planes = (size_t)(own->sets * own->channels), rest = 2 * planes * own->layout.count;
    own->partial_first = (rest + 255) / 256 * 256;
    make_inputs(state, own, &in);
    HADA_TRY(check_output(state, own->partial_first + planes * own->slices, err));
    expect(state, own, &in);
    const size_t count = own->layout.count * (size_t)own->channels, all = count * (size_t)(own->depths + 1);
    HADA_TRY(check_upload(state, &own->otf, in.otf, 8 * all, err));
    HADA_TRY(check_upload(state, &own->data, in.data, 8 * count, err));
    HADA_TRY(check_upload(state, &own->planes, in.planes, 4 * rest * (size_t)own->depths, err));
    HADA_TRY(check_upload(state, &own->list, in.list, sizeof in.list, err));
    state->tolerance = 2e-6; /* the energies weigh most: sums of up to 2048 values, one after the other */
    state->bytes = (double)rest * (2.0 * own->depths + 2.0) * sizeof(float);
    state->flops = (double)rest * (6.0 * own->depths + 3.0);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    explain_state *own = state->own;
    const hada_program_refine program = state->slot->context->shape == HADA_SHAPE_GROUPS ? HADA_PROGRAM_REFINE_GROUPS
                                        : own->layout.block % 8                          ? HADA_PROGRAM_REFINE_SCALAR
                                                                                         : HADA_PROGRAM_REFINE_DEFAULT;
    const hada_refine_problem problem = {.spectrum = hada_spectrum_shape_of(&own->layout),
                                         .depths = own->depths,
                                         .channels = (unsigned)own->channels,
                                         .sums = {.slice = SLICE}};
    const hada_range range =
        hada_range_groups(own->slices, check_local(state, 64), (size_t)own->channels, (size_t)own->sets);
    cl_mem rest = state->region[0], partial = state->region[1];
    if (!state->regions) {
        HADA_TRY(check_region(state, 0, own->partial_first, &rest, err));
        HADA_TRY(check_region(state, own->partial_first, state->out_count - own->partial_first, &partial, err));
    }
    HADA_TRY(check_clear(state, 0, own->partial_first, err));
    return hada_launch_refine_explain(state->slot, program, &range, err, .otf = own->otf.mem, .list = own->list.ints,
                                      .frame = own->data.mem, .now_u = own->planes.mem, .residual = rest,
                                      .has_residual = 1, .partial = partial, .problem = problem);
}

const check_op check_explain = {"refine_explain",
                                "r rows, c columns, b columns of a block, k channels, d depths in a set, s sets",
                                prepare, launch, NULL};
