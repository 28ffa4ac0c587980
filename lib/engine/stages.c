/* What both paths of a frame have in common: times, spectrum, net, pictures. */
#include "engine/stages.h"

#include "core/clock.h"

hada_status hada_pipeline_lap(hada_pipeline *pipeline, hada_frame *frame, double *seconds, hada_error *err)
{
    const hada_status status = hada_slot_finish(pipeline->slot, err);
    const double now = hada_seconds();
    *seconds += now - frame->lap;
    frame->lap = now;
    return status;
}

void hada_pipeline_apply_skip(hada_pipeline *pipeline, const hada_frame *frame)
{
    const hada_frame_skip *skip = &frame->skip;
    pipeline->stage->part = (hada_hadamard_part){
        .band_rows = skip->band_rows, .band_cols = skip->band_cols, .spectra = skip->spectra, .planes = skip->planes};
}

hada_status hada_pipeline_load(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    if (pipeline->loaded == frame->serial)
        return HADA_OK;
    pipeline->loaded = 0;
    hada_pipeline_apply_skip(pipeline, frame);
    hada_status status = hada_hadamard_frame(pipeline->stage, frame->staged->data, frame->levels, err);
    if (!status)
        pipeline->loaded = frame->serial;
    return status;
}

hada_status hada_pipeline_enhance(hada_pipeline *pipeline, hada_frame *frame, cl_mem planes, int count, hada_error *err)
{
    int computed, left_out;
    if (!pipeline->enhance)
        return HADA_OK;
    hada_slot_stage(pipeline->slot, "enhance");
    hada_status status = hada_enhance_run(pipeline->enhance, planes, 0, count, err);
    hada_enhance_counts(pipeline->enhance, &computed, &left_out);
    atomic_fetch_add(&frame->enhanced, count);
    atomic_fetch_add(&frame->tiles, computed);
    atomic_fetch_add(&frame->tiles_left_out, left_out);
    return status;
}

hada_status hada_pipeline_read_plane(hada_pipeline *pipeline, const hada_buffer *planes, int place, hada_image *plane,
                                     hada_error *err)
{
    const size_t bytes = hada_image_count(plane) * sizeof *plane->data;
    return hada_buffer_read(planes, pipeline->slot, (size_t)place * bytes, plane->data, bytes, err);
}

hada_status hada_pipeline_pictures(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_result *result = frame->result;
    const hada_buffer *pictures = &pipeline->pictures;
    const size_t plane = hada_image_count(&result->all_in_focus), map = hada_image_count(&result->distance_map);
    hada_status status = HADA_OK;
    hada_slot_stage(pipeline->slot, "focus");
    HADA_TRY(hada_focus_finish(pipeline->focus, pictures->mem, 0, pictures->mem, plane, NULL, err));
    HADA_TRY(hada_pipeline_lap(pipeline, frame, &result->memory->report.seconds_focus, err));
    hada_slot_stage(pipeline->slot, "download");
    HADA_TRY(hada_buffer_read(pictures, pipeline->slot, 0, result->all_in_focus.data, plane * sizeof(float), err));
    HADA_TRY(hada_buffer_read(pictures, pipeline->slot, plane * sizeof(float), result->distance_map.data,
                              map * sizeof(float), err));
done:
    return status;
}
