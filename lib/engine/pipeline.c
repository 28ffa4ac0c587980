/* A pipeline: making and unmaking it, and the way of a frame through it. */
#include <stdlib.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "engine/frame.h"
#include "engine/pipeline.h"
#include "engine/stages.h"
#include "filter/layout.h"
#include "runtime/profile.h"

/* What skipping and a dark frame bring stands beside the scratch: it stays from frame to frame. */
static hada_status make_stage(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_model_info *info = hada_model_get_info(setup->model);
    hada_slot *slot = pipeline->slot;
    HADA_TRY(hada_hadamard_create(&pipeline->stage, slot, &pipeline->scratch, info, pipeline->batch, err));
    if (setup->config.dark)
        HADA_TRY(hada_hadamard_set_dark(pipeline->stage, setup->dark_frame.data, err));
    if (!setup->config.pruned)
        HADA_TRY(hada_hadamard_unprune(pipeline->stage, err));
    if (setup->config.measured)
        HADA_TRY(hada_meter_create(&pipeline->meter, slot, &pipeline->stage->layout, pipeline->stage->channels, err));
    return HADA_OK;
}

/* sum |X|^2 of the pairs of each computed depth, as far as the model keeps it: the mean scene times the pairs. */
static hada_status set_power(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_model *model = setup->model;
    const hada_spectrum_layout *layout = &pipeline->constants->bank->layout;
    const size_t channels = (size_t)hada_model_get_info(model)->channels, values = hada_model_plane(model);
    float *scaled = NULL, *packed = NULL;
    hada_buffer buffer = {0};
    hada_status status = HADA_OK;
    if (!model->scene_power || !model->pairs)
        return HADA_OK; /* measured transfer functions are exact */
    HADA_TRY_OR_DONE(hada_allocated(scaled = hada_alloc_raw(values, sizeof(float), "the scenes' power", err)));
    HADA_TRY_OR_DONE(
        hada_allocated(packed = hada_alloc(channels * layout->count, sizeof(float), "the scenes' power", err)));
    HADA_TRY_OR_DONE(hada_buffer_create(&buffer, pipeline->constants->context, channels * layout->count * sizeof(float),
                                        "the scenes' power", err));
    for (int z = 0; z < setup->config.depths; z++) {
        for (size_t i = 0; i < values; i++)
            scaled[i] = (float)(model->scene_power[i] * model->pairs[setup->depths[z]]);
        for (size_t channel = 0; channel < channels; channel++)
            hada_layout_pack_real(layout, scaled, packed + channel * layout->count);
        HADA_TRY_OR_DONE(hada_buffer_write(&buffer, pipeline->slot, 0, packed, buffer.bytes, err));
        HADA_TRY_OR_DONE(hada_pursuit_set_power(pipeline->pursuit, z, 1, buffer.mem, 0, err));
        HADA_TRY_OR_DONE(hada_slot_finish(pipeline->slot, err));
    }
done:
    hada_buffer_destroy(&buffer);
    free(scaled);
    free(packed);
    return status;
}

static hada_status make_pursuit(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_pursuit_options options = hada_config_pursuit(&setup->config, setup->model);
    const cl_mem prior = pipeline->constants->prior.mem;
    size_t offset;
    cl_mem otf = hada_constants_otf(pipeline->constants, &offset);
    HADA_TRY(hada_pursuit_create(&pipeline->pursuit, pipeline->slot, &pipeline->scratch, &options, err));
    HADA_TRY(hada_pursuit_set_otf(pipeline->pursuit, 0, setup->config.depths, otf, offset, err));
    if (prior)
        HADA_TRY(hada_pursuit_set_prior(pipeline->pursuit, prior, err));
    return set_power(pipeline, err);
}

static void make_maker(hada_pipeline *pipeline)
{
    const hada_setup *setup = pipeline->setup;
    const hada_constants *constants = pipeline->constants;
    size_t offset;
    pipeline->maker = (hada_plane_maker){.slot = pipeline->slot,
                                         .model = setup->model,
                                         .stage = pipeline->stage,
                                         .bank = constants->bank,
                                         .refiner = pipeline->refiner,
                                         .weights = setup->config.weights,
                                         .noise_share = setup->noise_share};
    if (!setup->config.joint)
        return;
    const cl_mem otf = hada_constants_otf(constants, &offset);
    hada_maker_use_otf(&pipeline->maker, otf, offset, setup->config.depths, constants->prior.mem);
}

/* In the order of the plan of the memory: pipeline_memory.c. */
static hada_status make_parts(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_config *config = &setup->config;
    const hada_model_info *info = hada_model_get_info(setup->model);
    const hada_refine_shape refine = hada_config_refine(config, setup->model);
    hada_focus_desc focus = hada_config_focus(config, info);
    hada_slot *slot = pipeline->slot;
    hada_scratch *scratch = &pipeline->scratch;
    focus.distances_mm = setup->distances;
    HADA_TRY(hada_pipeline_plan_memory(scratch, slot->context, setup->model, config, pipeline->batch, err));
    HADA_TRY(hada_scratch_make(scratch, slot->context, err));
    HADA_TRY(make_stage(pipeline, err));
    HADA_TRY(hada_scratch_take(&pipeline->pictures, slot->context, scratch, hada_pipeline_pictures_bytes(info),
                               "the all-in-focus image and the distance map", err));
    HADA_TRY(hada_focus_create(&pipeline->focus, slot, scratch, &focus, err));
    if (config->classic)
        HADA_TRY(hada_classic_create(&pipeline->classic, slot, scratch, &config->method, err));
    else if (config->joint)
        HADA_TRY(hada_refiner_create(&pipeline->refiner, slot, scratch, &refine, err));
    make_maker(pipeline);
    if (config->pursuit)
        HADA_TRY(make_pursuit(pipeline, err));
    if (hada_pipeline_planes_bytes(info, config, pipeline->batch))
        HADA_TRY(hada_scratch_take(&pipeline->planes, slot->context, scratch,
                                   hada_pipeline_planes_bytes(info, config, pipeline->batch), "the refocused planes",
                                   err));
    if (config->enhance) {
        const hada_enhance_desc desc = hada_config_enhance(config, slot->context, setup->model, setup->options.skip);
        HADA_TRY(hada_enhance_create(&pipeline->enhance, slot, &desc, err));
    }
    return HADA_OK;
}

void hada_pipeline_clear(hada_pipeline *pipeline)
{
    if (pipeline->slot)
        hada_slot_finish(pipeline->slot, NULL);
    hada_pursuit_destroy(&pipeline->pursuit);
    hada_refiner_destroy(&pipeline->refiner);
    hada_classic_destroy(&pipeline->classic);
    hada_surfaces_unmake(pipeline->constants->surfaces, &pipeline->surface);
    pipeline->no_surface = 0;
    hada_focus_destroy(&pipeline->focus);
    hada_enhance_destroy(&pipeline->enhance);
    hada_buffer_destroy(&pipeline->planes);
    hada_buffer_destroy(&pipeline->pictures);
    hada_meter_destroy(&pipeline->meter);
    hada_hadamard_destroy(&pipeline->stage);
    hada_slot_destroy(&pipeline->slot);
    hada_scratch_free(&pipeline->scratch);
    pipeline->loaded = 0;
}

hada_status hada_pipeline_ready(hada_pipeline *pipeline, hada_error *err)
{
    hada_status status = HADA_OK;
    if (pipeline->slot)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&pipeline->slot, pipeline->constants->context, err));
    HADA_TRY_OR_DONE(make_parts(pipeline, err));
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
    HADA_TRY_OR_DONE(hada_allocated(pipeline = hada_alloc(1, sizeof *pipeline, "a plan", err)));
    *pipeline = (hada_pipeline){.setup = setup, .constants = constants, .batch = batch};
    HADA_TRY_OR_DONE(
        hada_allocated(pipeline->occupied = hada_alloc((size_t)setup->config.depths, sizeof(int), "a plan", err)));
    HADA_TRY_OR_DONE(hada_pipeline_ready(pipeline, err));
done:
    if (status)
        hada_pipeline_destroy(&pipeline);
    *out = pipeline;
    return status;
}

void hada_pipeline_destroy(hada_pipeline **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_pipeline *pipeline = *pointer;
    *pointer = NULL;
    hada_pipeline_clear(pipeline);
    free(pipeline->occupied);
    free(pipeline);
}

int hada_pipeline_batch(const hada_pipeline *pipeline)
{
    return pipeline->batch;
}

hada_status hada_pipeline_profile(hada_pipeline *pipeline, int on, hada_error *err)
{
    return pipeline->slot ? hada_slot_profile(pipeline->slot, on, err) : HADA_OK;
}

cl_command_queue hada_pipeline_queue(const hada_pipeline *pipeline)
{
    return pipeline->slot ? pipeline->slot->queue : NULL;
}

int hada_pipeline_is_profiled(const hada_pipeline *pipeline)
{
    return pipeline->slot && pipeline->slot->profile;
}

hada_status hada_pipeline_times(hada_pipeline *pipeline, hada_kernel_time **rows, size_t *count, hada_error *err)
{
    return hada_pipeline_is_profiled(pipeline) ? hada_slot_times(pipeline->slot, rows, count, err) : HADA_OK;
}

hada_calls hada_pipeline_calls(const hada_pipeline *pipeline)
{
    return pipeline->slot ? pipeline->slot->calls : (hada_calls){0};
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
