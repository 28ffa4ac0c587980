/* Writing a simulated data set. */
#ifndef HADA_CLI_DATASET_WRITE_H
#define HADA_CLI_DATASET_WRITE_H

#include "scene_source.h"
#include "sensor_options.h"

#include <hadalens/scene.h>
#include <hadalens/simulate.h>

typedef struct hada_cli_recipe {
    const char *folder; /* made by the caller */
    hada_cli_scenes scenes;
    hada_cli_sensor *sensor;
    int pairs; /* per depth */
    uint64_t seed;
    int bits;           /* of raw frames and scenes */
    int training_count; /* scenes that pairs may use; the rest is for test frames */
    int tests, test_depths;
    hada_cli_scenes test_scenes; /* where they are not those of the pairs */
    int other_test_scenes;
} hada_cli_recipe;

/* z<distance>mm/{raw,scene}/NAME.tif, psf.tif, camera.json and (where the sensor is special) sensor.json, and
 * test/{raw,truth} when asked for. Steps the progress bar once per frame. */
hada_status hada_cli_write_dataset(hada_cli *cli, hada_simulator *simulator, const hada_cli_recipe *recipe,
                                   hada_error *err);

#endif
