/* A pipeline: the way of a frame through it; smaller batches where memory is short. */

#include "engine/pipeline.h"
#include "core/clock.h"
#include "engine/stages.h"
#include "image/correct.h"

/* The parts are there: made again after hada_pipeline_clear(). */
static hada_status pipeline_ready(hada_pipeline *pipeline, hada_error *err)
{
    hada_status status = HADA_OK;
    if (pipeline->slot)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&pipeline->slot, pipeline->constants->context, err));
    HADA_TRY_OR_DONE(hada_pipeline_make_parts(pipeline, err));
done:
    if (status)
        hada_pipeline_clear(pipeline);
    return status;
}

hada_status hada_pipeline_create(hada_pipeline **out, const hada_setup *setup, const hada_constants *constants,
                                 int batch, hada_error *err)
{
    hada_pipeline *pipeline = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(pipeline, 1, "a plan", err));
    *pipeline = (hada_pipeline){.setup = setup, .constants = constants, .batch = batch, .past = {.left = -1.0}};
    HADA_TRY_OR_DONE(HADA_NEW(pipeline->occupied, (size_t)setup->config.depths, "a plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(pipeline->all, (size_t)setup->config.depths + 1, "a plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(pipeline->stray.weight,
                              (size_t)hada_model_get_info(setup->model)->channels * HADA_SMOOTH_TERMS, "a plan", err));
    for (int z = 0; z <= setup->config.depths; z++) /* haze may be behind them */
        pipeline->all[z] = z;
    HADA_TRY_OR_DONE(pipeline_ready(pipeline, err));
done:
    if (status)
        hada_pipeline_destroy(&pipeline);
    *out = pipeline;
    return status;
}

void hada_pipeline_destroy(hada_pipeline **pointer)
{
    hada_pipeline *pipeline = hada_taken(pointer);
    if (!pipeline)
        return;
    hada_pipeline_clear(pipeline);
    HADA_FREE(pipeline->occupied, pipeline->all, pipeline->stray.weight, pipeline);
}

int hada_pipeline_batch(const hada_pipeline *pipeline)
{
    return pipeline->batch;
}

hada_slot *hada_pipeline_slot(const hada_pipeline *pipeline)
{
    return pipeline->slot;
}

static hada_status upload(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "upload");
    HADA_TRY(hada_frame_prepare(frame, err));
    HADA_TRY(hada_pipeline_load(pipeline, frame, err));
    HADA_TRY(hada_skip_frequencies(pipeline, frame, err));
    hada_frame_progress(frame, 1);
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_upload, err);
}

/* After a failure: the queue is emptied, and the loaded frame counts as lost. */
static void reset(hada_pipeline *pipeline)
{
    hada_slot_finish(pipeline->slot, NULL);
    pipeline->loaded = 0;
    pipeline->residual_due = 0;
}

static hada_status all_stages(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    HADA_TRY(upload(pipeline, frame, err));
    HADA_TRY(setup->config.joint ? hada_pipeline_joint(pipeline, frame, err)
                                 : hada_pipeline_linear(pipeline, frame, err));
    HADA_TRY(hada_frame_check(frame, err));
    hada_skip_fill_report(frame);
    HADA_TRY(hada_slot_finish(pipeline->slot, err)); /* results are on their way until now */
    hada_pipeline_residual(pipeline, frame);
    HADA_TRY(hada_frame_check_result(frame, err));
    hada_result_apply_gamma(frame->result, setup->options.gamma);
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_download, err);
}

static hada_status run(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(pipeline_ready(pipeline, err));
    hada_slot_cancel_by(pipeline->slot, &frame->cancelled);
    status = all_stages(pipeline, frame, err);
    if (status)
        reset(pipeline);
    if (status || !pipeline->past.kept)
        pipeline->past.left = -1.0;
    hada_pipeline_weigh_end(pipeline);
    hada_slot_cancel_by(pipeline->slot, NULL);
    if (frame->result->memory)
        frame->result->memory->report.seconds_total = hada_seconds() - frame->start;
    return status;
}

hada_status hada_pipeline_run(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_error error = {0};
    hada_status status = run(pipeline, frame, &error);
    while (status == HADA_ERROR_DEVICE_MEMORY && !pipeline->setup->config.joint && pipeline->batch > 1) {
        pipeline->batch = (pipeline->batch + 1) / 2;
        hada_log(pipeline->constants->context, HADA_LOG_WARNING, "%s; trying again with batches of %d depths",
                 error.message, pipeline->batch);
        hada_pipeline_clear(pipeline);
        status = run(pipeline, frame, &error);
    }
    if (status && err)
        *err = error;
    return status;
}

hada_status hada_pipeline_help(hada_pipeline *pipeline, hada_frame *frame, int first, int count, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(pipeline_ready(pipeline, err));
    hada_slot_cancel_by(pipeline->slot, &frame->cancelled);
    HADA_TRY_OR_DONE(hada_pipeline_load(pipeline, frame, err));
    HADA_TRY_OR_DONE(hada_pipeline_linear_batch(pipeline, frame, first, count, err));
done:
    if (status)
        reset(pipeline);
    hada_slot_cancel_by(pipeline->slot, NULL);
    return status;
}
