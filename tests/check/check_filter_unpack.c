/* Stored numbers to the floats that they mean: exact, every number of a full scale in the largest shape; and
 * samples with any strides, exact as well. */
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
    DEFAULTS(hada_pixels, pixels);
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

/* samples between others: the last channel is left out, and rows run up or down */
static hada_status prepare_strides(check_state *state, hada_error *err)
{
    unpack_state *own = check_own(state, sizeof *own);
    const int high = check_get(state, 'h', 3), wide = check_get(state, 'w', 5), channels = check_get(state, 'c', 3),
              bytes = check_get(state, 'b', 2), stored_channels = channels + 1, down = !check_get(state, 'r', 0);
    const size_t count = (size_t)channels * (size_t)high * (size_t)wide,
                 held = (size_t)stored_channels * (size_t)high * (size_t)wide;
    uint8_t *octets = check_room(state, held * (size_t)bytes);
    DEFAULTS(hada_pixels, pixels);
    hada_pixels_dense(&pixels, octets,
                      bytes == 1   ? HADA_PIXEL_U8
                      : bytes == 2 ? HADA_PIXEL_U16
                                   : HADA_PIXEL_F32,
                      !check_get(state, 'p', 0), stored_channels, high, wide);
    pixels.channels = channels;
    if (!down) {
        pixels.data = octets + pixels.row_stride * (high - 1);
        pixels.row_stride = -pixels.row_stride;
    }
    for (size_t i = 0; i < held; i++) {
        const unsigned number = (unsigned)i * 40503u + 7u;
        const uint16_t short_number = (uint16_t)number;
        const float value = (float)(number & 0xffffu) - 1024.5f;
        if (bytes == 1)
            octets[i] = (uint8_t)number;
        else
            memcpy(octets + i * (size_t)bytes, bytes == 2 ? (const void *)&short_number : &value, (size_t)bytes);
    }
    own->form = hada_pixels_stored(&pixels);
    HADA_TRY(check_output(state, count, err));
    HADA_TRY(check_region(state, 0, count, &own->out, err));
    double *expected = state->expected;
    for (int c = 0; c < channels; c++)
        for (int y = 0; y < high; y++)
            for (int x = 0; x < wide; x++) {
                const uint8_t *at = (const uint8_t *)pixels.data + c * pixels.channel_stride + y * pixels.row_stride +
                                    x * pixels.col_stride;
                uint16_t short_number;
                float value = (float)*at / 255.0f;
                memcpy(&short_number, at, bytes == 1 ? 1 : 2);
                if (bytes == 2)
                    value = (float)short_number / 65535.0f;
                else if (bytes == 4)
                    memcpy(&value, at, sizeof value);
                *expected++ = value;
            }
    HADA_TRY(check_upload(state, &own->stored, own->form.data, own->form.bytes, err));
    state->bytes = (4.0 + bytes) * (double)count;
    return HADA_OK;
}

const check_op check_gather = {"filter_gather",
                               "c channels h x w of b bytes (1, 2 or 4), beside one more; p1: planar, r1: rows upwards",
                               prepare_strides, launch, NULL};
