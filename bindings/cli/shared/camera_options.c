/* The options that describe a camera, and those that say how its frames come about. */
#include <hadalens/tiff.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shared.h"

#define OF(member) HADA_CLI_AT(hada_cli_sensor_settings, member)
const hada_cli_option hada_cli_sensor_options[] = {
    HADA_CLI_GROUP("The sensor"),
    {HADA_OPTION_REAL, "noise", 0, "SIGMA", "noise, as a share of a frame's maximum (default: 0.01)",
     "Gaussian, the same for bright and dark pixels; 0.01 unless the sensor's own noise is asked for below.",
     OF(noise)},
    {HADA_OPTION_REAL, "full-well", 0, "ELECTRONS", "count light in electrons: shot noise, saturation", NULL,
     OF(full_well)},
    {HADA_OPTION_REAL, "read-noise", 0, "ELECTRONS", "read noise (standard deviation)",
     "Without --full-well as a share of the full scale.", OF(read_noise)},
    {HADA_OPTION_REAL, "dark", 0, "LEVEL", "what a dark pixel reads, as a share of the full scale", NULL, OF(dark)},
    {HADA_OPTION_COUNT, "adc-bits", 0, "N", "round to the levels of a converter with N bits, 1 to 16", NULL,
     OF(adc_bits)},
    {HADA_OPTION_REAL, "exposure", 0, "E", "share of the full scale that light of 1 makes",
     "Where the sensor's model is used, by default that with which a white scene reaches 0.9 at its brightest.",
     OF(exposure)},
    {HADA_OPTION_TEXT, "vignetting", 0, "none|cos4|FILE", "darker towards the corners",
     "By the fourth power of the cosine of the angle at which the mask's middle is seen, or times a TIFF picture.",
     OF(vignetting)},
    {HADA_OPTION_TEXT, "shift", 0, "ROWS,COLS", "pixels that the sensor stands off the optical axis, such as -20,35",
     NULL, OF(shift)},
    {HADA_OPTION_SIZE, "field", 0, "HxW", "scenes larger than the window: light from beyond it enters the frame",
     "What is written as a scene is its part in the window. Larger than the sensor with --boundary padded only.",
     OF(field)},
    {HADA_OPTION_FLAG, "occlude", 0, NULL, "test scenes of opaque objects before a whole picture",
     "Each lens sees past them from its own place. Without it the objects of a test scene stand side by side.",
     OF(occlude)},
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

#define MASKS "mla|grid|diffuser|contour|aperture"

#define AT(member)          HADA_CLI_AT(hada_cli_camera_settings, member)
#define ONE_OF(member, ...) HADA_CLI_ONE_OF(hada_cli_camera_settings, member, __VA_ARGS__)
const hada_cli_option hada_cli_camera_options[] = {
    HADA_CLI_GROUP("The camera"),
    {HADA_OPTION_TEXT, "preset", 0, "NAME", "camera to begin with (default: sim512)",
     "sim300: 300x400, 4 depths; crop300: the same size, 14 depths, a sensor that loses light; sim512: 512x512, 14 depths; paper2022: 1376x2064, 14 depths. All see colour and 100 "
     "to 600 mm.",
     AT(preset)},
    {HADA_OPTION_TEXT, "camera", 0, "FILE", "camera.json to begin with, instead of a preset", NULL, AT(file)},
    {HADA_OPTION_SIZE, "size", 0, "HxW", "pixels of the sensor, rows first",
     "The sensor keeps its length in millimetres, so the pixels change.", AT(size)},
    {HADA_OPTION_SIZE, "window", 0, "HxW", "field of view: pixels of the scene", NULL, AT(window)},
    {HADA_OPTION_CHOICE, "channels", 0, "1|3", "1 for grey, 3 for colour", NULL, ONE_OF(channels, 1, 3)},
    {HADA_OPTION_COUNT, "depths", 0, "N", "number of distances, equal steps in 1/distance", NULL, AT(depths)},
    {HADA_OPTION_REAL, "near", 0, "MM", "nearest distance", NULL, AT(near_mm)},
    {HADA_OPTION_REAL, "far", 0, "MM", "farthest distance", NULL, AT(far_mm)},
    {HADA_OPTION_CHOICE, "boundary", 0, "circular|padded", "light beyond the sensor comes back in, or is lost",
     "circular is the simplest model; padded is what a real sensor does. 'fit' reads the choice from camera.json.",
     ONE_OF(boundary, HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED)},
    {HADA_OPTION_CHOICE, "optics", 0, "geometry|wave", "how the camera's response to a point is made",
     "geometry (the preset's): rays, the same for all colours. wave: Fresnel diffraction, each colour by itself.",
     ONE_OF(optics, HADA_OPTICS_GEOMETRY, HADA_OPTICS_WAVE)},
    {HADA_OPTION_TEXT, "wavelengths", 0, "R,G,B", "wavelengths in nanometres, for wave optics (default: 610,530,460)",
     NULL, AT(wavelengths)},
    {HADA_OPTION_SEED, "seed", 0, "N", "seed of all that is drawn at random; the same seed gives the same files", NULL,
     AT(seed)},

    HADA_CLI_GROUP("The mask"),
    {HADA_OPTION_CHOICE, "mask", 0, MASKS, "kind of mask (default: mla)",
     "mla: microlenses at random places; grid: microlenses in rows and columns; diffuser: a smooth random surface; "
     "contour: a phase mask that draws the contour lines of a random landscape; aperture: holes in an opaque plate. "
     "Another kind than the preset's takes dimensions that suit the camera.",
     ONE_OF(mask, HADA_MASK_MLA, HADA_MASK_GRID, HADA_MASK_DIFFUSER, HADA_MASK_CONTOUR, HADA_MASK_APERTURE)},
    {HADA_OPTION_COUNT, "lenses", 0, "N", "number of lenses or round holes", NULL, AT(lenses)},
    {HADA_OPTION_REAL, "lens-diameter", 0, "MM", "diameter of lenses or holes, width of contour strips", NULL,
     AT(diameter_mm)},
    {HADA_OPTION_REAL, "fill", 0, "SHARE", "share of the aperture that is open; sets the diameter", NULL, AT(fill)},
    {HADA_OPTION_REAL, "spacing", 0, "MM", "least distance of lens centres; grid: the period", NULL, AT(spacing_mm)},
    {HADA_OPTION_REAL, "max-spacing", 0, "MM", "greatest distance to the nearest of the other lenses", NULL,
     AT(most_spacing_mm)},
    {HADA_OPTION_REAL, "aperture", 0, "MM", "diameter of the round aperture", NULL, AT(aperture_mm)},
    {HADA_OPTION_REAL, "distance", 0, "MM", "from the mask to the sensor", NULL, AT(distance_mm)},
    {HADA_OPTION_REAL, "pitch", 0, "MM", "of the sensor's pixels", NULL, AT(pitch_mm)},
    {HADA_OPTION_REAL, "focal-length", 0, "MM", "of the lenses, at 587.6 nm", NULL, AT(focal_length_mm)},
    {HADA_OPTION_REAL, "curvature", 0, "MM", "radius of curvature; sets the focal length R / (n - 1)", NULL,
     AT(curvature_mm)},
    {HADA_OPTION_REAL, "index", 0, "N", "refractive index at 587.6 nm (default: 1.43)", NULL, AT(index)},
    {HADA_OPTION_REAL, "abbe", 0, "V", "Abbe number (default: 50); 0: the same index for all colours", NULL, AT(abbe)},
    {HADA_OPTION_REAL, "correlation", 0, "MM", "diffuser, contour: correlation length of the random surface", NULL,
     AT(correlation_mm)},
    {HADA_OPTION_REAL, "deflection", 0, "MRAD", "diffuser: rms angle that rays are turned by, along each axis", NULL,
     AT(deflection_mrad)},
    {HADA_OPTION_REAL, "cell", 0, "MM", "aperture: random square cells of this side instead of round holes", NULL,
     AT(cell_mm)},
    {HADA_OPTION_REAL, "open", 0, "SHARE", "aperture: share of the cells that are open (default: 0.5)", NULL,
     AT(open_fraction)},
    {0},
};

void hada_cli_camera_defaults(hada_cli_camera_settings *set)
{
    double *unset[] = {&set->near_mm,      &set->far_mm,         &set->pitch_mm,        &set->distance_mm,
                       &set->aperture_mm,  &set->spacing_mm,     &set->most_spacing_mm, &set->diameter_mm,
                       &set->fill,         &set->curvature_mm,   &set->focal_length_mm, &set->index,
                       &set->abbe,         &set->correlation_mm, &set->deflection_mrad, &set->cell_mm,
                       &set->open_fraction};
    for (size_t i = 0; i < sizeof unset / sizeof *unset; i++)
        *unset[i] = -1;
    set->depths = set->lenses = set->optics = -1;
    set->seed = UINT64_MAX;
}

static hada_status begin(hada_camera *camera, const hada_cli_camera_settings *set, hada_error *err)
{
    if (set->file && set->preset)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                              "a camera begins with --camera or with --preset, not with both");
    if (set->file)
        return hada_camera_load(camera, set->file, err);
    return hada_camera_preset(camera, set->preset ? set->preset : "sim512", err);
}

/* "610,530,460" */
static hada_status read_wavelengths(const char *text, double nm[3], hada_error *err)
{
    int end = 0;
    return sscanf(text, "%lf,%lf,%lf%n", &nm[0], &nm[1], &nm[2], &end) == 3 && !text[end]
               ? HADA_OK
               : hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                "--wavelengths takes three numbers for red, green and blue, such as 610,530,460");
}

static hada_status set_depths(hada_camera *camera, const hada_cli_camera_settings *set, hada_error *err)
{
    if (set->depths < 0 && set->near_mm < 0 && set->far_mm < 0)
        return HADA_OK;
    return hada_camera_set_depths(camera, set->near_mm >= 0 ? set->near_mm : camera->distances_mm[0],
                                  set->far_mm >= 0 ? set->far_mm : camera->distances_mm[camera->depths - 1],
                                  set->depths >= 0 ? set->depths : camera->depths, err);
}

static hada_status set_sensor(hada_camera *camera, const hada_cli_camera_settings *set, hada_error *err)
{
    if (set->size[0])
        HADA_TRY(hada_camera_resize(camera, set->size[0], set->size[1], set->window[0], set->window[1], err));
    if (set->window[0]) {
        camera->window_rows = set->window[0];
        camera->window_cols = set->window[1];
    }
    if (set->channels)
        camera->channels = set->channels;
    if (set->seed != UINT64_MAX)
        camera->seed = set->seed;
    if (set->boundary)
        camera->boundary = (hada_boundary)set->boundary;
    if (set->optics >= 0)
        camera->optics = (hada_optics)set->optics;
    HADA_TRY(set_depths(camera, set, err));
    if (set->wavelengths)
        HADA_TRY(read_wavelengths(set->wavelengths, camera->wavelengths_nm, err));
    return HADA_OK;
}

/* What is not negative was given. */
static void take(double *to, double given)
{
    if (given >= 0)
        *to = given;
}

static hada_status set_mask(hada_camera *camera, const hada_cli_camera_settings *set, hada_error *err)
{
    if (set->lenses >= 0)
        camera->lenses = set->lenses;
    /* the frame of a mask, before the dimensions that suit it */
    take(&camera->pixel_pitch_mm, set->pitch_mm);
    take(&camera->distance_mm, set->distance_mm);
    take(&camera->aperture_mm, set->aperture_mm);
    take(&camera->refractive_index, set->index);
    take(&camera->abbe_number, set->abbe);
    if (set->mask)
        HADA_TRY(hada_camera_set_mask(camera, (hada_mask)set->mask, err));
    take(&camera->minimum_spacing_mm, set->spacing_mm);
    take(&camera->maximum_spacing_mm, set->most_spacing_mm);
    take(&camera->lens_diameter_mm, set->diameter_mm);
    take(&camera->focal_length_mm, set->focal_length_mm);
    if (set->curvature_mm >= 0)
        camera->focal_length_mm = set->curvature_mm / (camera->refractive_index - 1.0);
    take(&camera->correlation_mm, set->correlation_mm);
    take(&camera->deflection_mrad, set->deflection_mrad);
    take(&camera->cell_mm, set->cell_mm);
    take(&camera->open_fraction, set->open_fraction);
    if (set->fill >= 0)
        HADA_TRY(hada_camera_set_fill_factor(camera, set->fill, err));
    return HADA_OK;
}

hada_status hada_cli_make_camera(hada_camera *camera, const hada_cli_camera_settings *set, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(begin(camera, set, err));
    HADA_TRY_OR_DONE(set_sensor(camera, set, err));
    HADA_TRY_OR_DONE(set_mask(camera, set, err));
    HADA_TRY_OR_DONE(hada_camera_check(camera, err));
done: /* sizes that do not fit are the command line's here, not a file's */
    return status == HADA_ERROR_SIZE ? (err->status = HADA_ERROR_ARGUMENT) : status;
}
