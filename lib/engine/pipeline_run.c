/* The way of a frame through a pipeline. */
#include "core/clock.h"
#include "engine/result.h"
#include "engine/skip.h"
#include "engine/stages.h"

static hada_status upload(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "upload");
    HADA_TRY(hada_frame_prepare(frame, err));
    HADA_TRY(hada_pipeline_load(pipeline, frame, err));
    HADA_TRY(hada_skip_frequencies(pipeline, frame, err));
    hada_frame_progress(frame, 1);
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_upload, err);
}

/* After a failure: nothing is in the queue, and what it left behind is not trusted. */
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
    hada_result_apply_gamma(frame->result, setup->options.gamma);
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_download, err);
}

static hada_status run(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_status status = hada_pipeline_ready(pipeline, err);
    if (status)
        return status;
    hada_slot_cancel_by(pipeline->slot, &frame->cancelled);
    status = all_stages(pipeline, frame, err);
    if (status)
        reset(pipeline);
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
    hada_status status = hada_pipeline_ready(pipeline, err);
    if (status)
        return status;
    hada_slot_cancel_by(pipeline->slot, &frame->cancelled);
    HADA_TRY_OR_DONE(hada_pipeline_load(pipeline, frame, err));
    HADA_TRY_OR_DONE(hada_pipeline_linear_batch(pipeline, frame, first, count, err));
done:
    if (status)
        reset(pipeline);
    hada_slot_cancel_by(pipeline->slot, NULL);
    return status;
}
