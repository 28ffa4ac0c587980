/* Scenes that were cut off at white: light beyond it is in their frames all the same. A camera that the other pairs
 * give reconstructs them, and what was cut off is taken from there. */
#include <hadalens/camera.h>
#include <hadalens/reconstruct.h>
#include <hadalens/response.h>
#include <hadalens/scene.h>

#include "core/callers.h"
#include "fit/fitter.h"
#include "image/pixels.h"
#include "io/folder.h"
#include "tasks/fit_steps.h"

/* The exposure of the frame beside those that gave the camera, by the light that is known. */
static double exposure_of(const hada_image *light, const hada_image *seen, float white)
{
    double both = 0.0, square = 0.0;
    for (size_t i = 0; i < hada_image_count(seen); i++)
        if (light->data[i] < white) {
            both += (double)light->data[i] * seen->data[i];
            square += (double)seen->data[i] * seen->data[i];
        }
    return square > 0.0 && both > 0.0 ? both / square : 0.0;
}

/* What is seen where a scene is at white must be so much brighter, in the mean: else it was no brighter. */
#define BRIGHTER 1.1

/* Light becomes what was seen, where that is brighter. Whether it is where the light is at white. */
static int brighten(hada_image *light, const hada_image *seen, float white)
{
    const double exposure = exposure_of(light, seen, white);
    double there = 0.0, values = 0.0;
    for (size_t i = 0; i < hada_image_count(seen); i++) {
        there += light->data[i] >= white ? exposure * seen->data[i] : 0.0;
        values += light->data[i] >= white;
        light->data[i] = fmaxf(light->data[i], (float)exposure * seen->data[i]);
    }
    return there >= BRIGHTER * values * white;
}

/* Values of the scene from `cut` on become those of its window, if these are larger. */
static void put_brighter(hada_image *scene, const hada_image *window, float cut)
{
    const int top = hada_window_origin(scene->rows, window->rows), left = hada_window_origin(scene->cols, window->cols);
    const float *from = window->data;
    for (int c = 0; c < window->channels; c++)
        for (int r = 0; r < window->rows; r++) {
            const size_t row = (size_t)c * (size_t)scene->rows + (size_t)(top + r);
            float *to = scene->data + row * (size_t)scene->cols + left;
            for (int k = 0; k < window->cols; k++, from++)
                to[k] = to[k] >= cut ? fmaxf(to[k], *from) : to[k];
        }
}

/* Fills a scene with what was seen in its window. *filled: whether the scene was cut off at all. */
static hada_status fill(hada_image *scene, const hada_image *seen, double response, int *filled, hada_error *err)
{
    const size_t count = hada_image_count(seen);
    const float cut = hada_fit_white(scene);
    float white = cut;
    hada_image window;
    HADA_TRY(hada_image_crop(&window, scene, hada_window_origin(scene->rows, seen->rows),
                             hada_window_origin(scene->cols, seen->cols), seen->rows, seen->cols, err));
    hada_response_convert(&white, 1, response, HADA_RESPONSE_LINEAR);
    hada_response_convert(window.data, count, response, HADA_RESPONSE_LINEAR);
    *filled = brighten(&window, seen, white);
    if (*filled) {
        hada_response_convert(window.data, count, HADA_RESPONSE_LINEAR, response);
        put_brighter(scene, &window, cut);
    }
    hada_image_destroy(&window);
    return HADA_OK;
}

static hada_status fill_pair(hada_filled_scene *out, int *filled, hada_plan *plan, double response,
                             const hada_dataset *data, int depth, int number, hada_error *err)
{
    hada_pair pair = {0};
    hada_image frame = {0};
    hada_result result = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_pair_load_raw(data, depth, number, &frame, err));
    HADA_TRY_OR_DONE(hada_plan_run(plan, &frame, &result, err));
    HADA_TRY_OR_DONE(hada_pair_take(&pair, data, depth, number, err));
    HADA_TRY_OR_DONE(hada_image_copy(&out->scene, pair.scene, err));
    HADA_TRY_OR_DONE(fill(&out->scene, &result.planes[0], response, filled, err));
    out->number = hada_pair_number(data, depth, number);
done:
    if (status)
        hada_image_destroy(&out->scene);
    hada_image_destroy(&frame);
    hada_result_destroy(&result);
    hada_pair_return(&pair);
    return status;
}

static hada_status fill_depth(hada_filled_scenes *out, hada_context *context, const hada_model *model,
                              const hada_dataset *data, int depth, unsigned char *leave, hada_error *err)
{
    const hada_dataset_info *pairs = hada_dataset_get_info(data);
    hada_plan_options options;
    hada_plan *plan = NULL;
    hada_status status = HADA_OK;
    hada_plan_options_init(&options);
    options.depths = options.occupied_list = &depth;
    options.depth_count = options.occupied_count = 1;
    options.occupied = HADA_OCCUPIED_LIST;
    options.scene = HADA_SCENE_PLANES;
    for (int i = 0; i < pairs->counts[depth]; i++) {
        int filled = 0;
        if (leave[i] != HADA_CUT_OFF)
            continue;
        if (!plan)
            HADA_TRY_OR_DONE(hada_plan_create(&plan, context, model, &options, err));
        HADA_TRY_OR_DONE(hada_named(fill_pair(&out->list[out->count], &filled, plan,
                                              hada_model_get_info(model)->scene_response, data, depth, i, err),
                                    pairs->files[depth][i].raw, err));
        leave[i] = filled ? HADA_FILLED : HADA_STAYS;
        if (filled)
            out->count++;
        else
            hada_image_destroy(&out->list[out->count].scene);
    }
done:
    hada_plan_destroy(&plan);
    return status;
}

hada_status hada_fit_fill_white(hada_filled_scenes *out, hada_context *context, const hada_model *model,
                                const hada_dataset *data, unsigned char *const *leave, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(data);
    HADA_TRY(HADA_NEW(out->list, (size_t)info->pairs, "scenes", err));
    for (int z = 0; z < info->depths; z++)
        HADA_TRY(fill_depth(out, context, model, data, z, leave[z], err));
    return HADA_OK;
}

void hada_filled_scenes_free(hada_filled_scenes *filled)
{
    for (int i = 0; i < filled->count; i++)
        hada_image_destroy(&filled->list[i].scene);
    free(filled->list);
    *filled = (hada_filled_scenes){0};
}
