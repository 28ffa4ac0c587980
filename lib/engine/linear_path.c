/* The linear path: every depth's filter on the frame's spectrum, in batches. The focus takes the planes near to far,
 * so that its bits do not depend on who computed them. */
#include "engine/stages.h"
#include "filter/hadamard.h"

/* Planes of depths first ... first + count - 1 into pipeline->planes; light is not negative. */
static hada_status compute(hada_pipeline *pipeline, const hada_frame *frame, int first, int count, hada_error *err)
{
    const size_t plane = hada_plane_values(hada_model_get_info(pipeline->setup->model));
    const cl_mem planes = pipeline->planes.mem;
    hada_slot_stage(pipeline->slot, "linear");
    hada_pipeline_apply_skip(pipeline, frame);
    if (!hada_skip_needs_single(frame))
        return hada_maker_filter(&pipeline->maker, first, count, planes, err);
    HADA_TRY(hada_skip_run_single(pipeline, first, count, err));
    return hada_image_clip(pipeline->slot, planes, plane * (size_t)count, err);
}

static hada_status read_planes(hada_pipeline *pipeline, hada_frame *frame, int first, int count, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "download");
    return hada_pipeline_read_planes(pipeline, frame, &pipeline->planes, 0, first, count, err);
}

/* Planes that another pipeline left in the result come into pipeline->planes. */
static hada_status write_planes(hada_pipeline *pipeline, hada_frame *frame, int first, int count, hada_error *err)
{
    const size_t bytes = hada_plane_values(hada_model_get_info(pipeline->setup->model)) * sizeof(float);
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_buffer_write(&pipeline->planes, pipeline->slot, (size_t)i * bytes,
                                   frame->result->planes[first + i].data, bytes, err));
    return HADA_OK;
}

static hada_status push(hada_pipeline *pipeline, hada_frame *frame, int first, int count, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "focus");
    hada_status status = hada_focus_push(pipeline->focus, first, count, pipeline->planes.mem, 0, err);
    return status ? status : hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_focus, err);
}

/* A batch that was taken, into the result; *next moves on where the focus could take it at once. */
static hada_status own_batch(hada_pipeline *pipeline, hada_frame *frame, int first, int count, int *next,
                             hada_error *err)
{
    hada_report *report = &frame->result->memory->report;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(compute(pipeline, frame, first, count, err));
    HADA_TRY_OR_DONE(hada_pipeline_lap(pipeline, frame, &report->seconds_linear, err));
    HADA_TRY_OR_DONE(hada_pipeline_enhance(pipeline, frame, pipeline->planes.mem, count, 0, err));
    HADA_TRY_OR_DONE(hada_pipeline_lap(pipeline, frame, &report->seconds_enhance, err));
    if (first == *next) {
        *next += count;
        HADA_TRY_OR_DONE(push(pipeline, frame, first, count, err));
    }
    HADA_TRY_OR_DONE(read_planes(pipeline, frame, first, count, err));
done:
    frame->batches->put(frame, first, count, !status);
    return status ? status : hada_pipeline_lap(pipeline, frame, &report->seconds_download, err);
}

static hada_status others_batch(hada_pipeline *pipeline, hada_frame *frame, int count, int *next, hada_error *err)
{
    const int first = *next;
    count = count < pipeline->batch ? count : pipeline->batch;
    *next += count;
    HADA_TRY(hada_slot_finish(pipeline->slot, err)); /* they may be this pipeline's own, still on their way */
    HADA_TRY(write_planes(pipeline, frame, first, count, err));
    return push(pipeline, frame, first, count, err);
}

static hada_status all_batches(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const unsigned char *occupied = frame->result->memory->occupied;
    for (int next = 0; next < pipeline->setup->config.depths;) {
        int first, count;
        if (!occupied[next])
            next++;
        else if ((count = frame->batches->arrived(frame, next, 0)))
            HADA_TRY(others_batch(pipeline, frame, count, &next, err));
        else if ((count = frame->batches->take(frame, pipeline->batch, &first)))
            HADA_TRY(own_batch(pipeline, frame, first, count, &next, err));
        else
            frame->batches->arrived(frame, next, 1);
    }
    return HADA_OK;
}

static hada_status all_planes(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const unsigned char *occupied = frame->result->memory->occupied;
    hada_status status = HADA_OK;
    HADA_TRY(hada_focus_begin(pipeline->focus, occupied, err));
    frame->batches->open(frame, occupied);
    status = all_batches(pipeline, frame, err);
    frame->batches->close(frame);
    return status;
}

hada_status hada_pipeline_linear(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_result *result = frame->result;
    hada_report *report = &result->memory->report;
    for (int z = 0; z < result->depths; z++) {
        result->memory->occupied[z] = pipeline->setup->listed[z];
        report->occupied_count += report->occupied[z];
    }
    HADA_TRY(hada_pipeline_dark_planes(pipeline, frame, err)); /* the user knows that nothing is there */
    do {
        HADA_TRY(all_planes(pipeline, frame, err));
        if (pipeline->setup->config.measured) /* their norm is asked for */
            HADA_TRY(hada_slot_finish(pipeline->slot, err));
    } while (!hada_skip_kept(frame));
    return hada_pipeline_pictures(pipeline, frame, 0.0, err);
}

hada_status hada_pipeline_linear_batch(hada_pipeline *pipeline, hada_frame *frame, int first, int count,
                                       hada_error *err)
{
    HADA_TRY(compute(pipeline, frame, first, count, err));
    HADA_TRY(hada_pipeline_enhance(pipeline, frame, pipeline->planes.mem, count, 0, err));
    HADA_TRY(read_planes(pipeline, frame, first, count, err));
    return hada_slot_finish(pipeline->slot, err);
}
