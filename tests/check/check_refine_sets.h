/* What the checks of refine_explain and refine_score share: sets of depths, with the spectra of their planes and OTFs.
 */
#ifndef HADA_CHECK_REFINE_SETS_H
#define HADA_CHECK_REFINE_SETS_H

#include "check.h"
#include "filter/bank.h"
#include "launch/refine.h"
#include "ref/ref_spectrum.h"

enum { SLICE = 2048, MAX_DEPTHS = 8 };

typedef struct refine_sets {
    hada_buffer otf, data, planes, list;
    float *otf_values, *data_values, *planes_values; /* in the layout, padding included */
    int depth[64];                                   /* the list */
    hada_spectrum_layout layout;
    int channels, sets, depths;
    size_t slices;
} refine_sets;

/* `count` normal numbers, on the host and the device. */
static inline hada_status sets_fill(check_state *state, uint64_t stream, size_t count, float **values,
                                    hada_buffer *buffer, hada_error *err)
{
    *values = check_room(state, count * sizeof **values);
    check_fill_normal(state, stream, *values, count);
    return check_upload(state, buffer, *values, count * sizeof **values, err);
}

/* From the letters r, c, b, k, s, d. One more depth has an OTF than a set has depths, so that the list matters. */
static inline hada_status sets_make(check_state *state, refine_sets *own, hada_error *err)
{
    const int rows = check_get(state, 'r', 16), cols = check_get(state, 'c', 16), block = check_get(state, 'b', 8);
    const int blocks = (cols / 2 + block) / block;
    own->layout = (hada_spectrum_layout){rows, cols, block, blocks, (size_t)blocks * (size_t)rows * (size_t)block};
    own->channels = check_get(state, 'k', 1);
    own->sets = check_get(state, 's', 1);
    own->depths = check_get(state, 'd', 2);
    own->slices = (own->layout.count + SLICE - 1) / SLICE;
    if (own->depths > MAX_DEPTHS || own->sets * own->depths > (int)HADA_COUNT(own->depth))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d depths", MAX_DEPTHS);
    for (int i = 0; i < own->sets * own->depths; i++)
        own->depth[i] = (i % own->depths + i / own->depths) % (own->depths + 1);
    const size_t values = (size_t)own->channels * own->layout.count, depths = (size_t)own->depths;
    HADA_TRY(sets_fill(state, 1, 2 * (depths + 1) * values, &own->otf_values, &own->otf, err));
    HADA_TRY(sets_fill(state, 2, 2 * values, &own->data_values, &own->data, err));
    HADA_TRY(sets_fill(state, 3, 2 * (size_t)own->sets * (depths ? depths : 1) * values, &own->planes_values,
                       &own->planes, err));
    return check_upload(state, &own->list, own->depth, sizeof own->depth, err);
}

static inline hada_program_refine sets_program(const check_state *state, const refine_sets *own)
{
    return state->slot->context->shape == HADA_SHAPE_GROUPS ? HADA_PROGRAM_REFINE_GROUPS
           : own->layout.block % 8                          ? HADA_PROGRAM_REFINE_SCALAR
                                                            : HADA_PROGRAM_REFINE_DEFAULT;
}

static inline hada_refine_problem sets_problem(const refine_sets *own)
{
    return (hada_refine_problem){.spectrum = hada_spectrum_shape_of(&own->layout),
                                 .depths = own->depths,
                                 .channels = (unsigned)own->channels,
                                 .sums = {.slice = SLICE}};
}

#endif
