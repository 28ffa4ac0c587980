/* Constants and structs of the forward model, for kernels and host. */
#ifndef SHARED_OPTICS_H
#define SHARED_OPTICS_H

#include "shared_types.h"

/* A sensor (<hadalens/sensor.h>). */
typedef struct hada_optics_sensor {
    float exposure;
    float full_well; /* electrons; 0: no shot noise */
    float read_noise;
    float dark_level;
    float levels; /* 2^bits - 1; 0: values are not rounded */
    int saturate;
    int vignetted;
    unsigned int key0, key1; /* of the random numbers */
} hada_optics_sensor;
HADA_SHARED_SIZE(hada_optics_sensor, 36)

/* The weights by which one lens sees a plane past another: place and size. */
typedef struct hada_optics_taps {
    int row0, col0, rows, cols;
} hada_optics_taps;
HADA_SHARED_SIZE(hada_optics_taps, 16)

typedef struct hada_optics_image {
    int channels, rows, cols;
} hada_optics_image;
HADA_SHARED_SIZE(hada_optics_image, 12)

/* The field behind a lens: n x n values, rows `pitch` apart, `step` mm apart on the mask. */
typedef struct hada_optics_field {
    int n, pitch;
    float step;
    float radius, aperture; /* of the lens; of the mask */
} hada_optics_field;
HADA_SHARED_SIZE(hada_optics_field, 20)

/* A lens: its centre, and the first and number of the lines that bound its area. */
typedef struct hada_wave_lens {
    float x, y;
    int first, planes;
} hada_wave_lens;
HADA_SHARED_SIZE(hada_wave_lens, 16)

/* The samples of a line that fall on a pixel, both squares, each of its own size; a sample's light is shared by area.
 * Samples `first` to `first + count - 1`, the ends with their own weights (a single one: `begin`). */
typedef struct hada_wave_pixel {
    int first, count;
    float begin, end;
} hada_wave_pixel;
HADA_SHARED_SIZE(hada_wave_pixel, 16)

#endif
