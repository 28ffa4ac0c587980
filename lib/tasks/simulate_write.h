/* Writing a simulated data set. Internal. */
#ifndef HADA_TASKS_SIMULATE_WRITE_H
#define HADA_TASKS_SIMULATE_WRITE_H

#include <hadalens/task_simulate.h>

#include "core/callers.h"
#include "tasks/scene_source.h"
#include "tasks/test_surface.h"

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

/* All files, into an empty folder. Steps the progress once per frame. */
hada_status hada_recipe_write(hada_recipe *recipe, const char *folder, hada_error *err);

#endif
