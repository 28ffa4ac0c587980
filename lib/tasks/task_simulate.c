/* What a simulated data set is made of: scenes for pairs and tests, a simulator, a sensor. */

#include "core/callers.h"
#include "image/mosaic.h"
#include "io/folder.h"
#include "tasks/simulated_scenes.h"

static hada_status take_task(hada_recipe *recipe, const hada_camera *camera, const hada_simulate_task *callers,
                             hada_error *err)
{
    hada_simulate_task *task = &recipe->task;
    hada_sensor_init(&recipe->sensor);
    HADA_TRY(HADA_OPTIONS_TAKE(&recipe->camera, camera, hada_camera, err));
    HADA_TRY(HADA_OPTIONS_TAKE(task, callers, hada_simulate_task, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&recipe->simulator_options, task->simulator, hada_simulator_options, err));
    if (!recipe->simulator_options.monitor)
        recipe->simulator_options.monitor = task->monitor;
    HADA_TRY(HADA_OPTIONS_TAKE(&recipe->sensor, task->sensor, hada_sensor, err));
    recipe->has_sensor = task->sensor != NULL;
    if (task->pairs < 1 || task->test_depths < 1 || task->tests < 0)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "hada_simulate_run: a pair per depth and a depth per test frame are the least"));
    if (!hada_response_is_known(task->scene_response))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.scene_response: %g is no response; use linear, srgb, or "
                           "a power from %g to %g",
                           task->scene_response, HADA_RESPONSE_LEAST, HADA_RESPONSE_MOST));
    if (task->mosaic != HADA_MOSAIC_NONE &&
        (!hada_mosaic_is_pattern(task->mosaic) || recipe->camera.channels != HADA_MOSAIC_COLOURS))
        HADA_TRY(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "options.mosaic: a colour filter mosaic needs a pattern and a camera of three channels; this "
                      "one has %d",
                      recipe->camera.channels));
    if ((int)task->raw < HADA_SIMULATE_RAW_TIFF || task->raw > HADA_SIMULATE_RAW_PACKED12)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "there is no options.raw %d", (int)task->raw));
    if ((task->raw == HADA_SIMULATE_RAW_DNG || task->raw == HADA_SIMULATE_RAW_PACKED12) &&
        task->mosaic == HADA_MOSAIC_NONE && recipe->camera.channels > 1)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.raw: such files hold one value for each pixel of the sensor; give it a colour "
                           "filter mosaic (options.mosaic rggb), or take options.channels 1"));
    if (task->field_psfs && (task->field_psfs < 2 || task->field_psfs > 64))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "options.field_psfs is 2 to 64 a side, or 0 for none; not %d",
                           task->field_psfs));
    if (recipe->simulator_options.field_varying != 0.0 && (task->occlude || task->surfaces))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.field_varying is for test scenes of planes: leave options.occlude and "
                           "options.surfaces out"));
    if (task->test_depths > recipe->camera.depths)
        task->test_depths = recipe->camera.depths;
    if (task->surfaces) {
        if (recipe->camera.depths < 2)
            HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "options.surfaces: a camera of two depths is the least"));
        HADA_TRY(hada_surface_words_read(&recipe->surfaces, task->surfaces, err));
        task->tests = task->tests ? task->tests : recipe->surfaces.count;
    }
    return HADA_OK;
}

/* Opens the scenes and divides them between pairs and tests. */
static hada_status open_scenes(hada_recipe *recipe, hada_error *err)
{
    hada_simulate_task *task = &recipe->task;
    const hada_camera *camera = &recipe->camera;
    const hada_simulator_options *wanted = &recipe->simulator_options;
    const int rows = wanted->field_rows ? wanted->field_rows : camera->window_rows;
    const int cols = wanted->field_rows ? wanted->field_cols : camera->window_cols;
    HADA_TRY(hada_scenes_open(&recipe->scenes, task->scenes, camera->seed, camera->channels, rows, cols, err));
    if (task->test_scenes)
        HADA_TRY(hada_scenes_open(&recipe->test_scenes, task->test_scenes, camera->seed + 1, camera->channels, rows,
                                  cols, err));
    recipe->scenes.response = recipe->test_scenes.response = task->scene_response;
    const int count = recipe->scenes.count;
    recipe->training_count = count;
    if (task->tests && !task->test_scenes && task->scenes) {
        if (count >= task->pairs + task->tests)
            recipe->training_count = count - task->tests;
        else
            hada_monitor_tell(task->monitor, HADA_MESSAGE_NOTE,
                              "%s holds %d pictures, too few to keep some for the tests alone: the tests show scenes "
                              "that the pairs show too",
                              task->scenes, count);
    }
    if (recipe->training_count < task->pairs) {
        hada_monitor_tell(task->monitor, HADA_MESSAGE_NOTE, "%s holds %d pictures: %d pairs per depth instead of %d",
                          task->scenes, recipe->training_count, recipe->training_count, task->pairs);
        task->pairs = recipe->training_count;
    }
    return HADA_OK;
}

static hada_status make_simulator(hada_recipe *recipe, hada_error *err)
{
    const double white = recipe->task.white;
    hada_status status =
        hada_simulator_create(&recipe->simulator, recipe->context, &recipe->camera, &recipe->simulator_options, err);
    if (status == HADA_ERROR_SIZE) { /* a field that does not fit is an option's fault, not a file's */
        status = HADA_ERROR_ARGUMENT;
        if (err)
            err->status = status;
    }
    HADA_TRY(status);
    if (recipe->has_sensor && white > 0.0)
        HADA_TRY(hada_simulator_white_exposure(recipe->simulator, white, &recipe->sensor.exposure, err));
    return status;
}

/* The share of a white window's light that misses the sensor: all of a PSF sums to 1. */
static hada_status measure_loss(hada_recipe *recipe, hada_error *err)
{
    const hada_camera *camera = &recipe->camera;
    hada_image white = {0}, raw = {0};
    double caught = 0.0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(&white, 1, camera->window_rows, camera->window_cols, err));
    for (size_t i = 0; i < hada_image_count(&white); i++)
        white.data[i] = 1.0f;
    for (int z = 0; z < camera->depths; z++) {
        hada_image_destroy(&raw);
        HADA_TRY_OR_DONE(hada_simulator_render(recipe->simulator, &(hada_plane){z, &white}, 1, 0.0, 0, &raw, err));
        for (size_t i = 0; i < hada_image_count(&raw); i++)
            caught += (double)raw.data[i];
    }
    recipe->light_lost =
        fmax(0.0, 1.0 - caught / ((double)hada_image_count(&white) * camera->channels * camera->depths));
done:
    hada_image_destroy(&white);
    hada_image_destroy(&raw);
    return status;
}

static hada_status fill(void *user, const char *folder, hada_error *err)
{
    hada_recipe *recipe = user;
    const hada_simulate_task *task = &recipe->task;
    hada_status status = HADA_OK;
    HADA_TRY(open_scenes(recipe, err));
    HADA_TRY(make_simulator(recipe, err));
    HADA_TRY(measure_loss(recipe, err));
    recipe->progress =
        hada_progress_begin(task->monitor, "frames", (long)recipe->camera.depths * task->pairs + task->tests);
    status = hada_recipe_write(recipe, folder, err);
    hada_progress_end(&recipe->progress);
    return status;
}

hada_status hada_simulate_run(hada_context *context, const hada_camera *camera, const char *folder,
                              const hada_simulate_task *task, hada_simulate_report *report, hada_error *err)
{
    hada_recipe recipe = {.context = context};
    hada_status status = HADA_OK;
    HADA_NEED(context && camera && folder, err);
    HADA_TRY_OR_DONE(HADA_REPORT_CHECK(report, hada_simulate_report, err));
    HADA_TRY_OR_DONE(take_task(&recipe, camera, task, err));
    HADA_TRY_OR_DONE(hada_folder_create(folder, fill, &recipe, err));
    if (report) {
        const hada_simulate_report own = {.size = sizeof own,
                                          .pairs = recipe.task.pairs,
                                          .test_depths = recipe.task.test_depths,
                                          .exposure = recipe.has_sensor ? recipe.sensor.exposure : (double)NAN,
                                          .tests = recipe.task.tests,
                                          .light_lost = recipe.light_lost};
        HADA_REPORT_GIVE(report, &own);
    }
done:
    hada_simulator_destroy(&recipe.simulator);
    hada_scenes_close(&recipe.scenes);
    hada_scenes_close(&recipe.test_scenes);
    hada_surface_words_free(&recipe.surfaces);
    return status;
}
