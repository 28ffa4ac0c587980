/* The emitters of a frame that a plan reconstructed. */
#include "dispatch/plan.h"
#include "emitters/emitters.h"
#include "image/pixels.h"
#include "model/model.h"

static hada_status check(const hada_plan *plan, const hada_result *result, hada_error *err)
{
    static const char *const names[] = {"nothing", "planes", "a surface"};
    const hada_setup *setup = &plan->setup;
    const hada_model_info *info = &setup->model->info;
    if (info->channels != 1)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "emitters are found in frames of one channel, and the model %s is for %d: make one from the "
                         "channel that shows them",
                         info->name, info->channels);
    HADA_TRY(hada_model_check_single(info, "the fit of emitters", err));
    if (!result->report || result->report->scene != HADA_SCENE_VOLUME)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "emitters are those of a volume, and the frame was taken for %s: choose options.scene volume",
                         names[result->report ? result->report->scene % 3 : 0]);
    if (setup->options.gamma != 1.0)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "emitters need light: leave options.gamma out");
    if (result->depths != setup->config.depths || result->planes->rows != info->window_rows ||
        result->planes->cols != info->window_cols)
        return hada_fail(err, HADA_ERROR_SIZE, "the result is none of this plan");
    return HADA_OK;
}

/* Made for the first frame, and kept. */
static hada_status ready(hada_plan *plan, hada_error *err)
{
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    pthread_mutex_lock(&plan->points_lock);
    if (!plan->points) {
        HADA_TRY_OR_DONE(hada_slot_create(&slot, plan->constants[0]->context, err));
        HADA_TRY_OR_DONE(hada_point_optics_create(&plan->points, slot, plan->setup.model, plan->setup.depths,
                                                  plan->setup.config.depths, err));
    }
done:
    pthread_mutex_unlock(&plan->points_lock);
    hada_slot_destroy(&slot);
    return status;
}

/* The frame's light, and how much each pixel counts: of saturated ones only a bound is known. */
static void take_frame(const hada_frame *frame, float *values, float *weights)
{
    const hada_frame_exposure *exposure = &frame->exposure;
    const float *dark = frame->setup->dark_frame.data;
    const size_t count = hada_exposure_count(exposure);
    const float *from = hada_pixels_floats(&exposure->pixels, 0, 0, count, values);
    hada_exposure_weigh(exposure, weights);
    for (size_t i = 0; i < count; i++) {
        values[i] = from[i] - (float)exposure->levels[0] - (dark ? dark[i] : 0.0F);
        weights[i] = fmaxf(weights[i], 0.0F);
    }
}

hada_status hada_plan_emitters(hada_emitters **out, hada_plan *plan, const hada_pixels *raw, const hada_result *result,
                               const hada_monitor *monitor, hada_error *err)
{
    HADA_NEED(out && plan && raw && result, err);
    hada_frame frame = {0};
    hada_pixels pixels;
    float *values = NULL, *weights = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY(check(plan, result, err));
    HADA_TRY(hada_pixels_take(&pixels, raw, err));
    HADA_TRY(hada_frame_begin(&frame, &plan->setup, &pixels, NULL, err));
    HADA_TRY_OR_DONE(hada_frame_examine(&frame, err));
    HADA_TRY_OR_DONE(ready(plan, err));
    const size_t count = hada_exposure_count(&frame.exposure);
    HADA_TRY_OR_DONE(HADA_NEW(values, count, "a frame", err));
    HADA_TRY_OR_DONE(HADA_NEW(weights, count, "a frame", err));
    take_frame(&frame, values, weights);
    const hada_emitters_job job = {.optics = plan->points,
                                   .values = values,
                                   .weights = weights,
                                   .planes = result->planes,
                                   .monitor = monitor,
                                   .noise = hada_exposure_noise(&frame.exposure)};
    HADA_TRY_OR_DONE(hada_emitters_find(out, &job, err));
done:
    hada_frame_end(&frame, HADA_OK);
    HADA_FREE(values, weights);
    return status;
}
