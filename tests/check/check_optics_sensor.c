/* A sensor's model. Without noise (a shape without f and r) values are such that exposure, vignetting, dark level and
 * rounding are exact but for the last division: 1e-7. With noise, a number that stands on the edge of two counts may
 * round the other way in single precision: about one in a million of those that are drawn exactly, and one count more
 * or less. */
#include "check.h"
#include "optics/simulator.h"
#include "ref/ref_sensor.h"

typedef struct sensor_state {
    hada_buffer light, gain;
    hada_sensor sensor;
    size_t pixels;
} sensor_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    sensor_state *own = check_own(state, sizeof *own);
    own->pixels = (size_t)check_get(state, 'n', 8);
    hada_sensor_init(&own->sensor);
    own->sensor.exposure = 0.25;
    own->sensor.full_well = check_get(state, 'f', 0);
    own->sensor.read_noise = check_get(state, 'r', 0);
    if (own->sensor.full_well == 0.0)
        own->sensor.read_noise /= 64.0;
    own->sensor.dark_level = check_get(state, 'd', 0) / 64.0;
    own->sensor.bits = check_get(state, 'b', 0);
    own->sensor.saturate = check_get(state, 's', 1);
    const size_t count = own->pixels * (size_t)check_get(state, 'k', 1);
    const int vignetted = check_get(state, 'v', 0), noisy = own->sensor.full_well > 0.0 || own->sensor.read_noise > 0.0;
    float *light = check_room(state, count * sizeof *light), *gain = check_room(state, own->pixels * sizeof *gain);
    HADA_TRY(check_output(state, count, err));
    check_fill_integers(state, 1, light, count, 99);
    check_fill_integers(state, 2, gain, own->pixels, 4);
    for (size_t i = 0; i < count; i++)
        light[i] /= 16.0f;
    for (size_t i = 0; i < own->pixels; i++)
        gain[i] = (4.0f + gain[i]) / 8.0f;
    for (size_t i = 0; i < count; i++)
        state->expected[i] =
            hada_ref_sensor(&own->sensor, state->seed, i, vignetted ? gain[i % own->pixels] : 1.0, light[i]);
    HADA_TRY(check_upload(state, &own->light, light, count * sizeof *light, err));
    if (vignetted)
        HADA_TRY(check_upload(state, &own->gain, gain, own->pixels * sizeof *gain, err));
    state->tolerance = noisy ? 1e-4 : own->sensor.bits ? 1e-7 : 0.0;
    state->bytes = 8.0 * (double)count;
    state->flops = 150.0 * (double)count;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    sensor_state *own = state->own;
    const cl_int code = clEnqueueCopyBuffer(state->slot->queue, own->light.mem, state->out.mem, 0,
                                            state->out_offset * sizeof(float), own->light.bytes, 0, NULL, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    return hada_optics_expose(state->slot, state->out.mem, state->out_offset, own->gain.mem, own->pixels,
                              state->out_count, &own->sensor, state->seed, err);
}

const check_op check_sensor = {"optics_sensor",
                               "n pixels, k channels, v1 vignetting, f electrons of a full well, r read noise (in "
                               "electrons, 64ths of full scale without f), d 64ths of dark level, b bits, s0 unbounded",
                               prepare, launch, NULL};
