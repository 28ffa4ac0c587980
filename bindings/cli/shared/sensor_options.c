#include "shared.h"

#include <hadalens/tiff.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define AT(member) HADA_CLI_AT(hada_cli_sensor_settings, member)
const hada_cli_option hada_cli_sensor_options[] = {
    HADA_CLI_GROUP("The sensor"),
    {HADA_OPTION_REAL, "noise", 0, "SIGMA", "noise, as a share of a frame's maximum (default: 0.01)",
     "Gaussian, the same for bright and dark pixels; 0.01 unless the sensor's own noise is asked for below.",
     AT(noise)},
    {HADA_OPTION_REAL, "full-well", 0, "ELECTRONS", "count light in electrons: shot noise, saturation", NULL,
     AT(full_well)},
    {HADA_OPTION_REAL, "read-noise", 0, "ELECTRONS", "read noise (standard deviation)",
     "Without --full-well as a share of the full scale.", AT(read_noise)},
    {HADA_OPTION_REAL, "dark", 0, "LEVEL", "what a dark pixel reads, as a share of the full scale", NULL, AT(dark)},
    {HADA_OPTION_COUNT, "adc-bits", 0, "N", "round to the levels of a converter with N bits, 1 to 16", NULL,
     AT(adc_bits)},
    {HADA_OPTION_REAL, "exposure", 0, "E", "share of the full scale that light of 1 makes",
     "Where the sensor's model is used, by default that with which a white scene reaches 0.9 at its brightest.",
     AT(exposure)},
    {HADA_OPTION_TEXT, "vignetting", 0, "none|cos4|FILE", "darker towards the corners",
     "By the fourth power of the cosine of the angle at which the mask's middle is seen, or times a TIFF picture.",
     AT(vignetting)},
    {HADA_OPTION_TEXT, "shift", 0, "ROWS,COLS", "pixels that the sensor stands off the optical axis, such as -20,35",
     NULL, AT(shift)},
    {HADA_OPTION_SIZE, "field", 0, "HxW", "scenes larger than the window: light from beyond it enters the frame",
     "What is written as a scene is its part in the window. Larger than the sensor with --boundary padded only.",
     AT(field)},
    {HADA_OPTION_FLAG, "occlude", 0, NULL, "test scenes of opaque objects before a whole picture",
     "Each lens sees past them from its own place. Without it the objects of a test scene stand side by side.",
     AT(occlude)},
    {0},
};

void hada_cli_sensor_defaults(hada_cli_sensor_settings *set)
{
    hada_cli_camera_defaults(&set->camera);
    set->noise = set->exposure = set->full_well = set->read_noise = set->dark = NAN; /* not given */
}

static int given(double value)
{
    return !isnan(value);
}

static hada_status read_shift(const char *text, hada_simulator_options *options, hada_error *err)
{
    double value[2];
    const char *comma = strchr(text, ',');
    char *rows = comma ? strndup(text, (size_t)(comma - text)) : NULL;
    const int good = rows && hada_cli_read_real(rows, &value[0]) && hada_cli_read_real(comma + 1, &value[1]) &&
                     value[0] == (int)value[0] && value[1] == (int)value[1];
    free(rows);
    if (!good)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--shift takes whole rows and columns such as -20,35, not '%s'",
                              text);
    options->shift_rows = (int)value[0];
    options->shift_cols = (int)value[1];
    return HADA_OK;
}

static hada_status read_vignetting(const char *text, hada_cli_sensor *sensor, hada_error *err)
{
    if (!strcmp(text, "none"))
        return HADA_OK;
    if (!strcmp(text, "cos4")) {
        sensor->sensor.vignetting = HADA_VIGNETTING_COS4;
        return HADA_OK;
    }
    hada_status status = hada_tiff_load(text, 0, &sensor->gain, err);
    sensor->sensor.vignetting = HADA_VIGNETTING_IMAGE;
    sensor->sensor.gain = &sensor->gain;
    return status;
}

hada_status hada_cli_make_sensor(hada_cli_sensor *out, const hada_cli_sensor_settings *set, hada_error *err)
{
    memset(out, 0, sizeof *out);
    hada_simulator_options_init(&out->options);
    hada_sensor_init(&out->sensor);
    out->occlude = set->occlude;
    out->options.field_rows = set->field[0];
    out->options.field_cols = set->field[1];
    out->used = given(set->full_well) || given(set->read_noise) || given(set->dark) || given(set->exposure) ||
                set->adc_bits || set->vignetting;
    const int own_noise = set->full_well > 0 || set->read_noise > 0;
    if (own_noise && given(set->noise))
        return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                              "--noise and --full-well or --read-noise are two kinds of noise; choose one");
    out->noise = given(set->noise) ? set->noise : own_noise ? 0.0 : 0.01;
    out->auto_exposure = !given(set->exposure);
    if (given(set->exposure))
        out->sensor.exposure = set->exposure;
    if (given(set->full_well))
        out->sensor.full_well = set->full_well;
    if (given(set->read_noise))
        out->sensor.read_noise = set->read_noise;
    if (given(set->dark))
        out->sensor.dark_level = set->dark;
    out->sensor.bits = set->adc_bits;
    if (set->shift)
        HADA_TRY(read_shift(set->shift, &out->options, err));
    if (set->vignetting)
        HADA_TRY(read_vignetting(set->vignetting, out, err));
    return hada_sensor_check(&out->sensor, err);
}

void hada_cli_sensor_free(hada_cli_sensor *sensor)
{
    hada_image_destroy(&sensor->gain);
}
