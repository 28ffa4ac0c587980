/* Scenes that stand at several depths, for test frames. Internal. */
#ifndef HADA_TASKS_TEST_SCENE_H
#define HADA_TASKS_TEST_SCENE_H

#include <hadalens/scene.h>
#include <hadalens/simulate.h>

#include "tasks/scene_source.h"

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

/* One picture in regions that stand at `count` depths; or, with `occlude`, a whole picture at the farthest of them and
 * opaque pieces of others (numbers `number` + `step`, `number` + 2 step, ...) before it. */
hada_status hada_test_scene_make(hada_test_scene *scene, const hada_scenes *source, int number, int step,
                                 const hada_camera *camera, int count, int occlude, uint64_t seed, hada_error *err);
void hada_test_scene_free(hada_test_scene *scene);

hada_status hada_test_scene_render(const hada_test_scene *scene, hada_simulator *simulator, double noise, uint64_t seed,
                                   hada_image *raw, hada_error *err);

#endif
