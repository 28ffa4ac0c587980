/* Planes that explain a frame together: added up, and one of them with what the others hold beside it, exact; shared
 * out anew. */
#include "check.h"
#include "launch/net_tensor.h"
#include "net/layer_launch.h"

enum { BEFORE = 5 }; /* floats before the first plane */

typedef struct beside_state {
    hada_buffer planes, sum;
    size_t values;
    int count, own;
} beside_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    beside_state *own = check_own(state, sizeof *own);
    own->count = check_get(state, 'n', 1);
    own->own = check_get(state, 'o', 0);
    own->values =
        (size_t)check_get(state, 'k', 1) * (size_t)check_get(state, 'r', 8) * (size_t)check_get(state, 'c', 8);
    const size_t floats = BEFORE + own->values * (size_t)own->count;
    float *planes = check_room(state, floats * sizeof *planes);
    check_fill_integers(state, 1, planes, floats, 99);
    HADA_TRY(check_output(state, 2 * own->values, err));
    for (size_t i = 0; i < own->values; i++)
        for (int n = 0; n < own->count; n++)
            state->expected[(n != own->own) * own->values + i] += planes[BEFORE + (size_t)n * own->values + i];
    HADA_TRY(check_upload(state, &own->planes, planes, floats * sizeof *planes, err));
    HADA_TRY(check_scratch(state, &own->sum, own->values * sizeof(float), err));
    state->bytes = (double)(own->count + 5) * (double)own->values * sizeof(float);
    state->flops = (double)(own->count + 1) * (double)own->values;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const beside_state *own = state->own;
    const hada_range range = hada_layer_flat_range(state->slot, own->values, 1);
    HADA_TRY(hada_launch_net_add_planes(state->slot, hada_program_net_tensor_of(state->slot), &range, err,
                                        .planes = own->planes.mem, .sum = own->sum.mem, .offset = BEFORE,
                                        .values = own->values, .count = own->count));
    return hada_launch_net_beside(state->slot, hada_program_net_tensor_of(state->slot), &range, err,
                                  .planes = own->planes.mem, .sum = own->sum.mem, .out = state->out.mem,
                                  .offset = BEFORE + (size_t)own->own * own->values, .out_offset = state->out_offset,
                                  .values = own->values);
}

/* The sum is exact, the quotient within 2.5 units of the last place (OpenCL 1.2), the product rounded: 3 units of
 * 2^-23 at most. */
#define SHARE_TOLERANCE (3.0 * 0x1p-23)

static hada_status prepare_share(check_state *state, hada_error *err)
{
    beside_state *own = check_own(state, sizeof *own);
    own->count = check_get(state, 'n', 1);
    own->values =
        (size_t)check_get(state, 'k', 1) * (size_t)check_get(state, 'r', 8) * (size_t)check_get(state, 'c', 8);
    const size_t floats = own->values * (size_t)own->count;
    float *planes = check_room(state, floats * sizeof *planes), *whole = check_room(state, own->values * sizeof *whole);
    check_fill_integers(state, 1, planes, floats, 9);
    check_fill_integers(state, 2, whole, own->values, 99);
    HADA_TRY(check_output(state, floats, err));
    for (size_t i = 0; i < floats; i++) /* planes are not negative, and dark here and there */
        planes[i] = planes[i] > 0.0f ? planes[i] : 0.0f;
    for (size_t i = 0; i < own->values; i++) {
        double total = 0.0;
        for (int n = 0; n < own->count; n++)
            total += planes[(size_t)n * own->values + i];
        for (int n = 0; n < own->count; n++)
            state->expected[(size_t)n * own->values + i] =
                total > 0.0 ? planes[(size_t)n * own->values + i] * (double)whole[i] / total
                            : (double)whole[i] / own->count;
    }
    HADA_TRY(check_upload(state, &own->planes, planes, floats * sizeof *planes, err));
    HADA_TRY(check_upload(state, &own->sum, whole, own->values * sizeof *whole, err));
    state->bytes = (2.0 * own->count + 1.0) * (double)own->values * sizeof(float);
    state->flops = 2.0 * (double)floats;
    state->tolerance = SHARE_TOLERANCE;
    return HADA_OK;
}

static hada_status launch_share(check_state *state, hada_error *err)
{
    const beside_state *own = state->own;
    const hada_range range = hada_layer_flat_range(state->slot, own->values, 1);
    const size_t bytes = own->values * (size_t)own->count * sizeof(float);
    HADA_TRY(hada_buffer_copy(state->slot, own->planes.mem, 0, state->out.mem, state->out_offset * sizeof(float), bytes,
                              err));
    return hada_launch_net_share(state->slot, hada_program_net_tensor_of(state->slot), &range, err,
                                 .planes = state->out.mem, .whole = own->sum.mem, .offset = state->out_offset,
                                 .values = own->values, .count = own->count);
}

const check_op check_net_share = {"net_share", "k channels, r rows, c columns, n planes", prepare_share, launch_share,
                                  NULL};

const check_op check_net_beside = {"net_beside", "k channels, r rows, c columns, n planes, o number of the own one",
                                   prepare, launch, NULL};
