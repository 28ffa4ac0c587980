/* The energy of filtered spectra in tiles: whole numbers, exact. The padding does not count. */
#include "check.h"
#include "filter/bank.h"
#include "filter/gains.h"
#include "ref/ref_light.h"

typedef struct tiles_state {
    hada_meter *meter;
    hada_buffer in, gains;
} tiles_state;

static hada_status fill(check_state *state, tiles_state *own, const hada_spectrum_layout *layout, int channels,
                        hada_error *err)
{
    const hada_tiles *tiles = &own->meter->tiles;
    const size_t plane = (size_t)layout->rows * (size_t)(layout->cols / 2 + 1), count = layout->count;
    float *rows = NULL, *blocks = NULL, *gains = NULL, *packed = NULL;
    rows = check_room(state, 2 * plane * sizeof *rows);
    blocks = check_room(state, (2 * count * (size_t)channels) * sizeof *blocks);
    gains = check_room(state, plane * sizeof *gains);
    packed = check_room(state, (count * (size_t)channels) * sizeof *packed);
    for (int c = 0; c < channels; c++) {
        float *out = blocks + 2 * count * (size_t)c;
        check_fill_integers(state, 2 * (uint64_t)c, rows, 2 * plane, 9);
        check_fill_integers(state, 2 * (uint64_t)c + 1, gains, plane, 9);
        hada_layout_pack(layout, rows, out);
        hada_layout_pack_real(layout, gains, packed + count * (size_t)c);
        for (int ky = 0; ky < layout->rows; ky++)
            for (int kx = layout->cols / 2 + 1; kx < layout->blocks * layout->block; kx++)
                out[2 * hada_spectrum_index(layout, ky, kx)] = NAN;
        hada_ref_light(rows, gains, layout->rows, layout->cols, HADA_BANDS, tiles->row_last, HADA_TILE_COLS,
                       state->expected + (size_t)c * hada_tiles_count(tiles));
    }
    HADA_TRY(check_upload(state, &own->in, blocks, 8 * count * (size_t)channels, err));
    return check_upload(state, &own->gains, packed, 4 * count * (size_t)channels, err);
}

static hada_status prepare(check_state *state, hada_error *err)
{
    tiles_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 16), cols = check_get(state, 'c', 16), block = check_get(state, 'b', 8),
              channels = check_get(state, 'k', 1);
    const int blocks = (cols / 2 + block) / block;
    const hada_spectrum_layout layout = {rows, cols, block, blocks, (size_t)blocks * (size_t)rows * (size_t)block};
    HADA_TRY(hada_meter_create(&own->meter, state->slot, &layout, channels, err));
    HADA_TRY(check_output(state, (size_t)channels * hada_tiles_count(&own->meter->tiles), err));
    state->bytes = 12.0 * (double)layout.count * channels;
    return fill(state, own, &layout, channels, err);
}

static hada_status launch(check_state *state, hada_error *err)
{
    tiles_state *own = state->own;
    HADA_TRY(hada_meter_run(own->meter, own->in.mem, own->gains.mem, err));
    const cl_int code =
        clEnqueueCopyBuffer(state->slot->queue, own->meter->energy.mem, state->out.mem, 0,
                            state->out_offset * sizeof(float), state->out_count * sizeof(float), 0, NULL, NULL);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueCopyBuffer");
}

static void release(check_state *state)
{
    tiles_state *own = state->own;
    hada_meter_destroy(&own->meter);
}

const check_op check_tiles = {"filter_tiles", "r rows, c columns, b block of the layout, k channels", prepare, launch,
                              release};
