/* Hadalens: the data set of a camera that exists only by design, as the command 'simulate' writes it.
 *
 * FOLDER/z<distance>mm/raw/NAME.tif (frames) and scene/NAME.tif (the window of what was shown) as hadalens/dataset.h
 * reads them; psf.tif (a page per depth, in the frames' units), camera.json and, where the sensor is special,
 * sensor.json; test/raw/NAME.tif with their truth test/truth/NAME_stack.tif, NAME_aif.tif and NAME_depth.tif, as
 * hadalens/task_reconstruct.h names results. Of surfaces, NAME ends with the kind, the stack has the light of a pixel
 * in the two planes nearest to it, and NAME_depth2.tif says where a second surface is seen through the first.
 * Everything that is drawn at random comes from the camera's seed.
 *
 * Threads: a run uses the calling thread; several may run at once on contexts of their own. */
#ifndef HADALENS_TASK_SIMULATE_H
#define HADALENS_TASK_SIMULATE_H

#include <hadalens/monitor.h>
#include <hadalens/response.h>
#include <hadalens/simulate.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The files of raw frames. */
typedef enum hada_simulate_raw {
    HADA_SIMULATE_RAW_TIFF = 0,  /* NAME.tif */
    HADA_SIMULATE_RAW_DNG = 1,   /* NAME.dng, as digital cameras write it: one channel, 16 bits, the dark level as black
                                    level */
    HADA_SIMULATE_RAW_NUMPY = 2, /* NAME.npy */
    HADA_SIMULATE_RAW_PACKED12 = 3 /* NAME.raw, as a Raspberry Pi writes it: one channel, 12 bits packed as MIPI CSI-2
                                      has it, no header (hadalens/headerless.h) */
} hada_simulate_raw;

typedef struct hada_simulate_task {
    size_t size;             /* sizeof(hada_simulate_task) */
    const char *scenes;      /* a folder of TIFF pictures of any size, cut and scaled to the window; NULL (default):
                                coloured shapes are drawn */
    const char *test_scenes; /* for the test frames; NULL (default): taken from the end of `scenes`, and not used for
                                pairs where there are enough */
    int pairs;               /* per depth; 8 by default. Fewer where `scenes` holds fewer */
    int tests;               /* test frames, whose scene stands at several depths; 0 by default */
    int test_depths;         /* depths that a test frame occupies; 2 by default */
    int occlude;             /* 1: test scenes of opaque objects before a whole picture; 0 (default): side by side */
    int bits;                /* of frames and scenes: 32 (default, float) or 16 */

    const hada_simulator_options *simulator; /* where the sensor stands, what it sees; NULL: as the camera has it */
    double noise;                            /* Gaussian, as a share of a frame's maximum; 0.01 by default */
    const hada_sensor *sensor;               /* what it makes of light; NULL (default): the light itself */
    double white; /* with a sensor: its exposure is that with which a white scene reaches this share of the full scale;
                     0 (default): sensor->exposure */
    const hada_monitor *monitor;

    /* Test scenes on surfaces, every pixel at its own distance: kinds by their words, separated by commas, in turn:
     * "slant", "half", "hill", "ball", "steps", "bars" (hada_relief_kind); "outside", a slant beyond the nearest and
     * the farthest depth; "overlap", two see-through pictures one behind the other; or files, which hold distances in
     * millimetres (floats; NaN: nothing there) or shares of the range of depths (integers, linear in 1/z), cut and
     * scaled to the window. `occlude`: opaque ones. `tests` 0: one of each. NULL (default): planes */
    const char *surfaces;

    /* How the pictures stand for light, which is what reaches the sensor; scenes and truth are written as the pictures
     * are. A response of hadalens/response.h, HADA_RESPONSE_LINEAR by default */
    double scene_response;

    hada_mosaic mosaic;    /* the sensor has a colour filter mosaic of this pattern, and frames have one channel; the
                              camera has three. HADA_MOSAIC_NONE by default */
    hada_simulate_raw raw; /* HADA_SIMULATE_RAW_TIFF by default. DNG and PACKED12 need frames of one channel */
    int field_psfs; /* with simulator->field_varying: PSFs of so many by so many points over the window are written, a
                       page per depth, with their list field/positions.csv; 5 by default, 0: none */
} hada_simulate_task;
HADA_INIT(hada_simulate_task, HADA_STRUCT_SIMULATE_TASK)

/* What was written in the end. */
typedef struct hada_simulate_report {
    size_t size;     /* sizeof(hada_simulate_report), set by the caller */
    int pairs;       /* per depth */
    int test_depths; /* of each test frame */
    double exposure; /* of the sensor; NaN without one */
    int tests;
    double light_lost; /* share of a white window's light that misses the sensor; mean of the depths */
} hada_simulate_report;

/* Writes the data set into a folder that is not there yet, or empty; it appears whole or not at all. `task` and
 * `report` may be NULL. */
HADA_API hada_status hada_simulate_run(hada_context *context, const hada_camera *camera, const char *folder,
                                       const hada_simulate_task *task, hada_simulate_report *report, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
