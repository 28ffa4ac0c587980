/* The path of a frame that is taken for a volume: light at all depths, by Richardson-Lucy
 * (docs/explanation/surfaces.md#volumes). */

#include "core/base.h"
#include "engine/stages.h"

/* A frame is a volume if its light fills few voxels, in units of a plane's pixels, which are the unknowns of a single
 * plane. After FIRST iterations emitters in 24 and 40 depths filled 0.007 to 0.3; photographs, text and vessels 0.8 to
 * 21. Where it is less than DOUBT, more iterations tell: hundreds of emitters filled 0.3 to 0.7, vessels 1.2 and more,
 * and text as little as 0.3, but its neighbouring pixels are at the same depth (docs/explanation/surfaces.md#volumes).
 * Light that leaves more energy than so much of the frame's, and of its noise's, is no explanation. */
enum { FIRST = 24, SECOND = 50 };
#define FIRST_VOXELS  0.5
#define DOUBT         4.0
#define SECOND_VOXELS 0.8
#define SECOND_MIXED  0.75
#define FIRST_LEFT    0.25
#define FIRST_NOISE   1.5

/* Else it is one if planes, or a surface, leave more than this many times what the volume does, and than the frame's
 * noise, and the volume's light fills fewer voxels than a surface has unknowns. */
#define CLEARLY     1.21
#define MOST_VOXELS 2.0

/* Where the camera's frames have held-out pixels, it is one if planes, or a surface, leave more than this many times
 * what the volume leaves of these. */
#define PREDICTS 0.98

/* The search for hidden depths and for a surface takes longer. Before it, a frame is a volume if the volume predicts
 * held-out pixels better than the depths found so far, and these limits hold: the width of its Gaussians (text has
 * narrower ones, noisy photographs wider ones); the share of the depths that have light; how mixed the depths of
 * neighbouring pixels are; voxels with light for each pixel; and, for a single plane, what it leaves in units of the
 * noise's energy, up to 1.03 where it was right and 1.11 or more for dense tissue (perf/results/tissue.md). */
#define PLAIN_NOISE  1.06
#define PLAIN_LEAST  0.6
#define PLAIN_MOST   1.6
#define PLAIN_DEPTHS 0.94
#define PLAIN_MIXED  0.6
#define PLAIN_VOXELS 8.5

/* In any case light is at more than this share of the depths. */
#define LEAST_DEPTHS 0.5

enum {
    BLOCK = 12,   /* pixels a side, among which depths are mixed or alike */
    HELD_OUT = 8, /* pixels a side of blocks that are held out to find the width of tissue's Gaussians */
    LAST = 40     /* iterations with that width on the whole frame */
};

/* Bytes of the transfer functions and of a pipeline's part, without allocating. */
static hada_status count(const hada_on_demand *all, const hada_pipeline *pipeline, uint64_t *optics, uint64_t *each,
                         hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    hada_classic *classic = NULL;
    hada_buffer trial = {0};
    hada_dry dry;
    hada_status status = HADA_OK;
    hada_dry_begin(&dry, pipeline->slot->context);
    HADA_TRY_OR_DONE(
        hada_classic_optics(&trial, &dry.context, &all->shape, setup->model, setup->depths, setup->config.depths, err));
    *optics = hada_context_peak_bytes(&dry.context);
    const uint64_t before = hada_context_bytes(&dry.context);
    HADA_TRY_OR_DONE(hada_classic_create(&classic, &dry.slot, &all->shape, err));
    *each = hada_context_bytes(&dry.context) - before;
done:
    hada_classic_destroy(&classic);
    hada_buffer_destroy(&trial);
    hada_dry_end(&dry);
    return status;
}

/* With the lock held: what all pipelines of the device share. A volume may take half of the room, for a surface may
 * follow. */
static hada_status prepare(hada_on_demand *all, const hada_pipeline *pipeline, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const int depths = setup->config.depths;
    hada_context *context = pipeline->constants->context;
    uint64_t room, optics, each;
    if (all->volumes_known)
        return HADA_OK;
    HADA_TRY(hada_config_volume(&setup->config, hada_model_get_info(setup->model), &all->shape, err));
    HADA_TRY(hada_classic_fit_grid(&all->shape, context, setup->model, setup->depths, depths, err));
    HADA_TRY(hada_pipeline_room(pipeline, &room, err));
    HADA_TRY(count(all, pipeline, &optics, &each, err));
    all->volumes_known = -1;
    if (optics + each > room / 2) {
        hada_log(
            context, HADA_LOG_WARNING,
            "a volume takes %.0f MiB more on the device, and %.0f MiB are left for it: frames are taken for planes "
            "or surfaces",
            (double)(optics + each) / 0x1p20, (double)room / 2 / 0x1p20);
        return HADA_OK;
    }
    HADA_TRY(hada_classic_camera_of(&all->camera, setup->model, setup->depths, depths, err));
    HADA_TRY(hada_classic_optics(&all->optics, context, &all->shape, setup->model, setup->depths, depths, err));
    all->volume_bytes = each;
    all->volumes_known = 1;
    return HADA_OK;
}

static hada_status make(hada_on_demand *all, hada_pipeline *pipeline, hada_error *err)
{
    HADA_TRY(prepare(all, pipeline, err));
    if (all->volumes_known < 0)
        return HADA_OK;
    HADA_TRY(hada_classic_create(&pipeline->volume, pipeline->slot, &all->shape, err));
    all->volumes++;
    return HADA_OK;
}

static hada_status ready(hada_pipeline *pipeline, hada_error *err)
{
    hada_on_demand *all = pipeline->constants->on_demand;
    if (pipeline->volume)
        return HADA_OK;
    pthread_mutex_lock(&all->lock);
    const hada_status status = make(all, pipeline, err);
    pthread_mutex_unlock(&all->lock);
    return status;
}

/* How light is spread: the voxels that hold it, in units of a plane's pixels, and the depths, of all: both count by the
 * square of the sum over the sum of squares; the variance of depths within blocks of pixels, of that of all light. */
typedef struct spread {
    double voxels, depths, mixed;
} spread;

typedef struct moments {
    double light, first, second; /* sums of light, of light times depth, and times its square */
} moments;

static double variance(const moments *m)
{
    return m->light > 0.0 ? m->second - m->first * m->first / m->light : 0.0;
}

static void add_light(moments *m, double light, int depth)
{
    m->light += light;
    m->first += light * depth;
    m->second += light * depth * depth;
}

static hada_status spread_of(const hada_pipeline *pipeline, const hada_result *result, spread *out, hada_error *err)
{
    const int depths = pipeline->setup->config.depths;
    const int rows = result->planes[0].rows, cols = result->planes[0].cols;
    const int across = (cols + BLOCK - 1) / BLOCK, down = (rows + BLOCK - 1) / BLOCK;
    const size_t values = hada_image_count(&result->planes[0]);
    moments *blocks = NULL, all = {0};
    double squares = 0.0, squares_of_depths = 0.0, within = 0.0;
    HADA_TRY(HADA_NEW(blocks, (size_t)across * (size_t)down, "the depths of light", err));
    for (int z = 0; z < depths; z++) {
        double light = 0.0;
        for (size_t i = 0; i < values; i++) {
            const double value = result->planes[z].data[i];
            const int row = (int)(i / (size_t)cols) % rows, col = (int)(i % (size_t)cols);
            light += value;
            squares += value * value;
            add_light(&blocks[row / BLOCK * across + col / BLOCK], value, z);
        }
        add_light(&all, light, z);
        squares_of_depths += light * light;
    }
    for (int i = 0; i < across * down; i++)
        within += variance(&blocks[i]);
    free(blocks);
    *out = (spread){INFINITY, 0.0, 0.0};
    if (all.light > 0.0)
        *out = (spread){all.light * all.light / (squares * (double)values),
                        all.light * all.light / (squares_of_depths * depths), within / fmax(variance(&all), 1e-300)};
    return HADA_OK;
}

/* The method: of a plan for volumes, or made when a frame first needed it. */
static hada_classic *method_of(const hada_pipeline *pipeline)
{
    return pipeline->classic ? pipeline->classic : pipeline->volume;
}

/* Of a plan for volumes, whose work is that of emitters: tissue takes up to four times as many iterations. */
static void tell_progress(void *user, int iterations)
{
    hada_frame *frame = user;
    hada_frame_progress(frame, hada_least(1 + iterations / 4, frame->work - 1));
}

/* Its job; `data` takes what the maker has now. */
static hada_classic_job job_of(const hada_pipeline *pipeline, hada_frame *frame, hada_refine_data *data)
{
    const hada_on_demand *all = pipeline->constants->on_demand;
    *data = pipeline->maker.data;
    if (!pipeline->classic) {
        data->otf = all->optics.mem;
        data->otf_offset = 0;
    }
    return (hada_classic_job){.data = data,
                              .camera = pipeline->classic ? &pipeline->setup->camera : &all->camera,
                              .depths = pipeline->setup->config.depths,
                              .list = pipeline->all,
                              .brightness = hada_exposure_light(&frame->exposure),
                              .progress = pipeline->classic ? tell_progress : NULL,
                              .user = frame};
}

/* Goes on to so many iterations. */
static hada_status iterate(hada_pipeline *pipeline, hada_frame *frame, int iterations, hada_error *err)
{
    hada_refine_data data;
    if (!pipeline->volume_now.iterations) /* then the method has a copy of the weights */
        HADA_TRY(hada_maker_weigh(&pipeline->maker, &frame->exposure, err));
    hada_classic_job job = job_of(pipeline, frame, &data);
    job.iterations = iterations;
    job.before = pipeline->volume_now.iterations;
    return hada_classic_run(method_of(pipeline), &job, &pipeline->volume_now, err);
}

/* Where the light of what was found is: on the occupied depths, or between the planes next to the surface. */
static float *make_support(const hada_pipeline *pipeline, const hada_support_of *of, int haze, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(pipeline->setup->model);
    const size_t cols = (size_t)info->window_cols, pitch = hada_classic_pitch(info->window_cols),
                 rows = (size_t)info->channels * (size_t)info->window_rows;
    const int depths = pipeline->setup->config.depths;
    double lit = 0.0; /* haze begins with the same part of all light as where it is everywhere */
    float *support = NULL;
    if (HADA_NEW(support, (size_t)(depths + haze) * rows * pitch, "where light is", err))
        return NULL;
    for (int z = 0, k = 0; z < depths + haze; z++) {
        const int occupied = k < of->count && pipeline->occupied[k] == z;
        k += occupied;
        for (size_t i = 0; i < rows * cols; i++) {
            const size_t pixel = i % ((size_t)info->window_rows * cols);
            const int on = of->surface ? fabsf(pipeline->shape.depth[pixel] - (float)z) < 1.0F : occupied;
            const double value = z < depths ? on : lit / ((double)depths * (double)(rows * cols));
            lit += z < depths ? on : 0;
            support[((size_t)z * rows + i / cols) * pitch + i % cols] = (float)value;
        }
    }
    return support;
}

/* The same with haze, where the method has any. */
static hada_classic_job tissue_of(const hada_pipeline *pipeline, hada_frame *frame, hada_refine_data *data)
{
    const hada_classic_shape *shape =
        pipeline->classic ? &pipeline->setup->config.method : &pipeline->constants->on_demand->shape;
    hada_classic_job job = job_of(pipeline, frame, data);
    job.depths += shape->haze;
    data->otf_depths += shape->haze;
    return job;
}

/* The volume from nothing: pipeline->sieved, with Gaussians of the width that predicts held-out pixels best. */
static hada_status find_width(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_plane_maker *maker = &pipeline->maker;
    hada_refine_data data;
    HADA_TRY(hada_maker_hold_out(maker, &frame->exposure, HELD_OUT, 0, err));
    const hada_classic_job job = tissue_of(pipeline, frame, &data);
    HADA_TRY(hada_classic_sieve(method_of(pipeline), &job, maker->held.mem, &pipeline->sieved, err));
    return hada_maker_weigh(maker, &frame->exposure, err);
}

/* After find_width(): how much of the held-out pixels light at what was found beside leaves, of what the volume leaves.
 */
static hada_status compare(hada_pipeline *pipeline, hada_frame *frame, const hada_support_of *against, double *gain,
                           hada_error *err)
{
    hada_plane_maker *maker = &pipeline->maker;
    const hada_classic_sieved *sieved = &pipeline->sieved;
    hada_refine_data data;
    float *support = NULL;
    double left;
    hada_status status = HADA_OK;
    HADA_TRY(hada_maker_hold_out(maker, &frame->exposure, HELD_OUT, 0, err));
    const hada_classic_job job = tissue_of(pipeline, frame, &data);
    support = make_support(pipeline, against, job.depths - pipeline->setup->config.depths, err);
    HADA_TRY_OR_DONE(hada_allocated(support));
    HADA_TRY_OR_DONE(
        hada_classic_sieve_within(method_of(pipeline), &job, maker->held.mem, sieved, support, &left, err));
    *gain = left / sieved->left;
    hada_log(pipeline->slot->context, HADA_LOG_INFO,
             "a volume: Gaussians of %.1f pixels; of held-out pixels %s leaves %.3f of what it does", sieved->width,
             against->surface ? "the surface" : "light at the depths found", *gain);
    HADA_TRY_OR_DONE(hada_maker_weigh(maker, &frame->exposure, err));
done:
    free(support);
    return status;
}

/* The last iterations see the whole frame. */
static hada_status finish_tissue(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_refine_data data;
    hada_classic_job job = tissue_of(pipeline, frame, &data);
    job.sieve = pipeline->sieved.width;
    job.anew = 1;
    job.before = pipeline->sieved.iterations;
    job.iterations = job.before + LAST;
    return hada_classic_run(method_of(pipeline), &job, &pipeline->volume_now, err);
}

/* How the light is spread now. */
static hada_status look_at(hada_pipeline *pipeline, hada_frame *frame, spread *light, hada_error *err)
{
    const int depths = pipeline->setup->config.depths;
    const size_t bytes = hada_image_count(&frame->result->planes[0]) * sizeof(float);
    const hada_buffer view = {.mem = hada_classic_planes(method_of(pipeline)), .bytes = bytes * (size_t)depths};
    for (int z = 0; z < depths; z++)
        HADA_TRY(hada_buffer_read(&view, pipeline->slot, (size_t)z * bytes, frame->result->planes[z].data, bytes, err));
    return spread_of(pipeline, frame->result, light, err);
}

/* The same after so many iterations. */
static hada_status look(hada_pipeline *pipeline, hada_frame *frame, int iterations, spread *light, hada_error *err)
{
    HADA_TRY(iterate(pipeline, frame, iterations, err));
    return look_at(pipeline, frame, light, err);
}

static hada_status take(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_report *report = &frame->result->memory->report;
    if (pipeline->volume_now.iterations < HADA_VOLUME_ITERATIONS)
        HADA_TRY(iterate(pipeline, frame, HADA_VOLUME_ITERATIONS, err));
    memcpy(pipeline->occupied, pipeline->all, (size_t)pipeline->setup->config.depths * sizeof *pipeline->all);
    report->scene = HADA_SCENE_VOLUME;
    report->method = HADA_METHOD_RL;
    report->refine_steps = pipeline->volume_now.iterations;
    report->residual = sqrt(pipeline->volume_now.energy / frame->exposure.energy);
    report->residual_linear = NAN;
    report->refine_tv = report->refine_tv_factor = 0.0;
    report->refine_tv_kept = 0;
    return HADA_OK;
}

/* Whether the first iterations tell that it is a volume. */
static hada_status is_plain(hada_pipeline *pipeline, hada_frame *frame, double noise, int *found, hada_error *err)
{
    spread light;
    HADA_TRY(look(pipeline, frame, FIRST, &light, err));
    *found = light.voxels < FIRST_VOXELS;
    if (!*found && light.voxels < DOUBT && light.depths > LEAST_DEPTHS) {
        HADA_TRY(look(pipeline, frame, SECOND, &light, err));
        *found = light.voxels < SECOND_VOXELS && light.mixed > SECOND_MIXED;
    }
    *found = *found && light.depths > LEAST_DEPTHS &&
             pipeline->volume_now.energy < fmax(FIRST_LEFT * frame->exposure.energy, FIRST_NOISE * noise);
    return HADA_OK;
}

/* Whether a volume explains the frame clearly better than what leaves so much. */
static hada_status is_better(hada_pipeline *pipeline, hada_frame *frame, double noise, double energy, int *found,
                             hada_error *err)
{
    spread light;
    HADA_TRY(look(pipeline, frame, HADA_VOLUME_ITERATIONS, &light, err));
    *found = energy > CLEARLY * fmax(pipeline->volume_now.energy, noise) && light.depths > LEAST_DEPTHS &&
             light.voxels < MOST_VOXELS;
    return HADA_OK;
}

/* Whether a volume predicts held-out pixels clearly better than what was found; early: whether that is plain. */
static hada_status is_tissue(hada_pipeline *pipeline, hada_frame *frame, const hada_support_of *against, int *found,
                             hada_error *err)
{
    const hada_classic_sieved *sieved = &pipeline->sieved;
    spread light;
    double gain = 0.0;
    if (!sieved->iterations)
        HADA_TRY(find_width(pipeline, frame, err));
    HADA_TRY(look_at(pipeline, frame, &light, err));
    const int possible = against->early ? sieved->width > PLAIN_LEAST && sieved->width < PLAIN_MOST &&
                                              light.depths > PLAIN_DEPTHS && light.mixed > PLAIN_MIXED &&
                                              light.voxels < PLAIN_VOXELS
                                        : light.depths > LEAST_DEPTHS;
    if (possible)
        HADA_TRY(compare(pipeline, frame, against, &gain, err));
    *found = possible && gain > (against->early ? 1.0 : PREDICTS);
    return *found ? finish_tissue(pipeline, frame, err) : HADA_OK;
}

hada_status hada_pipeline_find_volume(hada_pipeline *pipeline, hada_frame *frame, double energy,
                                      const hada_support_of *against, int *found, hada_error *err)
{
    const double noise = hada_exposure_noise_energy(&frame->exposure);
    *found = 0;
    const int early = against && against->early;
    const int explained = energy >= 0.0 && energy <= (early ? PLAIN_NOISE : CLEARLY) * noise;
    const int tissue = energy >= 0.0 && pipeline->maker.held.mem != NULL;
    if (!(frame->exposure.energy > 0) || (early && !tissue) ||
        (explained && !(tissue && (against->surface || against->count > 1))))
        return HADA_OK;
    hada_slot_stage(pipeline->slot, "volume");
    HADA_TRY(ready(pipeline, err));
    if (!pipeline->volume)
        return HADA_OK;
    HADA_TRY(energy < 0.0 ? is_plain(pipeline, frame, noise, found, err)
             : tissue     ? is_tissue(pipeline, frame, against, found, err)
                          : is_better(pipeline, frame, noise, energy, found, err));
    if (*found)
        HADA_TRY(take(pipeline, frame, err));
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_refine, err);
}

hada_status hada_pipeline_solve_volume(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    int plain = 1;
    if (frame->exposure.energy > 0)
        HADA_TRY(is_plain(pipeline, frame, hada_exposure_noise_energy(&frame->exposure), &plain, err));
    if (!plain) {
        HADA_TRY(find_width(pipeline, frame, err));
        HADA_TRY(finish_tissue(pipeline, frame, err));
    }
    return take(pipeline, frame, err);
}
