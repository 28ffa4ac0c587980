/* Stored numbers to the floats that they stand for: exact, every number of a full scale in the largest shape. */
#include "check.h"
#include "filter/hadamard.h"

typedef struct unpack_state {
    hada_stored form;
    hada_buffer stored;
    cl_mem out;
} unpack_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    unpack_state *own = check_own(state, sizeof *own);
    const int count = check_get(state, 'n', 8), bytes = check_get(state, 'b', 2), scale = check_get(state, 's', 65535);
    const unsigned numbers = bytes == 1 ? 256 : 65536;
    uint8_t *small = check_room(state, (size_t)count);
    uint16_t *wide = check_room(state, (size_t)count * sizeof *wide);
    hada_pixels pixels;
    hada_pixels_init(&pixels);
    hada_pixels_planar(&pixels, bytes == 1 ? (const void *)small : wide, bytes == 1 ? HADA_PIXEL_U8 : HADA_PIXEL_U16, 1,
                       1, count);
    pixels.full_scale = scale;
    own->form = hada_pixels_stored(&pixels);
    HADA_TRY(check_output(state, (size_t)count, err));
    HADA_TRY(check_region(state, 0, (size_t)count, &own->out, err));
    for (int i = 0; i < count; i++) {
        const unsigned number = (unsigned)i * 40503u % numbers; /* an odd factor: all of them, in some order */
        small[i] = (uint8_t)number;
        wide[i] = (uint16_t)number;
        state->expected[i] = (float)number / (float)scale;
    }
    HADA_TRY(check_upload(state, &own->stored, bytes == 1 ? (const void *)small : wide, (size_t)(count * bytes), err));
    state->bytes = (4.0 + bytes) * count;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const unpack_state *own = state->own;
    return hada_upload_unpack(state->slot, &own->form, own->stored.octets, own->out, err);
}

const check_op check_unpack = {"filter_unpack", "n numbers of b bytes (1 or 2), s their full scale", prepare, launch,
                               NULL};
