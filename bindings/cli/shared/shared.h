/* Options and words of several commands: the camera, a frame, the dark level, the placement of scenes. */
#ifndef HADA_CLI_SHARED_H
#define HADA_CLI_SHARED_H

#include <hadalens/camera.h>
#include <hadalens/reconstruct.h>
#include <hadalens/simulate.h>
#include <hadalens/task_register.h>

#include "cli.h"
#include "option.h"

/* The options that describe a camera, shared by the commands that design one. */

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

/* The options that describe how a frame is recorded: the camera, its sensor and the scene. */

/* The settings of a command with `records_frames` begin with this. */
typedef struct hada_cli_sensor_settings {
    hada_cli_camera_settings camera;
    const char *shift, *vignetting;
    int field[2];
    int occlude, adc_bits;
    double noise, exposure, full_well, read_noise, dark;
} hada_cli_sensor_settings;

/* What the options mean. */
typedef struct hada_cli_sensor {
    hada_simulator_options options; /* shift and field */
    int occlude;
    double noise;      /* Gaussian, of a frame's maximum; 0 where the sensor makes its own */
    int used;          /* 1: frames are what `sensor` makes of light */
    int auto_exposure; /* 1: sensor.exposure is not known before the simulator is asked */
    hada_sensor sensor;
    hada_image gain; /* of sensor.gain */
} hada_cli_sensor;

/* What the members hold when no option is given. */
void hada_cli_sensor_defaults(hada_cli_sensor_settings *set);

hada_status hada_cli_make_sensor(hada_cli_sensor *sensor, const hada_cli_sensor_settings *set, hada_error *err);
void hada_cli_sensor_free(hada_cli_sensor *sensor);

/* How bright a white scene is when nothing else is said: this share of full scale. */
#define HADA_CLI_WHITE 0.9

/* The dark level, as several commands take it. */

/* "none", "auto", a level or a file. */
typedef struct hada_cli_dark {
    hada_dark kind;
    double level;     /* 0 unless one was given */
    hada_image frame; /* mean of the file's pages */
} hada_cli_dark;
hada_status hada_cli_read_dark(hada_cli_dark *dark, const char *text, hada_error *err);
void hada_cli_dark_free(hada_cli_dark *dark);

/* The same as one number, negative for each frame's own; of a file 0, and *frame, created by the call. text NULL: both
 * stay. */
hada_status hada_cli_read_dark_level(double *level, hada_image *frame, const char *text, hada_error *err);

/* The flat frame of a file, above the level or the dark frame that --dark names (NULL: 0). path NULL: none. */
hada_status hada_cli_read_flat(hada_image *flat, const char *path, const char *dark, hada_error *err);

/* What `register` and `fit --register` print: how scenes are placed on the sensor. */

/* A line for each depth, warnings, and "depths" and "registered" in the document. */
void hada_cli_tell_registered(hada_cli *cli, const hada_dataset *data, const hada_register_report *report);

#endif
