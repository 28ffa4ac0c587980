/* Test scenes and where they come from: a folder of TIFF pictures, or drawn from a seed. Internal. */
#ifndef HADA_TASKS_SIMULATED_SCENES_H
#define HADA_TASKS_SIMULATED_SCENES_H

#include <hadalens/image.h>
#include <hadalens/scene.h>
#include <hadalens/simulate.h>
#include <hadalens/task_simulate.h>

#include "core/callers.h"

typedef struct hada_scenes {
    const char *folder; /* the caller's; NULL: drawn */
    char **names;
    int count; /* of pictures in the folder; as many as asked for where they are drawn */
    uint64_t seed;
    int channels, rows, cols;
    double response; /* of the pictures (hadalens/response.h) */
} hada_scenes;

/* Pictures are cut to the aspect ratio and scaled to rows x cols; they are linear until `response` says otherwise. */
hada_status hada_scenes_open(hada_scenes *scenes, const char *folder, uint64_t seed, int channels, int rows, int cols,
                             hada_error *err);
void hada_scenes_close(hada_scenes *scenes);

/* The light of scene number `index`; *name (may be NULL) is a file name without ending, on the heap. */
hada_status hada_scenes_get(const hada_scenes *scenes, int index, hada_image *image, char **name, hada_error *err);

/* Scenes at several depths, for test frames. Internal. */

/* All images have the size of the scenes that they are made from. */
typedef struct hada_test_scene {
    int count;           /* of occupied depths */
    int *depths;         /* near to far */
    hada_image *planes;  /* one per occupied depth */
    hada_image *opacity; /* the same, the farthest empty; NULL: nothing hides anything */
    hada_image whole;    /* what the middle of the mask sees, everything in focus */
    hada_image map;      /* and its distances, mm */

    int surfaces; /* 0: planes as above. Else light[0] at `map` and, of 2, light[1] at `over`; the planes are their
                     truth alone */
    int opaque;   /* they hide what is behind */
    hada_image light[2];
    hada_image over; /* NaN where the second is not */
} hada_test_scene;

/* One picture in regions at `count` depths; or, with `occlude`, a whole picture at the farthest of them and
 * opaque pieces of others (numbers `number` + `step`, `number` + 2 step, ...) before it. */
hada_status hada_test_scene_make(hada_test_scene *scene, const hada_scenes *source, int number, int step,
                                 const hada_camera *camera, int count, int occlude, uint64_t seed, hada_error *err);
void hada_test_scene_free(hada_test_scene *scene);

hada_status hada_test_scene_render(const hada_test_scene *scene, hada_simulator *simulator, double noise, uint64_t seed,
                                   hada_image *raw, hada_error *err);

/* Test scenes on surfaces: which kinds there are, and their making. Internal. */

/* The words of "slant,map.tif,...": kinds, and files of distance maps. */
typedef struct hada_surface_words {
    char **words;
    int count;
} hada_surface_words;

/* HADA_ERROR_ARGUMENT where a word is neither a kind nor a file. */
hada_status hada_surface_words_read(hada_surface_words *words, const char *list, hada_error *err);
void hada_surface_words_free(hada_surface_words *words);

/* The kind's word, "surface" for a file. */
const char *hada_surface_name(const hada_surface_words *words, int test);

/* Test scene number `test`: pictures `number` and, where two surfaces overlap, `number` + `step` of the source. The
 * first scene of each kind has its plain shape. scene->planes, one for each of the camera's depths, hold the light
 * shared out to the two depths nearest to each pixel. Ended by hada_test_scene_free(). */
hada_status hada_test_surface_make(hada_test_scene *scene, const hada_surface_words *words, int test,
                                   const hada_scenes *source, int number, int step, const hada_camera *camera,
                                   int opaque, uint64_t seed, hada_error *err);

/* Writing a simulated data set. Internal. */

/* What is to be written, and with what. */
typedef struct hada_recipe {
    hada_camera camera;
    hada_context *context;
    hada_simulate_task task; /* with the pairs and depths that there are */
    hada_simulator_options simulator_options;
    hada_sensor sensor;
    int has_sensor;
    hada_simulator *simulator;
    hada_scenes scenes;
    int training_count;          /* scenes that pairs may use; the rest is for test frames */
    hada_scenes test_scenes;     /* where they are not those of the pairs */
    hada_surface_words surfaces; /* of the tests; none: planes */
    double light_lost;
    hada_progress progress;
} hada_recipe;

#endif
