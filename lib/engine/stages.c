/* What both paths of a frame have in common: times, spectrum, net, pictures. */
#include "engine/stages.h"

#include "core/clock.h"

/* Light is noise, in the mean of 5 x 5 pixels, if it is less than so many times what a frame leaves unexplained: of
 * dark parts of scenes 93 to 99.7 % had less, of bright parts 0 to 1 % (perf/results/surface-choices.md). */
#define NOISE_LIGHT 3.0

hada_status hada_pipeline_lap(hada_pipeline *pipeline, hada_frame *frame, double *seconds, hada_error *err)
{
    const hada_slot *slot = pipeline->slot;
    const hada_status status = slot->context->info.unified_memory ? hada_slot_finish(pipeline->slot, err) : HADA_OK;
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
    const hada_frame_exposure *exposure = &frame->exposure;
    const int on_device = frame->device && !exposure->own.data; /* repaired pixels are on the host alone */
    if (on_device) /* the caller may have released another buffer that had this handle */
        hada_arguments_forget(pipeline->slot->context, frame->device);
    HADA_TRY(on_device
                 ? hada_hadamard_frame_from(pipeline->stage, frame->device, frame->device_offset, exposure->levels, err)
                 : hada_hadamard_frame(pipeline->stage, &exposure->pixels, exposure->levels, err));
    pipeline->loaded = frame->serial;
    return HADA_OK;
}

hada_status hada_pipeline_enhance(hada_pipeline *pipeline, hada_frame *frame, cl_mem planes, int count, int together,
                                  hada_error *err)
{
    int computed, left_out;
    if (!pipeline->enhance)
        return HADA_OK;
    hada_slot_stage(pipeline->slot, "enhance");
    hada_status status = hada_enhance_run(pipeline->enhance, planes, 0, count, together, err);
    hada_enhance_counts(pipeline->enhance, &computed, &left_out);
    atomic_fetch_add(&frame->enhanced, hada_enhance_acts(pipeline->enhance, count, together) ? count : 0);
    atomic_fetch_add(&frame->tiles, computed);
    atomic_fetch_add(&frame->tiles_left_out, left_out);
    return status;
}

hada_status hada_pipeline_read_planes(hada_pipeline *pipeline, hada_frame *frame, const hada_buffer *planes, int place,
                                      int depth, int count, hada_error *err)
{
    const hada_image *first = &frame->result->planes[depth]; /* the others follow in the stack */
    const hada_cl_arrays *device = &frame->result->memory->device;
    const size_t plane = hada_image_count(first) * sizeof *first->data, bytes = (size_t)count * plane;
    if (device->stack)
        HADA_TRY(hada_buffer_copy(pipeline->slot, planes->mem, (size_t)place * plane, device->stack,
                                  device->stack_offset + (size_t)depth * plane, bytes, err));
    return hada_buffer_read_later(planes, pipeline->slot, (size_t)place * plane, first->data, bytes, err);
}

hada_status hada_pipeline_dark_planes(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const hada_result *result = frame->result;
    const hada_cl_arrays *device = &result->memory->device;
    const size_t count = hada_image_count(&result->planes[0]);
    for (int z = 0; z < result->depths; z++) {
        if (result->memory->occupied[z])
            continue;
        memset(result->planes[z].data, 0, count * sizeof(float));
        if (device->stack)
            HADA_TRY(hada_buffer_fill(pipeline->slot, device->stack,
                                      device->stack_offset + (size_t)z * count * sizeof(float), 0.0f, count, err));
    }
    return HADA_OK;
}

hada_status hada_pipeline_no_pictures(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const hada_result *result = frame->result;
    const hada_cl_arrays *device = &result->memory->device;
    const size_t plane = hada_image_count(&result->all_in_focus), map = hada_image_count(&result->distance_map);
    memset(result->all_in_focus.data, 0, plane * sizeof(float));
    for (size_t i = 0; i < map; i++)
        result->distance_map.data[i] = NAN;
    if (device->all_in_focus)
        HADA_TRY(hada_buffer_fill(pipeline->slot, device->all_in_focus, device->all_in_focus_offset, 0.0f, plane, err));
    if (device->distance_map)
        HADA_TRY(hada_buffer_fill(pipeline->slot, device->distance_map, device->distance_map_offset, NAN, map, err));
    return HADA_OK;
}

void hada_pipeline_residual(hada_pipeline *pipeline, const hada_frame *frame)
{
    hada_report *report = &frame->result->memory->report;
    const int circular = pipeline->maker.boundary == HADA_BOUNDARY_CIRCULAR;
    double left = 0;
    if (!pipeline->residual_due)
        return;
    pipeline->residual_due = 0;
    hada_refiner_residual_arrived(pipeline->refiner, &left);
    if (!(frame->exposure.energy > 0))
        return;
    if (frame->exposure.mosaic != HADA_MOSAIC_NONE) /* it is of the colours that pixels hold, one of three */
        left *= HADA_MOSAIC_COLOURS;
    report->residual = sqrt(left / frame->exposure.energy);
    if (pipeline->past.kept)
        pipeline->past.left = left / frame->exposure.energy;
    /* the first step is the joint linear filter; the second one measures what it left */
    if (circular && report->refine_steps > 1)
        report->residual_linear = sqrt(hada_refiner_energy(pipeline->refiner, 0, 1) / frame->exposure.energy);
}

double hada_pipeline_noise_light(const hada_frame *frame)
{
    const double unit = frame->result->memory->report.residual * hada_exposure_light(&frame->exposure) /
                        sqrt(hada_model_gain(frame->setup->model));
    return isfinite(unit) ? NOISE_LIGHT * unit : 0.0;
}

hada_status hada_pipeline_pictures(hada_pipeline *pipeline, hada_frame *frame, double light, hada_error *err)
{
    hada_result *result = frame->result;
    const hada_buffer *pictures = &pipeline->pictures;
    const hada_cl_arrays *device = &result->memory->device;
    const size_t plane = hada_image_count(&result->all_in_focus), map = hada_image_count(&result->distance_map);
    hada_slot_stage(pipeline->slot, "focus");
    HADA_TRY(hada_focus_finish(pipeline->focus, light, pictures->mem, 0, pictures->mem, plane, NULL, err));
    HADA_TRY(hada_pipeline_lap(pipeline, frame, &result->memory->report.seconds_focus, err));
    hada_slot_stage(pipeline->slot, "download");
    if (device->all_in_focus)
        HADA_TRY(hada_buffer_copy(pipeline->slot, pictures->mem, 0, device->all_in_focus, device->all_in_focus_offset,
                                  plane * sizeof(float), err));
    if (device->distance_map)
        HADA_TRY(hada_buffer_copy(pipeline->slot, pictures->mem, plane * sizeof(float), device->distance_map,
                                  device->distance_map_offset, map * sizeof(float), err));
    HADA_TRY(
        hada_buffer_read_later(pictures, pipeline->slot, 0, result->all_in_focus.data, plane * sizeof(float), err));
    return hada_buffer_read_later(pictures, pipeline->slot, plane * sizeof(float), result->distance_map.data,
                                  map * sizeof(float), err);
}
