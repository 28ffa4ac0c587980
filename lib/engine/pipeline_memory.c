/* The stages of a frame on a pipeline and the memory that each needs: buffers whose stages do not meet stand in one
 * place. */
#include "engine/stages.h"

/* What a pipeline does with a frame, in this order. The linear path computes and focuses batch by batch, so that these
 * two are one step; the joint path looks for the occupied depths, computes them, and then focuses. */
enum {
    UPLOAD, /* raw frame -> spectrum */
    PURSUE, /* joint: spectrum -> occupied depths, a step for each grid that it looks at */
    COMPUTE = PURSUE + HADA_PURSUIT_LEVELS, /* spectrum -> planes */
    FOCUS,                                  /* planes -> running best -> pictures */
    DOWNLOAD                                /* planes and pictures -> result */
};

size_t hada_pipeline_planes_bytes(const hada_model_info *info, const hada_config *config, int batch)
{
    /* beside refined planes one of the linear filters at a time, where the two are blended */
    const size_t planes = !config->joint ? (size_t)batch : config->share < 1.0 ? 1 : 0;
    return hada_plane_values(info) * planes * sizeof(float);
}

size_t hada_pipeline_pictures_bytes(const hada_model_info *info)
{
    const size_t pixels = (size_t)info->window_rows * (size_t)info->window_cols;
    return (hada_plane_values(info) + pixels) * sizeof(float);
}

/* In the order in which hada_pipeline_ready() makes them. */
static hada_status note(hada_scratch *scratch, const hada_context *context, const hada_model *model,
                        const hada_config *config, int batch, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_focus_desc focus = hada_config_focus(config, info);
    const hada_refine_shape refine = hada_config_refine(config, model);
    /* where the sensor crops, refinement compares with the frame itself; some classic methods do in any case */
    const int raw_last =
        config->classic || (config->joint && info->boundary == HADA_BOUNDARY_PADDED) ? COMPUTE : UPLOAD;
    HADA_TRY(hada_hadamard_note(context, info, batch, scratch, UPLOAD, raw_last, COMPUTE, err));
    hada_scratch_steps(scratch, FOCUS, DOWNLOAD);
    HADA_TRY(hada_scratch_note(scratch, hada_pipeline_pictures_bytes(info), "the pictures", err));
    hada_scratch_steps(scratch, config->joint ? FOCUS : COMPUTE, FOCUS);
    HADA_TRY(hada_focus_note(context, &focus, scratch, err));
    if (config->classic)
        HADA_TRY(hada_classic_note(context, &config->method, scratch, COMPUTE, COMPUTE, DOWNLOAD, err));
    else if (config->joint)
        HADA_TRY(hada_refiner_note(context, &refine, scratch, COMPUTE, COMPUTE, DOWNLOAD, err));
    if (config->pursuit) {
        const hada_pursuit_options pursuit = hada_config_pursuit(config, model);
        HADA_TRY(hada_pursuit_note(context, &pursuit, scratch, PURSUE, err));
    }
    hada_scratch_steps(scratch, COMPUTE, DOWNLOAD);
    if (hada_pipeline_planes_bytes(info, config, batch))
        HADA_TRY(
            hada_scratch_note(scratch, hada_pipeline_planes_bytes(info, config, batch), "the refocused planes", err));
    return HADA_OK;
}

hada_status hada_pipeline_plan_memory(hada_scratch *scratch, const hada_context *context, const hada_model *model,
                                      const hada_config *config, int batch, hada_error *err)
{
    hada_status status = note(scratch, context, model, config, batch, err);
    return status ? status : hada_scratch_plan(scratch, context, err);
}

/* What stays from frame to frame beside the shared scratch, for skipping. */
static uint64_t skip_bytes(const hada_context *context, const hada_model_info *info, const hada_config *config,
                           int batch)
{
    const hada_spectrum_layout layout = hada_hadamard_layout(context, info);
    return (config->pruned ? 0 : hada_hadamard_unpruned_bytes(context, info, batch)) +
           (config->measured ? hada_meter_bytes(&layout, info->channels) : 0) +
           (config->half_by_error ? hada_bank_bytes(info, &layout, 1, HADA_BANK_FILTERS, 0) : 0);
}

static uint64_t enhance_bytes(const hada_context *context, const hada_model *model, const hada_config *config)
{
    size_t bytes;
    if (!config->enhance)
        return 0;
    const hada_enhance_desc desc = hada_config_enhance(config, context, model, HADA_SKIP_TILES);
    return hada_enhance_bytes(context, &desc, &bytes, NULL) ? 0 : bytes;
}

/* What the parts of a pipeline would hold apart. */
static uint64_t bytes_apart(const hada_context *context, const hada_model *model, const hada_config *config, int batch)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_focus_desc focus = hada_config_focus(config, info);
    const hada_refine_shape refine = hada_config_refine(config, model);
    const uint64_t frame = 4 * (uint64_t)info->raw_rows * (uint64_t)info->raw_cols * (uint64_t)info->channels;
    uint64_t bytes = hada_hadamard_bytes(context, info, batch) + hada_focus_bytes(context, &focus) +
                     hada_pipeline_planes_bytes(info, config, batch) + hada_pipeline_pictures_bytes(info) +
                     (config->dark ? frame : 0) + skip_bytes(context, info, config, batch) +
                     enhance_bytes(context, model, config);
    if (config->classic)
        bytes += hada_classic_bytes(context, &config->method);
    else if (config->joint)
        bytes += hada_refiner_bytes(context, &refine);
    if (config->pursuit) {
        const hada_pursuit_options pursuit = hada_config_pursuit(config, model);
        bytes += hada_pursuit_bytes(context, &pursuit);
    }
    return bytes;
}

hada_status hada_pipeline_bytes(const hada_context *context, const hada_model *model, const hada_config *config,
                                int batch, uint64_t *bytes, uint64_t *apart, hada_error *err)
{
    hada_scratch scratch = {0};
    hada_status status = hada_pipeline_plan_memory(&scratch, context, model, config, batch, err);
    *apart = bytes_apart(context, model, config, batch);
    *bytes = *apart - hada_scratch_noted(&scratch) + hada_scratch_bytes(&scratch);
    hada_scratch_free(&scratch);
    return status;
}

uint64_t hada_pipeline_making_bytes(const hada_context *context, const hada_model *model)
{
    return hada_hadamard_check_bytes(context, hada_model_get_info(model));
}

/* A quarter is left to the driver and to other programs. */
static uint64_t most_bytes(const hada_context *context)
{
    return context->info.memory_bytes / 4 * 3;
}

hada_status hada_pipeline_room(const hada_context *context, const hada_model *model, const hada_config *config,
                               int batch, uint64_t *bytes, hada_error *err)
{
    const uint64_t most = most_bytes(context), queues = (uint64_t)config->queues;
    uint64_t each, apart;
    HADA_TRY(hada_pipeline_bytes(context, model, config, batch, &each, &apart, err));
    const uint64_t held = hada_constants_bytes(context, model, config) + queues * each;
    *bytes = most > held ? (most - held) / queues : 0;
    return HADA_OK;
}

int hada_pipeline_fit(const hada_context *context, const hada_model *model, const hada_config *config, int queues)
{
    const uint64_t most = most_bytes(context), constants = hada_constants_bytes(context, model, config);
    int batch = config->batch_whole && context->shape == HADA_SHAPE_GROUPS ? config->depths : config->batch;
    for (; batch > 1; batch = (batch + 1) / 2) {
        uint64_t bytes, apart;
        if (!hada_pipeline_bytes(context, model, config, batch, &bytes, &apart, NULL) &&
            constants + (uint64_t)queues * bytes <= most)
            break;
    }
    return batch;
}
