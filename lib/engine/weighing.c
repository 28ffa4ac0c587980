/* Weights of a frame's values: a refiner that uses them, and values filled for what does not, the pursuit and the
 * coarse levels of surfaces, which saturated values would mislead (docs/explanation/refinement.md). */

#include "engine/stages.h"

#include <float.h>

#include "image/pixels.h"

/* Saturated values as planes predict them, if that is more, and those of weight 0. */
static hada_status put_values(hada_frame_exposure *exposure, const float *weights, const float *residual,
                              hada_error *err)
{
    float *values;
    if (!exposure->own.data)
        HADA_TRY(hada_pixels_copy(&exposure->came, &exposure->own, err));
    hada_pixels_of_image(&exposure->pixels, &exposure->own);
    values = exposure->own.data;
    const size_t count = values ? hada_exposure_count(exposure) : 0;
    for (size_t i = 0; i < count; i++)
        if (weights[i] <= 0.0f)
            values[i] =
                fmaxf(values[i] - residual[i], weights[i] < 0.0f ? hada_exposure_brightest(exposure, i) : -FLT_MAX);
    return HADA_OK;
}

int hada_pipeline_has_gaps(const hada_pipeline *pipeline, const hada_frame *frame)
{
    return pipeline->refiner && hada_exposure_has_gaps(&frame->exposure);
}

hada_status hada_pipeline_fill(hada_pipeline *pipeline, hada_frame *frame, int count, hada_error *err)
{
    hada_frame_exposure *exposure = &frame->exposure;
    const size_t values = hada_exposure_count(exposure);
    float *residual = NULL, *weights = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(weights, values, "the weights of pixels", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(residual, values, "what planes leave of a frame", err));
    hada_exposure_weigh(exposure, weights);
    HADA_TRY_OR_DONE(hada_refiner_residual_values(pipeline->refiner, &pipeline->maker.data, count, pipeline->occupied,
                                                  residual, err));
    HADA_TRY_OR_DONE(put_values(exposure, weights, residual, err));
    pipeline->loaded = 0;
    HADA_TRY_OR_DONE(hada_pipeline_load(pipeline, frame, err));
done:
    HADA_FREE(residual, weights);
    return status;
}

/* A refiner that uses weights where the pipeline's does not, and the frame as it came, beside the pipeline's scratch.
 */
static hada_status make_weighing(hada_weighing *weighing, const hada_pipeline *pipeline, hada_slot *slot,
                                 hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_model_info *info = hada_model_get_info(setup->model);
    const size_t pixels = (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
    hada_refine_shape shape = hada_config_refine(&setup->config, setup->model);
    hada_plane_maker maker = {.slot = slot, .model = setup->model};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_buffer_create(&weighing->raw, slot->context, pixels * sizeof(float), "a frame", err));
    if (setup->config.boundary == HADA_BOUNDARY_PADDED)
        goto done;
    shape.boundary = HADA_BOUNDARY_PADDED;
    shape.past = 0;
    HADA_TRY_OR_DONE(hada_refiner_create(&weighing->refiner, slot, &shape, err));
    HADA_TRY_OR_DONE(hada_maker_make_weights(&maker, 0, err));
done:
    weighing->pixels = maker.pixels;
    return status;
}

/* The same without allocating, for its bytes. */
static hada_status count_weighing(const hada_pipeline *pipeline, uint64_t *bytes, hada_error *err)
{
    hada_weighing trial = {0};
    hada_dry dry;
    hada_dry_begin(&dry, pipeline->slot->context);
    const hada_status status = make_weighing(&trial, pipeline, &dry.slot, err);
    *bytes = hada_context_peak_bytes(&dry.context);
    hada_weighing_free(&trial);
    hada_dry_end(&dry);
    return status;
}

hada_status hada_pipeline_weigh(hada_pipeline *pipeline, int *weighs, hada_error *err)
{
    hada_weighing *weighing = &pipeline->weighing;
    const hada_buffer *raw = &pipeline->stage->raw;
    uint64_t room, bytes;
    *weighs = 0;
    if (!weighing->raw.mem) {
        HADA_TRY(hada_pipeline_room(pipeline, &room, err));
        HADA_TRY(count_weighing(pipeline, &bytes, err));
        if (bytes > room) {
            hada_log(pipeline->slot->context, HADA_LOG_WARNING,
                     "weights of saturated or missing pixels take %.0f MiB more on the device, and %.0f MiB are left: "
                     "they are not used",
                     (double)bytes / 0x1p20, (double)room / 0x1p20);
            return HADA_OK;
        }
        HADA_TRY(make_weighing(weighing, pipeline, pipeline->slot, err));
    }
    HADA_TRY(hada_buffer_copy(pipeline->slot, raw->mem, 0, weighing->raw.mem, 0, raw->bytes, err));
    weighing->before = pipeline->maker;
    weighing->used = *weighs = 1;
    pipeline->maker.data.frame = weighing->raw.mem;
    if (!weighing->refiner)
        return HADA_OK;
    pipeline->refiner = pipeline->maker.refiner = weighing->refiner;
    pipeline->maker.boundary = HADA_BOUNDARY_PADDED;
    pipeline->maker.pixels = weighing->pixels;
    return HADA_OK;
}

void hada_pipeline_weigh_end(hada_pipeline *pipeline)
{
    if (!pipeline->weighing.used)
        return;
    pipeline->maker = pipeline->weighing.before;
    pipeline->refiner = pipeline->maker.refiner;
    pipeline->weighing.used = 0;
}
