/* Planes that explain a frame together, added up, and one of them with what the others hold beside it: exact. */
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
    hada_status status = HADA_OK;
    check_fill_integers(state, 1, planes, floats, 99);
    HADA_TRY(check_output(state, 2 * own->values, err));
    for (size_t i = 0; i < own->values; i++)
        for (int n = 0; n < own->count; n++)
            state->expected[(n != own->own) * own->values + i] += planes[BEFORE + (size_t)n * own->values + i];
    HADA_TRY(check_upload(state, &own->planes, planes, floats * sizeof *planes, err));
    HADA_TRY(check_scratch(state, &own->sum, own->values * sizeof(float), err));
    state->bytes = (double)(own->count + 5) * (double)own->values * sizeof(float);
    state->flops = (double)(own->count + 1) * (double)own->values;
done:
    return status;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const beside_state *own = state->own;
    const hada_range range = hada_layer_flat_range(state->slot, own->values, 1);
    hada_status status = HADA_OK;
    HADA_TRY(hada_launch_net_add_planes(state->slot, HADA_PROGRAM_NET_TENSOR_DEFAULT, &range, err,
                                        .planes = own->planes.mem, .sum = own->sum.mem, .offset = BEFORE,
                                        .values = own->values, .count = own->count));
    HADA_TRY(hada_launch_net_beside(state->slot, HADA_PROGRAM_NET_TENSOR_DEFAULT, &range, err,
                                    .planes = own->planes.mem, .sum = own->sum.mem, .out = state->out.mem,
                                    .offset = BEFORE + (size_t)own->own * own->values, .out_offset = state->out_offset,
                                    .values = own->values));
done:
    return status;
}

const check_op check_net_beside = {"net_beside", "k channels, r rows, c columns, n planes, o number of the own one",
                                   prepare, launch, NULL};
