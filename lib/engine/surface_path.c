/* The path of a frame that is taken for a surface: one texture, one continuous distance. */

#include "engine/stages.h"

/* Pixels with less light than this share of the mean have no distance. */
#define DARK 0.02

/* The largest share of a depth's PSF that its two neighbours may leave unexplained for the optics between depths to be
 * known; half way between depths the share is about a quarter (docs/explanation/surfaces.md).
 */
#define MOST_UNEXPLAINED 0.8

static hada_surface_camera camera_of(const hada_pipeline *pipeline)
{
    const hada_model_info *info = hada_model_get_info(pipeline->setup->model);
    size_t offset;
    const cl_mem otf = hada_constants_otf(pipeline->constants, &offset);
    return (hada_surface_camera){.rows = info->grid_rows,
                                 .cols = info->grid_cols,
                                 .channels = info->channels,
                                 .depths = pipeline->setup->config.depths,
                                 .otf = otf,
                                 .first = offset / pipeline->constants->bank->layout.count};
}

static hada_surface_shape shape_of(const hada_pipeline *pipeline)
{
    const hada_refine_shape refine = hada_refine_shape_of(hada_model_get_info(pipeline->setup->model), 1, 1);
    return (hada_surface_shape){
        .frame = refine.frame, .window = refine.window, .boundary = refine.boundary, .weighs = 1};
}

/* The camera and the window, as for hada_surface_create(); the depths' distances; device memory that each pipeline has
 * for a surface. */
typedef struct surface_desc {
    hada_surface_camera camera;
    hada_surface_shape shape;
    const double *distances_mm;
    uint64_t most_bytes;
} surface_desc;

static hada_status check_law(const hada_magnification *law, hada_error *err)
{
    const double unexplained = law->unexplained[law->kind];
    if (unexplained < MOST_UNEXPLAINED)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_MODEL,
                     "neighbouring depths of this camera have too little in common for optics between them "
                     "(%.0f %% of a PSF stays unexplained): learn more depths, or take options.scene planes",
                     100 * unexplained);
}

static hada_status check_memory(const hada_context *context, const surface_desc *desc, uint64_t bytes, hada_error *err)
{
    if (bytes <= desc->most_bytes)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                     "a surface takes %.0f MiB of %s on each queue, and %.0f MiB are left for it: take fewer queues, "
                     "fewer depths (options.depths), or options.scene planes",
                     (double)bytes / 0x1p20, context->info.name, (double)desc->most_bytes / 0x1p20);
}

/* What measuring the law takes at most or, once it is known, a surface: *each, and at most while it is made. */
static hada_status count(const hada_context *context, const surface_desc *desc, const hada_magnification *law,
                         uint64_t *each, uint64_t *most, hada_error *err)
{
    hada_dry dry;
    hada_surface *surface = NULL;
    hada_magnification unused;
    hada_dry_begin(&dry, context);
    const hada_status status =
        law->depths ? hada_surface_create(&surface, &dry.slot, &desc->camera, &desc->shape, law, err)
                    : hada_magnification_measure(&unused, &dry.slot, &desc->camera, desc->distances_mm, err);
    *each = hada_context_bytes(&dry.context);
    *most = hada_context_peak_bytes(&dry.context);
    hada_surface_destroy(&surface);
    hada_dry_end(&dry);
    return status;
}

/* With the lock held. The same answer for each pipeline of a plan, so that results do not depend on who takes a frame:
 * HADA_ERROR_MODEL where the camera has no optics between its depths, HADA_ERROR_DEVICE_MEMORY where a surface and its
 * making take more than most_bytes; nothing is allocated then. */
static hada_status make(hada_on_demand *all, hada_surface **out, hada_slot *slot, const surface_desc *desc,
                        hada_error *err)
{
    uint64_t most;
    if (!all->law.depths) {
        HADA_TRY(count(slot->context, desc, &all->law, &all->surface_bytes, &most, err));
        HADA_TRY(check_memory(slot->context, desc, most, err));
        HADA_TRY(hada_magnification_measure(&all->law, slot, &desc->camera, desc->distances_mm, err));
    }
    HADA_TRY(check_law(&all->law, err));
    HADA_TRY(count(slot->context, desc, &all->law, &all->surface_bytes, &most, err));
    HADA_TRY(check_memory(slot->context, desc, most, err));
    HADA_TRY(hada_surface_create(out, slot, &desc->camera, &desc->shape, &all->law, err));
    all->surfaces++;
    return HADA_OK;
}

static hada_status make_surface(hada_pipeline *pipeline, hada_error *err)
{
    hada_on_demand *all = pipeline->constants->on_demand;
    surface_desc desc = {
        .camera = camera_of(pipeline), .shape = shape_of(pipeline), .distances_mm = pipeline->setup->distances};
    HADA_TRY(hada_pipeline_room(pipeline, &desc.most_bytes, err));
    pthread_mutex_lock(&all->lock);
    const hada_status status = make(all, &pipeline->surface, pipeline->slot, &desc, err);
    pthread_mutex_unlock(&all->lock);
    return status;
}

/* What a scene may be without: where it was not asked for, planes have to do. */
static hada_status ready(hada_pipeline *pipeline, int *found, hada_error *err)
{
    const int asked = pipeline->setup->config.scene == HADA_SCENE_SURFACE;
    hada_error error = {0};
    *found = !pipeline->no_surface;
    if (pipeline->surface || pipeline->no_surface)
        return HADA_OK;
    const hada_status status = make_surface(pipeline, &error);
    if (status == HADA_OK)
        return HADA_OK;
    if (asked || (status != HADA_ERROR_MODEL && status != HADA_ERROR_DEVICE_MEMORY)) {
        if (err)
            *err = error;
        return status;
    }
    hada_log(pipeline->constants->context, status == HADA_ERROR_MODEL ? HADA_LOG_INFO : HADA_LOG_WARNING,
             "planes are taken, for surfaces are not possible: %s", error.message);
    pipeline->no_surface = 1;
    *found = 0;
    return HADA_OK;
}

hada_status hada_pipeline_find_surface(hada_pipeline *pipeline, hada_frame *frame, double enough, int *found,
                                       double *energy, hada_error *err)
{
    hada_surface_rule rule;
    hada_surface_result *result = &pipeline->shape;
    hada_slot_stage(pipeline->slot, "surface");
    HADA_TRY(ready(pipeline, found, err));
    if (!*found)
        return HADA_OK;
    hada_surface_rule_init(&rule);
    rule.enough = enough;
    rule.frame = frame->exposure.energy;
    const hada_surface_frame seen = {.spectrum = pipeline->stage->spectrum.mem,
                                     .pixels = pipeline->maker.data.frame,
                                     .weights = pipeline->maker.data.weights};
    HADA_TRY(hada_maker_weigh(&pipeline->maker, &frame->exposure, err));
    HADA_TRY(hada_surface_run(pipeline->surface, &seen, &rule, result, err));
    *found = !result->in_vain;
    if (*found)
        *energy = result->energy[result->levels - 1];
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_refine, err);
}

static int clamp(int i, int n)
{
    return i < 0 ? 0 : i >= n ? n - 1 : i;
}

/* The mean over channels, and over the pixels around (row, col) that the focus of planes looks at, too. */
static double light_near(const hada_image *image, int row, int col)
{
    enum { NEAR = HADA_FOCUS_NEAR, SIDE = 2 * NEAR + 1 };
    double sum = 0.0;
    for (int c = 0; c < image->channels; c++)
        for (int i = row - NEAR; i <= row + NEAR; i++) {
            const float *line = image->data + (size_t)(c * image->rows + clamp(i, image->rows)) * (size_t)image->cols;
            for (int k = col - NEAR; k <= col + NEAR; k++)
                sum += line[clamp(k, image->cols)];
        }
    return sum / (SIDE * SIDE * image->channels);
}

/* Millimetres from depths, which are linear in 1 / distance between those of the camera; NaN where there is no light
 * but noise, or the light is from outside this range. */
static void fill_distances(const hada_pipeline *pipeline, hada_frame *frame)
{
    hada_result *result = frame->result;
    const double *mm = pipeline->setup->distances;
    const int channels = result->all_in_focus.channels, last = pipeline->setup->config.depths - 1;
    const size_t area = hada_image_count(&result->distance_map);
    const float *texture = result->all_in_focus.data;
    const double noise = hada_pipeline_noise_light(frame);
    double mean = 0.0;
    for (size_t i = 0; i < area * (size_t)channels; i++)
        mean += texture[i];
    mean /= (double)area;
    for (size_t i = 0; i < area; i++) {
        const double depth = fmin(fmax(pipeline->shape.depth[i], 0.0), last);
        const int low = depth < last ? (int)depth : last - 1;
        const double part = depth - low;
        double light = 0.0;
        for (size_t c = 0; c < (size_t)channels; c++)
            light += texture[c * area + i];
        const int at = (int)i, cols = result->distance_map.cols;
        const int known = light > DARK * mean && !pipeline->shape.outside[i] &&
                          light_near(&result->all_in_focus, at / cols, at % cols) > noise;
        result->distance_map.data[i] = known ? (float)(1.0 / ((1.0 - part) / mm[low] + part / mm[low + 1])) : NAN;
        result->memory->confidence.data[i] = known ? pipeline->shape.confidence[i] : 0.0F;
    }
}

/* The planes of the stack: the texture's shares, at the depths next to it. */
static hada_status read_planes(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const int depths = pipeline->setup->config.depths;
    const size_t values = hada_plane_values(hada_model_get_info(pipeline->setup->model));
    const hada_buffer planes = {.mem = hada_refiner_planes(pipeline->refiner),
                                .bytes = values * (size_t)depths * sizeof(float)};
    unsigned char *occupied = frame->result->memory->occupied;
    hada_report *report = &frame->result->memory->report;
    const size_t area = hada_image_count(&frame->result->distance_map);
    memset(occupied, 0, (size_t)depths);
    report->occupied_count = 0;
    for (size_t i = 0; i < area; i++) {
        const float depth = pipeline->shape.depth[i];
        occupied[(int)floorf(depth)] = occupied[(int)ceilf(depth)] = 1;
    }
    HADA_TRY(hada_surface_planes(pipeline->surface, planes.mem, err));
    for (int z = 0; z < depths; z++) {
        report->occupied_count += occupied[z];
        if (occupied[z])
            HADA_TRY(hada_pipeline_read_planes(pipeline, frame, &planes, z, z, 1, err));
    }
    return hada_pipeline_dark_planes(pipeline, frame, err);
}

hada_status hada_pipeline_take_surface(hada_pipeline *pipeline, hada_frame *frame, double energy, hada_error *err)
{
    hada_result *result = frame->result;
    hada_report *report = &result->memory->report;
    const hada_cl_arrays *device = &result->memory->device;
    const size_t texture = hada_image_count(&result->all_in_focus), map = hada_image_count(&result->distance_map);
    const hada_buffer view = {.mem = pipeline->shape.texture, .bytes = texture * sizeof(float)};
    report->scene = HADA_SCENE_SURFACE;
    report->refine_steps = pipeline->shape.steps;
    if (frame->exposure.energy > 0)
        report->residual = sqrt(energy / frame->exposure.energy);
    HADA_TRY(hada_result_make_confidence(result, err));
    HADA_TRY(hada_pipeline_enhance(pipeline, frame, view.mem, 1, 1, err));
    HADA_TRY(hada_pipeline_lap(pipeline, frame, &report->seconds_enhance, err));
    hada_slot_stage(pipeline->slot, "download");
    HADA_TRY(hada_buffer_read(&view, pipeline->slot, 0, result->all_in_focus.data, view.bytes, err));
    fill_distances(pipeline, frame);
    if (device->all_in_focus)
        HADA_TRY(hada_buffer_copy(pipeline->slot, view.mem, 0, device->all_in_focus, device->all_in_focus_offset,
                                  view.bytes, err));
    if (device->distance_map) {
        hada_buffer callers = {.mem = device->distance_map, .bytes = device->distance_map_offset + map * sizeof(float)};
        HADA_TRY(hada_buffer_write(&callers, pipeline->slot, device->distance_map_offset, result->distance_map.data,
                                   map * sizeof(float), err));
    }
    return read_planes(pipeline, frame, err);
}
