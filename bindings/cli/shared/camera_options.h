/* The options that describe a camera, shared by the commands that design one. */
#ifndef HADA_CLI_CAMERA_OPTIONS_H
#define HADA_CLI_CAMERA_OPTIONS_H

#include "option.h"

#include <hadalens/camera.h>

/* The settings of a command with `designs_camera` begin with this. */
typedef struct hada_cli_camera_settings {
    hada_cli_common common;
    const char *preset, *file, *wavelengths;
    int mask, boundary, channels, optics;
    int size[2], window[2];
    int depths, lenses;
    double near_mm, far_mm;
    double pitch_mm, distance_mm, aperture_mm;
    double spacing_mm, most_spacing_mm, diameter_mm, fill;
    double focal_length_mm, curvature_mm, index, abbe;
    double correlation_mm, deflection_mrad, cell_mm, open_fraction;
    uint64_t seed;
} hada_cli_camera_settings;

/* What the members hold when no option is given. */
void hada_cli_camera_defaults(hada_cli_camera_settings *set);

/* The camera that the options describe, checked. */
hada_status hada_cli_make_camera(hada_camera *camera, const hada_cli_camera_settings *set, hada_error *err);

#endif
