/* The options that say how a frame comes about: where the sensor stands, what it sees, and what it makes of light. */
#ifndef HADA_CLI_SENSOR_OPTIONS_H
#define HADA_CLI_SENSOR_OPTIONS_H

#include "camera_options.h"

#include <hadalens/simulate.h>

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

#endif
