/* Components of point spread functions that vary over the field (kernels/classic_field.cl): planes times the weights of
 * each, and the transpose, one after the other. */
#include "check.h"
#include "classic/classic_steps.h"
#include "launch/classic_field.h"

typedef struct field_state {
    hada_buffer planes, maps, list, parts, sums;
    int channels, depths, components, pixels;
    size_t offset, part_values, plane_values; /* offset: of the weights, in floats */
} field_state;

static hada_status expect(check_state *state, const field_state *own, const float *planes, const float *maps,
                          const cl_int *list)
{
    const size_t pixels = (size_t)own->pixels, channels = (size_t)own->channels, components = (size_t)own->components;
    double *sums = state->expected + own->part_values;
    for (size_t image = 0; image < own->part_values / pixels; image++) {
        const size_t place = image / channels, plane = place / components * channels + image % channels;
        const float *w = maps + own->offset + (size_t)list[place] * pixels, *x = planes + plane * pixels;
        for (size_t i = 0; i < pixels; i++) {
            const double product = (double)w[i] * (double)x[i];
            state->expected[image * pixels + i] = product;
            sums[plane * pixels + i] += (double)w[i] * product;
        }
    }
    return HADA_OK;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    enum { BEFORE = 64 }; /* floats before the weights */
    field_state *own = check_own(state, sizeof *own);
    own->channels = check_get(state, 'b', 2);
    own->depths = check_get(state, 'd', 2);
    own->components = check_get(state, 'k', 3);
    own->pixels = 8 * check_get(state, 'n', 300);
    own->offset = BEFORE;
    const size_t pixels = (size_t)own->pixels, places = (size_t)own->depths * (size_t)own->components;
    own->plane_values = (size_t)own->depths * (size_t)own->channels * pixels;
    own->part_values = places * (size_t)own->channels * pixels;
    const size_t weights = BEFORE + (places + 1) * pixels;
    float *planes = check_room(state, own->plane_values * sizeof *planes);
    float *maps = check_room(state, weights * sizeof *maps);
    cl_int *list = check_room(state, places * sizeof *list);
    check_fill_normal(state, 0, planes, own->plane_values);
    check_fill_normal(state, 1, maps, weights);
    for (size_t i = 0; i < places; i++) /* another order than that of the weights, of which one is not used */
        list[i] = (cl_int)((7 * i + 1) % (places + 1));
    HADA_TRY(check_output(state, own->part_values + own->plane_values, err));
    HADA_TRY(check_upload(state, &own->planes, planes, own->plane_values * sizeof *planes, err));
    HADA_TRY(check_upload(state, &own->maps, maps, weights * sizeof *maps, err));
    HADA_TRY(check_upload(state, &own->list, list, places * sizeof *list, err));
    HADA_TRY(check_scratch(state, &own->parts, own->part_values * sizeof *planes, err));
    HADA_TRY(check_scratch(state, &own->sums, own->plane_values * sizeof *planes, err));
    state->tolerance = (own->components + 1) * 6e-8; /* a rounding of each product and of each sum */
    state->bytes = 24.0 * (double)own->part_values;
    return expect(state, own, planes, maps, list);
}

static hada_status launch(check_state *state, hada_error *err)
{
    const field_state *own = state->own;
    const hada_program_classic_field program = hada_program_classic_field_of(state->slot);
    const size_t group = (size_t)hada_macros_of_classic_field(program)->refine_group, bytes = sizeof(float);
    const size_t slices = hada_divide_up((size_t)own->pixels, HADA_CLASSIC_SLICE);
    const hada_classic_slices of = {(cl_uint)own->channels, (cl_uint)own->pixels, HADA_CLASSIC_SLICE};
    const hada_range parts = hada_range_groups(slices, group, own->part_values / (size_t)own->pixels, 1);
    const hada_range planes = hada_range_groups(slices, group, own->plane_values / (size_t)own->pixels, 1);
    HADA_TRY(hada_launch_classic_part(state->slot, program, &parts, err, .planes = own->planes.mem,
                                      .parts = own->parts.mem, .list = own->list.ints, .maps = own->maps.mem,
                                      .offset = own->offset, .components = own->components, .slices = of));
    HADA_TRY(hada_launch_classic_unite(state->slot, program, &planes, err, .parts = own->parts.mem,
                                       .planes = own->sums.mem, .list = own->list.ints, .maps = own->maps.mem,
                                       .offset = own->offset, .components = own->components, .slices = of));
    HADA_TRY(hada_buffer_copy(state->slot, own->parts.mem, 0, state->out.mem, state->out_offset * bytes,
                              own->part_values * bytes, err));
    return hada_buffer_copy(state->slot, own->sums.mem, 0, state->out.mem,
                            (state->out_offset + own->part_values) * bytes, own->plane_values * bytes, err);
}

const check_op check_classic_field = {"classic_field",
                                      "b channels, d depths, k components, n pixels of an image in units of eight",
                                      prepare, launch, NULL};
