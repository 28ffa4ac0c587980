/* A small camera and what tests of the forward model need. */
#ifndef TESTS_FORWARD_FIXTURE_H
#define TESTS_FORWARD_FIXTURE_H

#include "device_fixture.h"

enum { ROWS = 60, COLS = 72, PIXELS = ROWS * COLS, HIGH = 24, WIDE = 26, LENSES = 7 };

static inline hada_camera small_camera(hada_boundary boundary)
{
    hada_camera camera = {.size = sizeof camera};
    ASSERT_OK(hada_camera_preset(&camera, "sim300", err));
    ASSERT_OK(hada_camera_resize(&camera, ROWS, COLS, HIGH, WIDE, err));
    camera.boundary = boundary;
    camera.lenses = LENSES;
    return camera;
}

static inline hada_simulator *simulator_of(const hada_camera *camera, int shift_rows, int shift_cols, int field_rows,
                                           int field_cols)
{
    hada_simulator *simulator;
    DEFAULTS(hada_simulator_options, options);
    options.shift_rows = shift_rows;
    options.shift_cols = shift_cols;
    options.field_rows = field_rows;
    options.field_cols = field_cols;
    ASSERT_OK(hada_simulator_create(&simulator, context, camera, &options, err));
    return simulator;
}

static inline hada_image drawn(uint64_t seed, int channels, int rows, int cols)
{
    hada_image image;
    ASSERT_OK(hada_scene_procedural(&image, seed, channels, rows, cols, err));
    return image;
}

#endif
