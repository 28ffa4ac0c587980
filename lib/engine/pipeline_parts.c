/* The parts of a pipeline, and the device memory that they take: made dry first, then in the places that were planned.
 */

#include "engine/stages.h"
#include "filter/bank.h"

/* What a pipeline does with a frame, in this order. The linear path computes and focuses batch by batch, so that these
 * two are one step; the joint path looks for the occupied depths, computes them, and then focuses. */
enum {
    UPLOAD, /* raw frame -> spectrum */
    PURSUE, /* joint: spectrum -> occupied depths, a step for each grid that it looks at */
    COMPUTE = PURSUE + HADA_PURSUIT_LEVELS, /* spectrum -> planes */
    FOCUS,                                  /* planes -> running best -> pictures */
    DOWNLOAD                                /* planes and pictures -> result */
};

static size_t planes_bytes(const hada_model_info *info, const hada_config *config, int batch)
{
    /* beside refined planes one of the linear filters at a time, where the two are blended */
    const size_t planes = !config->joint ? (size_t)batch : config->share < 1.0 ? 1 : 0;
    return hada_plane_values(info) * planes * sizeof(float);
}

static size_t pictures_bytes(const hada_model_info *info)
{
    const size_t pixels = (size_t)info->window_rows * (size_t)info->window_cols;
    return (hada_plane_values(info) + pixels) * sizeof(float);
}

/* What skipping and a dark frame need is kept from frame to frame, beside the scratch. */
static hada_status make_stage(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_model_info *info = hada_model_get_info(setup->model);
    hada_slot *slot = pipeline->slot;
    HADA_TRY(hada_hadamard_create(&pipeline->stage, slot, info, pipeline->batch, err));
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
    pipeline->usual_energy =
        (double)channels * hada_model_gain(model) * model->scene_power[0] / ((double)layout->rows * layout->cols);
    HADA_TRY_OR_DONE(HADA_NEW_RAW(scaled, values, "the scenes' power", err));
    HADA_TRY_OR_DONE(HADA_NEW(packed, channels * layout->count, "the scenes' power", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&buffer, pipeline->slot->context, channels * layout->count * sizeof(float),
                                        "the scenes' power", err));
    for (int z = 0; z < setup->config.depths && !pipeline->slot->context->dry; z++) {
        for (size_t i = 0; i < values; i++)
            scaled[i] = (float)(model->scene_power[i] * model->pairs[setup->depths[z]]);
        for (size_t channel = 0; channel < channels; channel++)
            hada_layout_pack_real(layout, scaled, packed + channel * layout->count);
        HADA_TRY_OR_DONE(hada_buffer_write(&buffer, pipeline->slot, 0, packed, buffer.bytes, err));
        HADA_TRY_OR_DONE(hada_pursuit_set_power(pipeline->pursuit, z, buffer.mem, err));
        HADA_TRY_OR_DONE(hada_slot_finish(pipeline->slot, err));
    }
done:
    hada_buffer_destroy(&buffer);
    HADA_FREE(scaled, packed);
    return status;
}

static hada_status make_pursuit(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    hada_pursuit_options options;
    hada_pursuit_options_init(&options);
    options.shape = hada_refine_shape_of(hada_model_get_info(setup->model), setup->config.depths, 1);
    options.depths = setup->config.depths;
    options.rho *= hada_model_gain(setup->model);
    options.full = setup->config.full_grid;
    const cl_mem prior = pipeline->constants->prior.mem;
    size_t offset;
    cl_mem otf = hada_constants_otf(pipeline->constants, &offset);
    HADA_TRY(hada_pursuit_create(&pipeline->pursuit, pipeline->slot, &options, err));
    HADA_TRY(hada_pursuit_set_otf(pipeline->pursuit, otf, offset, err));
    if (prior)
        HADA_TRY(hada_pursuit_set_prior(pipeline->pursuit, prior, err));
    return set_power(pipeline, err);
}

static hada_status make_solver(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_config *config = &setup->config;
    const hada_refine_shape refine = hada_config_refine(config, setup->model);
    hada_scratch_steps(pipeline->slot->scratch, COMPUTE, COMPUTE, DOWNLOAD);
    if (config->classic)
        return hada_classic_create(&pipeline->classic, pipeline->slot, &config->method, err);
    return config->joint ? hada_refiner_create(&pipeline->refiner, pipeline->slot, &refine, err) : HADA_OK;
}

static hada_status make_maker(hada_pipeline *pipeline, hada_error *err)
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
                                         .noise_share = setup->noise_share,
                                         .boundary = setup->config.boundary};
    if (setup->config.weighs)
        HADA_TRY(hada_maker_make_weights(&pipeline->maker, setup->config.choose || setup->config.method.sieve, err));
    if (!setup->config.joint || pipeline->slot->context->dry)
        return HADA_OK;
    const cl_mem otf = hada_constants_otf(constants, &offset);
    hada_maker_use_otf(&pipeline->maker, otf, offset, setup->config.depths, constants->prior.mem);
    return HADA_OK;
}

static hada_status make_enhance(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_context *context = pipeline->slot->context;
    const hada_model_info *info = hada_model_get_info(setup->model);
    const hada_enhance_desc desc = {.net = hada_model_get_enhance(setup->model),
                                    .channels = info->channels,
                                    .rows = info->window_rows,
                                    .cols = info->window_cols,
                                    .net_rows = info->enhance_rows,
                                    .net_cols = info->enhance_cols,
                                    /* a quarter of the device's, whatever the queues */
                                    .memory = (size_t)(context->info.memory_bytes / 4 / (uint64_t)setup->config.queues),
                                    /* small images leave a GPU idle, large ones a CPU's caches */
                                    .planes = context->shape == HADA_SHAPE_GROUPS ? setup->config.depths : 1,
                                    .content = setup->options.skip & HADA_SKIP_TILES ? 0.0f : -1.0f};
    return hada_enhance_create(&pipeline->enhance, pipeline->slot, &desc, err);
}

/* The parts on the pipeline's slot, which may be dry, each with the steps in which it works. */
static hada_status make_parts(hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_config *config = &setup->config;
    const hada_model_info *info = hada_model_get_info(setup->model);
    const hada_focus_desc focus = {.options = config->focus,
                                   .channels = info->channels,
                                   .rows = info->window_rows,
                                   .cols = info->window_cols,
                                   .depths = config->depths,
                                   .distances_mm = setup->distances};
    hada_slot *slot = pipeline->slot;
    const size_t planes = planes_bytes(info, config, pipeline->batch);
    /* where the sensor crops, refinement compares with the frame itself; some classic methods do in any case */
    const int raw_last =
        config->classic || config->volume || (config->joint && config->boundary == HADA_BOUNDARY_PADDED) ? COMPUTE
                                                                                                         : UPLOAD;
    hada_scratch_steps(slot->scratch, UPLOAD, COMPUTE, raw_last);
    HADA_TRY(make_stage(pipeline, err));
    hada_scratch_steps(slot->scratch, FOCUS, FOCUS, DOWNLOAD);
    HADA_TRY(hada_buffer_take(&pipeline->pictures, slot, HADA_RESULT, pictures_bytes(info),
                              "the all-in-focus image and the distance map", err));
    hada_scratch_steps(slot->scratch, config->joint ? FOCUS : COMPUTE, FOCUS, FOCUS);
    HADA_TRY(hada_focus_create(&pipeline->focus, slot, &focus, err));
    HADA_TRY(make_solver(pipeline, err));
    HADA_TRY(make_maker(pipeline, err));
    hada_scratch_steps(slot->scratch, PURSUE, PURSUE, PURSUE);
    if (config->pursuit)
        HADA_TRY(make_pursuit(pipeline, err));
    hada_scratch_steps(slot->scratch, COMPUTE, COMPUTE, DOWNLOAD);
    if (planes)
        HADA_TRY(hada_buffer_take(&pipeline->planes, slot, HADA_RESULT, planes, "the refocused planes", err));
    return config->enhance ? make_enhance(pipeline, err) : HADA_OK;
}

void hada_weighing_free(hada_weighing *weighing)
{
    hada_refiner_destroy(&weighing->refiner);
    HADA_DESTROY_BUFFERS(&weighing->raw, &weighing->pixels);
}

static void destroy_parts(hada_pipeline *pipeline)
{
    hada_weighing_free(&pipeline->weighing);
    hada_pursuit_destroy(&pipeline->pursuit);
    hada_maker_free_weights(&pipeline->maker);
    hada_refiner_destroy(&pipeline->refiner);
    hada_classic_destroy(&pipeline->classic);
    hada_focus_destroy(&pipeline->focus);
    hada_enhance_destroy(&pipeline->enhance);
    HADA_DESTROY_BUFFERS(&pipeline->planes, &pipeline->pictures);
    hada_meter_destroy(&pipeline->meter);
    hada_hadamard_destroy(&pipeline->stage);
}

/* Lists the scratch of a pipeline and plans its places, on a dry slot. What a frame may need beside for a moment,
 * filters in single precision where the bound of half ones is not kept, is counted as if it stayed. needs: may be NULL.
 */
static hada_status plan_parts(hada_scratch *scratch, const hada_setup *setup, const hada_constants *constants,
                              int batch, hada_dry *dry, hada_needs *needs, hada_error *err)
{
    hada_pipeline trial = {.setup = setup, .constants = constants, .batch = batch, .slot = &dry->slot};
    const uint64_t before = hada_context_bytes(&dry->context);
    hada_bank *single = NULL;
    hada_status status = HADA_OK;
    dry->slot.scratch = scratch;
    hada_context_reset_peak(&dry->context);
    HADA_TRY_OR_DONE(make_parts(&trial, err));
    if (setup->config.half_by_error)
        HADA_TRY_OR_DONE(hada_bank_create(&single, trial.slot, setup->model, &trial.stage->layout, setup->depths, 1,
                                          HADA_BANK_FILTERS, 0, err));
    HADA_TRY_OR_DONE(hada_scratch_plan(scratch, &dry->context, err));
    if (needs) {
        const uint64_t own = hada_context_bytes(&dry->context) - before;
        needs->each = own + hada_scratch_bytes(scratch);
        needs->apart = own + hada_scratch_apart(scratch);
        needs->making = hada_context_peak_bytes(&dry->context) - before - own;
    }
done:
    hada_bank_destroy(&single);
    destroy_parts(&trial);
    return status;
}

hada_status hada_pipeline_make_parts(hada_pipeline *pipeline, hada_error *err)
{
    hada_slot *slot = pipeline->slot;
    hada_dry dry;
    hada_status status = HADA_OK;
    hada_dry_begin(&dry, slot->context);
    HADA_TRY_OR_DONE(
        plan_parts(&pipeline->scratch, pipeline->setup, pipeline->constants, pipeline->batch, &dry, NULL, err));
    HADA_TRY_OR_DONE(hada_scratch_make(&pipeline->scratch, slot->context, err));
    slot->scratch = &pipeline->scratch;
    HADA_TRY_OR_DONE(make_parts(pipeline, err));
done:
    slot->scratch = NULL;
    hada_dry_end(&dry);
    return status;
}

/* A surface and a volume are counted until they are gone. */
static void leave_on_demand(hada_pipeline *pipeline)
{
    hada_on_demand *all = pipeline->constants->on_demand;
    const int surface = pipeline->surface != NULL, volume = pipeline->volume != NULL;
    hada_surface_destroy(&pipeline->surface);
    hada_classic_destroy(&pipeline->volume);
    pthread_mutex_lock(&all->lock);
    all->surfaces -= surface;
    all->volumes -= volume;
    pthread_mutex_unlock(&all->lock);
}

void hada_pipeline_clear(hada_pipeline *pipeline)
{
    if (pipeline->slot)
        hada_slot_finish(pipeline->slot, NULL);
    leave_on_demand(pipeline);
    pipeline->no_surface = 0;
    destroy_parts(pipeline);
    hada_slot_destroy(&pipeline->slot);
    hada_scratch_free(&pipeline->scratch);
    pipeline->loaded = 0;
}

hada_status hada_pipeline_needs(hada_needs *needs, const hada_context *context, const hada_setup *setup, int batch,
                                hada_error *err)
{
    hada_dry dry;
    hada_scratch scratch = {0};
    hada_constants *constants = NULL;
    hada_status status = HADA_OK;
    *needs = (hada_needs){0};
    hada_dry_begin(&dry, context);
    HADA_TRY_OR_DONE(hada_constants_create(&constants, &dry.context, setup, err));
    needs->constants = hada_context_bytes(&dry.context);
    HADA_TRY_OR_DONE(plan_parts(&scratch, setup, constants, batch, &dry, needs, err));
done:
    hada_constants_destroy(&constants);
    hada_scratch_free(&scratch);
    hada_dry_end(&dry);
    return status;
}

/* A quarter is left to the driver and to other programs. */
static uint64_t most_bytes(const hada_context *context)
{
    return context->info.memory_bytes / 4 * 3;
}

hada_status hada_pipeline_room(const hada_pipeline *pipeline, uint64_t *bytes, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_context *context = pipeline->constants->context;
    const uint64_t most = most_bytes(context), queues = (uint64_t)setup->config.queues;
    hada_needs needs;
    HADA_TRY(hada_pipeline_needs(&needs, context, setup, pipeline->batch, err));
    const uint64_t held = needs.constants + queues * needs.each;
    *bytes = most > held ? (most - held) / queues : 0;
    return HADA_OK;
}

int hada_pipeline_fit(const hada_context *context, const hada_setup *setup)
{
    const hada_config *config = &setup->config;
    int batch = config->batch_whole && context->shape == HADA_SHAPE_GROUPS ? config->depths : config->batch;
    for (; batch > 1; batch = (batch + 1) / 2) {
        hada_needs needs;
        if (!hada_pipeline_needs(&needs, context, setup, batch, NULL) &&
            needs.constants + (uint64_t)config->queues * needs.each <= most_bytes(context))
            break;
    }
    return batch;
}
