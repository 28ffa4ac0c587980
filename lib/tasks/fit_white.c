/* Scenes that were cut off at white: light beyond it is in their frames all the same. A camera that the other pairs
 * give reconstructs them, and what was cut off is taken from there. */
#include <hadalens/reconstruct.h>
#include <hadalens/response.h>
#include <hadalens/scene.h>

#include "core/callers.h"

#include "fit/fitter.h"
#include "io/folder.h"
#include "tasks/fit_steps.h"

/* Light in the window of a scene, and whether it is known. */
typedef struct window {
    int top, left;
    hada_image light; /* as the scene says */
} window;

static hada_status take_window(window *of, const hada_image *scene, const hada_model_info *info, hada_error *err)
{
    of->top = (scene->rows - info->window_rows) / 2;
    of->left = (scene->cols - info->window_cols) / 2;
    HADA_TRY(hada_image_crop(&of->light, scene, of->top, of->left, info->window_rows, info->window_cols, err));
    hada_response_convert(of->light.data, hada_image_count(&of->light), info->scene_response, HADA_RESPONSE_LINEAR);
    return HADA_OK;
}

static float white_of(const hada_image *scene)
{
    float most = 0.0f;
    for (size_t i = 0; i < hada_image_count(scene); i++)
        most = fmaxf(most, scene->data[i]);
    return most;
}

/* The exposure of the frame beside those that gave the camera, by the light that is known. */
static double exposure_of(const window *of, const hada_image *seen, float white)
{
    double both = 0.0, square = 0.0;
    for (size_t i = 0; i < hada_image_count(seen); i++)
        if (of->light.data[i] < white) {
            both += (double)of->light.data[i] * seen->data[i];
            square += (double)seen->data[i] * seen->data[i];
        }
    return square > 0.0 && both > 0.0 ? both / square : 0.0;
}

/* What is seen where a scene is at white must be so much brighter, in the mean: else it was no brighter. */
#define BRIGHTER 1.1

/* Values at white become what was seen there, if that is brighter. Whether the scene was cut off at all. */
static int fill(hada_image *scene, window *of, const hada_image *seen, double response)
{
    const float cut = HADA_AT_WHITE * white_of(scene);
    float white = cut;
    hada_response_convert(&white, 1, response, HADA_RESPONSE_LINEAR);
    const double exposure = exposure_of(of, seen, white);
    const size_t count = hada_image_count(seen);
    double there = 0.0, values = 0.0;
    for (size_t i = 0; i < count; i++) {
        there += of->light.data[i] >= white ? exposure * seen->data[i] : 0.0;
        values += of->light.data[i] >= white;
        of->light.data[i] = fmaxf(of->light.data[i], (float)exposure * seen->data[i]);
    }
    if (there < BRIGHTER * values * white)
        return 0;
    hada_response_convert(of->light.data, count, HADA_RESPONSE_LINEAR, response);
    for (int c = 0; c < seen->channels; c++)
        for (int r = 0; r < seen->rows; r++)
            for (int k = 0; k < seen->cols; k++) {
                float *at =
                    &scene->data[((size_t)c * (size_t)scene->rows + (size_t)(r + of->top)) * (size_t)scene->cols +
                                 (size_t)(k + of->left)];
                const float *by =
                    &of->light.data[((size_t)c * (size_t)seen->rows + (size_t)r) * (size_t)seen->cols + (size_t)k];
                *at = *at >= cut ? fmaxf(*at, *by) : *at;
            }
    return 1;
}

static hada_status fill_pair(hada_filled_scene *out, int *filled, hada_plan *plan, const hada_model_info *info,
                             const hada_dataset *data, int depth, int number, hada_error *err)
{
    hada_pair pair = {0};
    hada_image frame = {0};
    hada_result result = {0};
    window of = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_pair_load_raw(data, depth, number, &frame, err));
    HADA_TRY_OR_DONE(hada_plan_run(plan, &frame, &result, err));
    HADA_TRY_OR_DONE(hada_pair_take(&pair, data, depth, number, err));
    HADA_TRY_OR_DONE(hada_image_crop(&out->scene, pair.scene, 0, 0, pair.scene->rows, pair.scene->cols, err));
    HADA_TRY_OR_DONE(take_window(&of, &out->scene, info, err));
    *filled = fill(&out->scene, &of, &result.planes[0], info->scene_response);
    out->number = hada_pair_number(data, depth, number);
done:
    if (status)
        hada_image_destroy(&out->scene);
    hada_image_destroy(&of.light);
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
        HADA_TRY_OR_DONE(hada_named(
            fill_pair(&out->list[out->count], &filled, plan, hada_model_get_info(model), data, depth, i, err),
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
    size_t count = 0;
    for (int z = 0; z < info->depths; z++)
        for (int i = 0; i < info->counts[z]; i++)
            count += leave[z][i] == HADA_CUT_OFF;
    HADA_TRY(HADA_NEW(out->list, count + 1, "scenes", err));
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
