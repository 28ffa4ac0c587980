/* Stray light: where planes leave more of a frame than its noise, light is looked for that is not the scene's, and the
 * frame is reconstructed again without it (planes/stray_light.c). */
#include "engine/stages.h"

#include "image/correct.h"

/* Looked for where planes leave so many times the energy of noise. */
#define MORE_THAN_NOISE 1.5
/* In a sequence, not again before they leave so many times what they did when it was last looked for. */
#define MORE_AGAIN 1.2

static size_t weights_of(const hada_pipeline *pipeline)
{
    return (size_t)hada_model_get_info(pipeline->setup->model)->channels * HADA_SMOOTH_TERMS;
}

static int is_wanted(const hada_pipeline *pipeline)
{
    const hada_dark dark = pipeline->setup->options.dark;
    return dark == HADA_DARK_MODEL || dark == HADA_DARK_AUTO;
}

/* What the planes leave, in units of the frame's energy. */
static double left_over(const hada_frame *frame)
{
    const hada_report *report = &frame->result->memory->report;
    return report->occupied_count ? report->residual * report->residual : 1.0;
}

static int leaves_much(const hada_pipeline *pipeline, const hada_frame *frame)
{
    const double left = left_over(frame), energy = frame->exposure.energy;
    return energy > 0.0 && left * energy > MORE_THAN_NOISE * hada_exposure_noise_energy(&frame->exposure) &&
           frame->result->memory->report.scene != HADA_SCENE_VOLUME &&
           !(pipeline->setup->config.warm && left < MORE_AGAIN * pipeline->stray.left);
}

static hada_status load(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    pipeline->loaded = 0;
    return hada_pipeline_load(pipeline, frame, err);
}

/* Afterwards what the planes leave is known; the result may still be on its way. */
static hada_status run(hada_pipeline *pipeline, hada_frame *frame, hada_path path, hada_error *err)
{
    HADA_TRY(path(pipeline, frame, err));
    if (!pipeline->residual_due)
        return HADA_OK;
    HADA_TRY(hada_slot_finish(pipeline->slot, err));
    hada_pipeline_residual(pipeline, frame);
    return HADA_OK;
}

static hada_status find(const hada_pipeline *pipeline, hada_frame *frame, int *found, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const int level_found =
        setup->options.dark == HADA_DARK_AUTO || hada_model_get_info(setup->model)->dark == HADA_AUTO;
    if (frame->exposure.stray) { /* it was that of the frame before */
        frame->examined = 0;
        HADA_TRY(hada_frame_examine(frame, err));
    }
    return hada_stray_light_find(&frame->exposure, setup->model, setup->depths, setup->config.depths, level_found,
                                 frame->stray, found, err);
}

/* Everything that the first look left, as before it. */
static hada_status begin_again(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    HADA_TRY(hada_slot_finish(pipeline->slot, err));
    hada_report *report = &frame->result->memory->report;
    report->refine_tv = report->refine_tv_factor = 0.0;
    report->refine_steps = report->warm_started = 0;
    report->residual = report->residual_linear = 0.0;
    pipeline->past.left = -1.0;
    hada_pipeline_weigh_end(pipeline);
    return load(pipeline, frame, err);
}

/* The sequence's, for the next frame; and what is said of it. */
static void keep(hada_pipeline *pipeline, const hada_frame *frame)
{
    hada_report *report = &frame->result->memory->report;
    const size_t count = weights_of(pipeline);
    pipeline->stray.known = frame->exposure.stray != NULL;
    if (!pipeline->stray.known)
        return;
    memcpy(pipeline->stray.weight, frame->stray, count * sizeof *frame->stray);
    for (size_t first = 0; first < count; first += HADA_SMOOTH_TERMS)
        report->stray_light += hada_smooth_mean(frame->stray + first) / ((double)count / HADA_SMOOTH_TERMS);
}

static hada_status carry_on(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    memcpy(frame->stray, pipeline->stray.weight, weights_of(pipeline) * sizeof *frame->stray);
    HADA_TRY(hada_exposure_subtract(&frame->exposure, frame->stray, err));
    return load(pipeline, frame, err);
}

hada_status hada_pipeline_without_stray_light(hada_pipeline *pipeline, hada_frame *frame, hada_path path,
                                              hada_error *err)
{
    int found = 0;
    if (!is_wanted(pipeline))
        return path(pipeline, frame, err);
    if (pipeline->setup->config.warm && pipeline->stray.known)
        HADA_TRY(carry_on(pipeline, frame, err));
    HADA_TRY(run(pipeline, frame, path, err));
    if (leaves_much(pipeline, frame)) {
        const int carried = frame->exposure.stray != NULL;
        HADA_TRY(find(pipeline, frame, &found, err));
        if (found)
            HADA_TRY(hada_exposure_subtract(&frame->exposure, frame->stray, err));
        if (found || carried) {
            HADA_TRY(begin_again(pipeline, frame, err));
            HADA_TRY(run(pipeline, frame, path, err));
        }
        pipeline->stray.left = left_over(frame);
    }
    keep(pipeline, frame);
    return HADA_OK;
}
