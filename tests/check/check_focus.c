/* The all-in-focus image of a stack (the distance map, which holds NaN, is compared in test_focus). */
#include "check.h"
#include "focus/focus.h"
#include "ref/ref_focus.h"

typedef struct focus_state {
    hada_focus *focus;
    hada_buffer planes, map;
    int depths;
    size_t plane;
} focus_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    focus_state *own = check_own(state, sizeof *own);
    double distances[64];
    hada_focus_desc desc = {.channels = check_get(state, 'k', 3),
                            .rows = check_get(state, 'r', 8),
                            .cols = check_get(state, 'c', 8),
                            .depths = check_get(state, 'd', 4),
                            .distances_mm = distances};
    for (int i = 0; i < 64; i++)
        distances[i] = 100.0 + 10.0 * i;
    hada_focus_options_init(&desc.options, 0);
    desc.options.measure = (hada_focus_measure)check_get(state, 'm', HADA_FOCUS_CONTRAST);
    desc.options.fuse = check_get(state, 's', 0) ? HADA_FOCUS_SUM : HADA_FOCUS_WEIGHTED;
    desc.options.window_sigma = check_get(state, 'w', 25) / 10.0;
    own->depths = desc.depths;
    const size_t pixels = (size_t)desc.rows * (size_t)desc.cols, all = pixels * (size_t)(desc.channels * desc.depths);
    own->plane = pixels * (size_t)desc.channels;
    float *planes = check_room(state, all * sizeof *planes);
    double *distance = check_room(state, 2 * pixels * sizeof *distance);
    hada_focus_report report = {.size = sizeof report};
    check_fill_normal(state, 1, planes, all);
    /* refined planes are dark where another depth is bright */
    for (size_t i = 0; check_get(state, 'z', 0) && i < all; i++)
        planes[i] = (int)(i % (size_t)desc.cols) % 64 < 16 ? planes[i] : 0.0f;
    HADA_TRY(hada_focus_create(&own->focus, state->slot, &desc, err));
    HADA_TRY(check_upload(state, &own->planes, planes, all * sizeof *planes, err));
    HADA_TRY(check_scratch(state, &own->map, pixels * sizeof(float), err));
    HADA_TRY(check_output(state, own->plane, err));
    HADA_TRY(hada_ref_focus(planes, desc.channels, desc.rows, desc.cols, desc.depths, distances, NULL, &desc.options,
                            state->expected, distance, distance + pixels, &report, err));
    state->tolerance = 1e-6;
    state->bytes = (double)(all + own->plane + pixels) * sizeof(float);
    state->flops = (double)pixels * desc.depths * (12.0 + 4.0 * 17.0);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    focus_state *own = state->own;
    HADA_TRY(hada_focus_begin(own->focus, NULL, err));
    for (int d = 0, n; d < own->depths; d += n) {
        n = own->depths - d;
        if (state->batch_limit && state->batch_limit < n)
            n = state->batch_limit;
        HADA_TRY(hada_focus_push(own->focus, d, n, own->planes.mem, (size_t)d * own->plane, err));
    }
    return hada_focus_finish(own->focus, 0.0, state->out.mem, state->out_offset, own->map.mem, 0, NULL, err);
}

static void release(check_state *state)
{
    focus_state *own = state->own;
    hada_focus_destroy(&own->focus);
}

const check_op check_focus = {
    "focus",
    "d depths, k channels, r rows, c columns, m measure (1 contrast, 2 energy, 3 combined), s1 sum, w window (tenths of a pixel)",
    prepare, launch, release};
