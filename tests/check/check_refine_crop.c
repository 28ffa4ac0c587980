/* Spectra brought to a coarse grid (refine_crop): several images, channels averaged, tapers, real values, inverses. */
#include "check.h"
#include "filter/bank.h"
#include "launch/refine.h"
#include "ref/ref_spectrum.h"

typedef struct crop_state {
    hada_buffer in;
    hada_spectrum_layout full, coarse;
    int images, channels, parts, invert, tapers;
} crop_state;

static hada_spectrum_layout layout_of(int rows, int cols, int block)
{
    const int blocks = (cols / 2 + block) / block;
    return (hada_spectrum_layout){rows, cols, block, blocks, (size_t)blocks * (size_t)rows * (size_t)block};
}

static void pack(const hada_spectrum_layout *layout, int parts, const float *rows, float *blocks)
{
    if (parts == 2)
        hada_layout_pack(layout, rows, blocks);
    else
        hada_layout_pack_real(layout, rows, blocks);
}

static hada_status prepare(check_state *state, hada_error *err)
{
    crop_state *own = check_own(state, sizeof *own);
    const int block = check_get(state, 'b', 8);
    own->full = layout_of(check_get(state, 'r', 24), check_get(state, 'c', 24), block);
    own->coarse = layout_of(check_get(state, 'h', 12), check_get(state, 'w', 12), block);
    own->images = check_get(state, 'm', 2);
    own->channels = check_get(state, 'k', 1);
    own->parts = check_get(state, 'p', 2);
    own->invert = check_get(state, 'i', 0);
    own->tapers = check_get(state, 'a', 0);
    const size_t parts = (size_t)own->parts, values = (size_t)own->full.rows * (size_t)(own->full.cols / 2 + 1);
    const size_t small = (size_t)own->coarse.rows * (size_t)(own->coarse.cols / 2 + 1);
    const size_t in = own->full.count * parts, all = (size_t)(own->images * own->channels);
    float *rows = check_room(state, (size_t)own->channels * values * parts * sizeof *rows);
    float *packed = check_room(state, all * in * sizeof *packed),
          *rounded = check_room(state, own->coarse.count * parts * sizeof *rounded);
    float *expected = check_room(state, small * parts * sizeof *expected);
    double *cropped = check_room(state, small * parts * sizeof *cropped);
    HADA_TRY(check_output(state, (size_t)own->images * own->coarse.count * parts, err));
    for (size_t m = 0; m < (size_t)own->images; m++) {
        check_fill_integers(state, m, rows, (size_t)own->channels * values * parts, 99);
        for (int c = 0; c < own->channels; c++)
            pack(&own->full, own->parts, rows + (size_t)c * values * parts,
                 packed + (m * (size_t)own->channels + (size_t)c) * in);
        hada_ref_crop(rows, own->full.rows, own->full.cols, own->channels, own->coarse.rows, own->coarse.cols,
                      own->parts, 0.5 * own->channels, own->tapers, own->invert, cropped);
        /* to the layout by the tested way of the host: what rounding that costs is part of the tolerance */
        for (size_t i = 0; i < small * parts; i++)
            expected[i] = (float)cropped[i];
        pack(&own->coarse, own->parts, expected, rounded);
        for (size_t i = 0; i < own->coarse.count * parts; i++)
            state->expected[m * own->coarse.count * parts + i] = rounded[i];
    }
    HADA_TRY(check_upload(state, &own->in, packed, all * in * sizeof *packed, err));
    /* half the sum of the channels: exact, unless a power of two is taken */
    state->tolerance = own->tapers || own->invert ? 1e-6 : 0.0;
    state->bytes = (double)((size_t)own->images * small * parts) * (own->channels + 1.0) * sizeof(float);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    crop_state *own = state->own;
    const int block = own->coarse.block;
    const size_t width = (size_t)own->coarse.blocks * (size_t)block;
    const hada_refine_crop crop = {.parts = own->parts,
                                   .channels = own->channels,
                                   .factor = 0.5f * (float)own->channels,
                                   .tapers = (float)own->tapers,
                                   .invert = own->invert};
    for (int m = 0, n; m < own->images; m += n) {
        n = state->batch_limit && state->batch_limit < own->images - m ? state->batch_limit : own->images - m;
        const hada_range range = hada_range_of(width, block < 8 ? 1 : 8, (size_t)own->coarse.rows, (size_t)n);
        const size_t to = state->out_offset / (size_t)own->parts + (size_t)m * own->coarse.count;
        HADA_TRY(hada_launch_refine_crop(state->slot, HADA_PROGRAM_REFINE_DEFAULT, &range, err, .in = own->in.mem,
                                         .in_offset = (cl_ulong)m * (cl_ulong)own->channels * own->full.count,
                                         .in_shape = hada_spectrum_shape_of(&own->full), .out = state->out.mem,
                                         .out_offset = (cl_uint)to, .out_shape = hada_spectrum_shape_of(&own->coarse),
                                         .crop = crop));
    }
    return HADA_OK;
}

const check_op check_crop = {
    "refine_crop",
    "r rows, c columns, h and w of the coarse grid, m images, k channels, b columns of a block, p parts (2 complex, 1 "
    "real), a tapers, i1 inverted",
    prepare, launch, NULL};
