/* What the options come to for a model, then what is known on the host before any frame comes. */

#include "engine/setup.h"

#include <float.h>

#include "core/callers.h"
#include "refine/proximal.h"

enum {
    LEAST_DEPTHS = 3,  /* of a surface: two do not determine the law between them */
    LEAST_VOLUME = 8,  /* of a volume that nobody asked for: among fewer depths scenes are planes or surfaces */
    VOLUME_FIRST = 16, /* with so many, searching them takes longer than finding a volume */
    MOST_QUEUES = 64,  /* of a device: more than any needs to be kept busy */
    BATCH = 8          /* depths at once: more only cost memory, the spectrum stays in the cache either way */
};

#define MOST_GAMMA 100.0 /* with more, all but white is black */

/* What is given is used: a dark frame, a dark level or a list of occupied depths says that it is meant, where the
 * member that chooses among them has its default. */
static hada_status settle(hada_plan_options *o, hada_error *err)
{
    if ((unsigned)o->dark > HADA_DARK_FRAME || (unsigned)o->occupied > HADA_OCCUPIED_LIST)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.dark is %d and options.occupied %d: they are HADA_DARK_... and HADA_OCCUPIED_...",
                         (int)o->dark, (int)o->occupied);
    if (o->dark == HADA_DARK_MODEL && (o->dark_frame || o->dark_level != 0.0))
        o->dark = o->dark_frame ? HADA_DARK_FRAME : HADA_DARK_LEVEL;
    if (o->occupied == HADA_OCCUPIED_AUTO && o->occupied_list)
        o->occupied = HADA_OCCUPIED_LIST;
    if ((o->dark_frame && o->dark != HADA_DARK_FRAME) || (o->dark_level != 0.0 && o->dark != HADA_DARK_LEVEL))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.dark is %d, options.dark_level %g, and options.dark_frame is %s: give one of the "
                         "last two alone",
                         (int)o->dark, o->dark_level, o->dark_frame ? "given" : "not");
    if (o->dark == HADA_DARK_FRAME && !o->dark_frame)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.dark is HADA_DARK_FRAME, but options.dark_frame is NULL");
    if (o->dark_level == HADA_AUTO) {
        o->dark = HADA_DARK_AUTO;
        o->dark_level = 0.0;
    }
    if (!(o->dark_level >= 0.0 && isfinite(o->dark_level)))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.dark_level is %g; it is finite and not negative, or HADA_AUTO", o->dark_level);
    if (!o->depths != !o->depth_count || o->depth_count < 0)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.depth_count is %d, and options.depths is %s",
                         o->depth_count, o->depths ? "a list" : "NULL");
    if (!o->occupied_list != !o->occupied_count || o->occupied_count < 0 ||
        (o->occupied == HADA_OCCUPIED_LIST) != (o->occupied_list != NULL))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.occupied is %d, options.occupied_count %d, and options.occupied_list is %s",
                         (int)o->occupied, o->occupied_count, o->occupied_list ? "a list" : "NULL");
    return HADA_OK;
}

static hada_status check_list(const int *list, int count, int limit, const char *what, hada_error *err)
{
    for (int i = 0; i < count; i++)
        if (list[i] < 0 || list[i] >= limit || (i && list[i] <= list[i - 1]))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "%s: index %d is out of order or outside 0 to %d; give depths once each, near to far",
                             what, list[i], limit - 1);
    return HADA_OK;
}

static hada_status check_numbers(const hada_plan_options *options, hada_error *err)
{
    if ((options->batch < 0 && options->batch != HADA_AUTO) || (options->refine < 0 && options->refine != HADA_AUTO) ||
        options->refine > HADA_MODEL_MOST_STEPS)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.batch is %d and options.refine %d: they are HADA_AUTO or 0 and more, and refine at "
                         "most %d",
                         options->batch, options->refine, HADA_MODEL_MOST_STEPS);
    if (!(options->gamma > 0.0 && options->gamma <= MOST_GAMMA))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.gamma is %g; it is above 0 and at most %g", options->gamma,
                         MOST_GAMMA);
    if (!isfinite(options->refine_tv) ||
        (options->refine_tv < 0 && options->refine_tv != HADA_AUTO && options->refine_tv != HADA_REFINE_TV_FRAME))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "plan options: the weight of total variation is %g; it is 0 or more",
                         options->refine_tv);
    if (options->refine_colour != HADA_AUTO && !hada_refine_colour_known(options->refine_colour))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "plan options: the weight of colour in total variation is %g; 1 to %g are possible",
                         options->refine_colour, HADA_REFINE_MOST_COLOUR);
    if (options->refine_ridge != HADA_AUTO && !hada_refine_ridge_known(options->refine_ridge))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "plan options: the strength of the learned regulariser is %g; 0 to %g are possible",
                         options->refine_ridge, HADA_REFINE_MOST_RIDGE);
    if (options->crosstalk != HADA_AUTO && !hada_crosstalk_known(options->crosstalk))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "plan options: the share of crosstalk is %g; 0 to 1 are possible",
                         options->crosstalk);
    if ((options->queues < 0 && options->queues != HADA_AUTO) || options->queues > MOST_QUEUES)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "plan options: %d queues; a device can have 1 to %d",
                         options->queues, MOST_QUEUES);
    if (!(options->max_error >= 0 && options->max_error < 1) || !(options->band > 0 && options->band <= 1) ||
        options->skip & ~(unsigned)HADA_SKIP_ALL)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.max_error takes 0 to below 1, options.band a share above 0 and at most 1, and "
                         "options.skip is made of HADA_SKIP_...; they are %g, %g and %u",
                         options->max_error, options->band, options->skip);
    if ((int)options->scene < HADA_SCENE_AUTO || options->scene > HADA_SCENE_VOLUME)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.scene is %d; it is one of HADA_SCENE_...",
                         (int)options->scene);
    return HADA_OK;
}

static hada_frame_kind kind_of(const hada_model_info *info, const hada_plan_options *options)
{
    const int downsample = options->downsample == HADA_AUTO ? info->downsample : options->downsample;
    const hada_mosaic model = info->sensor_mosaic != HADA_MOSAIC_NONE ? info->sensor_mosaic : info->mosaic;
    if (downsample <= 1)
        return (hada_frame_kind){options->mosaic, 1, HADA_MOSAIC_NONE};
    return (hada_frame_kind){HADA_MOSAIC_NONE, downsample,
                             options->mosaic == HADA_MOSAIC_AUTO ? model : options->mosaic};
}

/* An image beside the frame, which all channels share or each has. */
static hada_status check_frame(const hada_model_info *info, const hada_image *frame, const char *member,
                               hada_error *err)
{
    if (!frame || ((frame->channels == info->channels || frame->channels == 1) && frame->rows == info->raw_rows &&
                   frame->cols == info->raw_cols && frame->data))
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_SIZE, "%s must have %s of %d x %d pixels, as the model; it has %d of %d x %d%s",
                     member, info->channels == 1 ? "1 channel" : "1 or 3 channels", info->raw_rows, info->raw_cols,
                     frame->channels, frame->rows, frame->cols, frame->data ? "" : ", without data");
}

static hada_status check_options(const hada_model_info *info, const hada_plan_options *options, hada_error *err)
{
    HADA_TRY(check_numbers(options, err));
    if (options->depths)
        HADA_TRY(check_list(options->depths, options->depth_count, info->depths, "depths", err));
    if (options->occupied == HADA_OCCUPIED_LIST)
        HADA_TRY(check_list(options->occupied_list, options->occupied_count, info->depths, "occupied depths", err));
    if (options->refine > 0 && !info->has_otf)
        HADA_TRY(
            hada_fail(err, HADA_ERROR_MODEL,
                      "the model %s holds no transfer functions, so nothing can be refined: use options.refine 0, or "
                      "make the model again with fit",
                      info->name));
    HADA_TRY(check_frame(info, options->pixel_weights, "pixel_weights", err));
    HADA_TRY(check_frame(info, options->flat_frame, "flat_frame", err));
    HADA_TRY(check_frame(info, options->dark_frame, "dark_frame", err));
    if (!hada_mosaic_is_known(options->mosaic))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "options.mosaic is %d; it is one of HADA_MOSAIC_...",
                           (int)options->mosaic));
    if (options->downsample < 1 && options->downsample != HADA_AUTO)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "options.downsample is 1 or more, or HADA_AUTO; not %d",
                           options->downsample));
    const hada_frame_kind kind = kind_of(info, options);
    const int mosaic = kind.mosaic == HADA_MOSAIC_AUTO ? (int)info->mosaic : (int)kind.mosaic;
    if (hada_mosaic_is_pattern(kind.sensor_mosaic) && kind.downsample % 2)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "frames of a colour filter mosaic are binned by an even number, not by %d",
                           kind.downsample));
    if ((hada_mosaic_is_pattern(mosaic) || hada_mosaic_is_pattern(kind.sensor_mosaic)) &&
        info->channels != HADA_MOSAIC_COLOURS)
        HADA_TRY(hada_fail(err, HADA_ERROR_MODEL,
                           "a colour filter mosaic needs a model of three channels, and the model %s has %d: leave "
                           "options.mosaic out, or make the model with fit options.mosaic",
                           info->name, info->channels));
    return HADA_OK;
}

/* Half filters change the light on the grid by 2^-11 at most; the planes, which have some of that light, by a few times
 * as much. Each frame is verified. */
static const double half_pays = 0x1p-8;

static int at_least_one(double value)
{
    return value < 1.0 ? 1 : (int)value;
}

/* Whether a frame may be a surface: only where pursuit finds its depths. */
static hada_status choose_scene(const hada_plan_options *options, hada_config *config, hada_error *err)
{
    const int possible = config->pursuit && config->depths >= LEAST_DEPTHS;
    if (options->scene == HADA_SCENE_SURFACE && !possible)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a surface is found among %d depths at least, by refinement: leave options.occupied and "
                         "options.classic out, or take options.scene planes",
                         LEAST_DEPTHS);
    config->scene = possible || options->scene == HADA_SCENE_VOLUME ? options->scene : HADA_SCENE_PLANES;
    return HADA_OK;
}

/* Volumes are looked for among many depths: first of all where these are so many that it takes less time than the
 * pursuit, else where a surface is tried. */
static int choose_volume(const hada_config *config)
{
    if (config->scene != HADA_SCENE_AUTO || config->depths < LEAST_VOLUME)
        return 0;
    return config->depths < VOLUME_FIRST ? 1 : 2;
}

/* Whether light comes from outside the window. Where it is the whole frame of a camera that nobody calibrated, it
 * probably does; a window that somebody named holds the scene, as do surfaces. */
static hada_status choose_support(const hada_model_info *info, const hada_plan_options *options, hada_config *config,
                                  hada_error *err)
{
    const int whole = info->window_rows == info->raw_rows && info->window_cols == info->raw_cols;
    const int probably = info->refine_tv == HADA_AUTO && whole && config->scene == HADA_SCENE_PLANES;
    const int iterates = config->classic && config->method.options.method != HADA_METHOD_WIENER;
    const int possible = config->joint && !config->classic && info->boundary == HADA_BOUNDARY_PADDED;
    if ((int)options->support < HADA_SUPPORT_AUTO || options->support > HADA_SUPPORT_GRID)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.support is %d; it is one of HADA_SUPPORT_...",
                         (int)options->support);
    if (options->support == HADA_SUPPORT_GRID && !possible && !iterates)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the support is the grid only for refinement of a sensor that crops (boundary padded) and for "
                         "methods that iterate: take the window");
    if (options->support == HADA_SUPPORT_GRID && config->scene == HADA_SCENE_SURFACE)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a surface fills the window alone: take the window as support, or planes as scene");
    config->outside =
        possible && (options->support == HADA_SUPPORT_GRID || (options->support == HADA_SUPPORT_AUTO && probably));
    if (options->support == HADA_SUPPORT_GRID && config->scene != HADA_SCENE_VOLUME)
        config->scene = HADA_SCENE_PLANES;
    return HADA_OK;
}

static hada_status choose_skips(const hada_model *model, const hada_plan_options *options, hada_config *config,
                                hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    config->full_grid = config->pursuit && !(options->skip & HADA_SKIP_DEPTHS);
    config->pruned = config->joint || (options->skip & HADA_SKIP_PRUNE);
    if (options->band < 1.0 && config->joint)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a band limits the linear filters, but the planes are to %s, or leave options.band out",
                         config->classic ? "come from another method: take the model's own filters"
                                         : "be refined: add options.refine 0");
    if (options->band < 1.0) {
        config->band_rows = at_least_one(options->band * (info->grid_rows / 2));
        config->band_cols = at_least_one(options->band * (info->grid_cols / 2));
    }
    /* how much a net makes of a change of its planes is not known */
    if (options->max_error > 0 && !config->joint && !config->enhance) {
        config->half_by_error = (options->skip & HADA_SKIP_HALF) && !config->half && options->max_error >= half_pays &&
                                hada_gains_fits_half(model, options->depths, config->depths);
        config->half |= config->half_by_error;
        config->bounded = config->half_by_error || (options->skip & HADA_SKIP_FREQUENCIES);
    }
    config->measured = config->bounded || options->band < 1.0;
    return HADA_OK;
}

static void volume_options(hada_classic_options *classic, hada_support support)
{
    hada_classic_options_init(classic);
    classic->method = HADA_METHOD_RL;
    classic->iterations = HADA_VOLUME_ITERATIONS;
    classic->support = support;
}

/* For tissue: Gaussians, and haze as one depth more. */
static void use_sieve(hada_classic_shape *shape)
{
    shape->sieve = shape->options.support == HADA_SUPPORT_WINDOW;
    shape->haze = shape->sieve && shape->components == 1;
    shape->place.max_planes += shape->haze;
}

hada_status hada_config_volume(const hada_config *config, const hada_model_info *info, hada_classic_shape *shape,
                               hada_error *err)
{
    hada_classic_options classic;
    volume_options(&classic, HADA_SUPPORT_WINDOW);
    HADA_TRY(hada_classic_shape_of(info, config->depths, &classic, shape, err));
    shape->place.boundary = config->boundary;
    if (config->choose)
        use_sieve(shape);
    return HADA_OK;
}

/* The planes come from a classic method, all depths of the list at once. */
static hada_status use_classic(const hada_model_info *info, const hada_plan_options *options, hada_config *config,
                               hada_error *err)
{
    const int listed = options->occupied == HADA_OCCUPIED_LIST && options->occupied_count < config->depths;
    const int depths = listed ? options->occupied_count : config->depths;
    hada_classic_options classic;
    HADA_TRY(HADA_OPTIONS_TAKE(&classic, options->classic, hada_classic_options, err));
    if (options->scene == HADA_SCENE_VOLUME) {
        if (classic.method != HADA_METHOD_MODEL)
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "a volume has a method of its own: leave options.scene volume or options.classic out");
        volume_options(&classic, options->support);
    }
    config->classic = classic.method != HADA_METHOD_MODEL;
    if (config->classic) {
        HADA_TRY(hada_classic_shape_of(info, depths, &classic, &config->method, err));
        if (options->scene == HADA_SCENE_VOLUME && depths == config->depths)
            use_sieve(&config->method);
        config->steps = config->method.options.iterations;
    }
    return HADA_OK;
}

/* HADA_ERROR_MODEL or HADA_ERROR_ARGUMENT where the model cannot do what is asked. */
static hada_status config_of(const hada_model *model, const hada_plan_options *options, hada_config *config,
                             hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    HADA_TRY(check_options(info, options, err));
    *config = (hada_config){.depths = options->depths ? options->depth_count : info->depths};
    config->kind = kind_of(info, options);
    config->mosaic = config->kind.mosaic == HADA_MOSAIC_AUTO ? info->mosaic : config->kind.mosaic;
    /* auto: what leave-one-out found to pay for this camera */
    const hada_maker_way way = hada_maker_way_of(info, options->refine_tv, config->mosaic);
    config->steps = options->refine >= 0 ? options->refine : way.steps;
    config->saturated_steps =
        options->refine < 0 && config->steps > 0 ? hada_most(config->steps, HADA_SATURATED_STEPS) : config->steps;
    config->parting = options->refine < 0 && config->depths > 1;
    config->weights = way.weights;
    if (options->refine_colour >= 0)
        config->weights.colour = options->refine_colour;
    if (options->refine_ridge >= 0)
        config->weights.ridge = options->refine_ridge;
    config->crosstalk = options->crosstalk >= 0 ? options->crosstalk : HADA_CROSSTALK;
    HADA_TRY(use_classic(info, options, config, err));
    if (!config->classic)
        HADA_TRY(hada_model_check_single(info, "linear filters and refinement", err));
    config->joint = config->steps > 0;
    config->choose = config->classic ? config->method.choose : way.choose && config->joint;
    config->keep = config->choose && options->refine_tv != HADA_REFINE_TV_FRAME;
    config->warm = options->warm_start && config->joint && !config->classic;
    const int linear = !config->joint || (config->classic && config->method.options.method == HADA_METHOD_WIENER);
    if (options->pixel_weights && linear)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "linear filters take no weights of pixels: leave the weights out, or refine, or take "
                         "Richardson-Lucy, FISTA or ADMM");
    const int weighted = options->pixel_weights || (config->mosaic && !linear);
    config->boundary = config->choose || weighted ? HADA_BOUNDARY_PADDED : info->boundary;
    config->method.place.boundary = config->boundary;
    config->weighs = config->classic ? hada_classic_weighs(&config->method)
                                     : config->joint && config->boundary == HADA_BOUNDARY_PADDED;
    config->pursuit =
        config->joint && !config->classic && options->occupied == HADA_OCCUPIED_AUTO && config->depths > 1;
    config->dark = options->dark == HADA_DARK_FRAME || (options->dark == HADA_DARK_MODEL && model->info.dark_frame);
    config->enhance = options->enhance && info->enhance && !config->classic;
    /* as chosen with the model's steps; a net was trained behind refined planes alone */
    config->share =
        config->joint && !config->classic && !config->enhance && options->refine < 0 ? info->refine_share : 1.0;
    config->half = options->half || info->half;
    config->bank = !config->joint        ? HADA_BANK_FILTERS
                   : config->share < 1.0 ? HADA_BANK_OTFS | HADA_BANK_FILTERS
                                         : HADA_BANK_OTFS;
    config->batch = options->batch > 0 ? options->batch : BATCH;
    if (config->batch > config->depths)
        config->batch = config->depths;
    config->queues = options->queues > 0 && !config->warm ? options->queues : 1; /* frames wait for each other */
    config->batch_whole = options->batch <= 0 && config->queues == 1;
    hada_focus_options_init(&config->focus, config->joint);
    HADA_TRY(choose_scene(options, config, err));
    HADA_TRY(choose_support(info, options, config, err));
    config->volume = choose_volume(config);
    return choose_skips(model, options, config, err);
}

size_t hada_plane_values(const hada_model_info *info)
{
    return (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols;
}

hada_refine_shape hada_config_refine(const hada_config *config, const hada_model *model)
{
    const int most = config->saturated_steps,
              own = config->parting ? hada_refine_most_steps(most, config->depths) : most;
    const int steps = config->choose && own < HADA_SETTLING_STEPS ? HADA_SETTLING_STEPS : own;
    hada_refine_shape refine = hada_refine_shape_of(hada_model_get_info(model), config->depths, steps);
    refine.settle = config->parting || config->choose;
    refine.tv = config->choose || config->weights.tv > 0;
    refine.boundary = config->boundary;
    refine.ridge = config->weights.ridge > 0;
    refine.past = config->warm;
    if (config->outside) {
        refine.shown = refine.window;
        refine.window = (hada_rectangle){0, 0, refine.grid_rows, refine.grid_cols};
    }
    refine.crosstalk = config->crosstalk > 0 && config->depths > 1;
    return refine;
}

static int is_in(const int *list, int count, int depth)
{
    for (int i = 0; i < count; i++)
        if (list[i] == depth)
            return 1;
    return 0;
}

static hada_status make_lists(hada_setup *setup, const hada_plan_options *options, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(setup->model);
    const size_t depths = (size_t)setup->config.depths;
    HADA_TRY(HADA_NEW(setup->depths, depths, "a plan", err));
    HADA_TRY(HADA_NEW(setup->distances, depths, "a plan", err));
    HADA_TRY(hada_allocated(setup->listed = hada_alloc(depths, 1, "a plan", err)));
    int found = 0;
    for (int i = 0; i < setup->config.depths; i++) {
        setup->depths[i] = options->depths ? options->depths[i] : i;
        setup->distances[i] = info->distances_mm[setup->depths[i]];
        setup->listed[i] = options->occupied != HADA_OCCUPIED_LIST ||
                           is_in(options->occupied_list, options->occupied_count, setup->depths[i]);
        found += setup->listed[i];
    }
    if (!found)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "none of the occupied depths is among the depths to compute"));
    return HADA_OK;
}

/* The listed depths as indices into the model; to be freed. */
static hada_status list_depths(const hada_setup *setup, int **list, int *count, hada_error *err)
{
    *count = 0;
    HADA_TRY(HADA_NEW(*list, (size_t)setup->config.depths, "a plan", err));
    for (int z = 0; z < setup->config.depths; z++)
        if (setup->listed[z])
            (*list)[(*count)++] = setup->depths[z];
    return HADA_OK;
}

static hada_status make_camera(hada_setup *setup, hada_error *err)
{
    int *list = NULL, count;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(list_depths(setup, &list, &count, err));
    HADA_TRY_OR_DONE(hada_classic_camera_of(&setup->camera, setup->model, list, count, err));
done:
    free(list);
    return status;
}

static hada_status copy_weights(hada_setup *setup, const hada_image *weights, hada_error *err)
{
    const int channels = setup->model->info.channels;
    const size_t pixels = (size_t)weights->rows * (size_t)weights->cols, count = hada_image_count(weights);
    hada_image *to = &setup->pixel_weights;
    float largest = 0.0f, least = FLT_MAX;
    for (size_t i = 0; i < count; i++) {
        if (!(weights->data[i] >= 0.0f && weights->data[i] <= FLT_MAX))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "the weights of pixels must be finite and not negative");
        largest = fmaxf(largest, weights->data[i]);
        least = fminf(least, weights->data[i]);
    }
    if (!(largest > 0.0f))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "all weights of pixels are 0: nothing of the frame would be used");
    if (least == largest) /* they are left out: as without weights, bit for bit */
        return HADA_OK;
    HADA_TRY(hada_image_create(to, channels, weights->rows, weights->cols, err));
    for (size_t i = 0; i < hada_image_count(to); i++)
        to->data[i] = weights->data[weights->channels > 1 ? i : i % pixels] / largest;
    return HADA_OK;
}

/* Weights by a flat frame pay where noise without them is so many times as strong, in its variance. */
#define UNEVEN 1.01

/* Whether they pay, or a pixel sees hardly any light; *even: all are alike. */
static int is_uneven(const hada_image *flat, int *even)
{
    double sum = 0.0, inverse = 0.0;
    const size_t count = hada_image_count(flat);
    *even = 1;
    for (size_t i = 0; i < count; i++) {
        const double value = flat->data[i];
        *even &= value == 1.0;
        sum += value;
        inverse += 1.0 / value; /* infinite where it is 0 */
    }
    return sum * inverse > UNEVEN * (double)count * (double)count;
}

/* The caller's flat frame, or the model's. Refinement weighs pixels by it: the variance of what is divided by a
 * sensitivity, most of which is shot noise, is as many times larger. Pixels that see hardly any light have no weight.
 */
static hada_status take_flat(hada_setup *setup, const hada_image *flat, hada_error *err)
{
    const hada_model_info *info = &setup->model->info;
    hada_image *weights = &setup->pixel_weights;
    float largest = 0.0f;
    int even;
    if (flat)
        HADA_TRY(hada_flat_sensitivity(&setup->own_flat, flat, info->channels, setup->config.mosaic, err));
    const hada_image *used = flat ? &setup->own_flat : info->flat;
    if (!used)
        return HADA_OK;
    const int weighs = is_uneven(used, &even), given = weights->data != NULL;
    setup->flat = even ? NULL : used;
    if (!weighs)
        return HADA_OK;
    const size_t count = hada_image_count(used);
    if (!given)
        HADA_TRY(hada_image_create(weights, info->channels, info->raw_rows, info->raw_cols, err));
    for (size_t i = 0; i < count; i++)
        largest = fmaxf(largest, used->data[i]);
    for (size_t i = 0; i < count; i++)
        weights->data[i] = (given ? weights->data[i] : 1.0f) * (used->data[i] / largest);
    return HADA_OK;
}

static int is_dark_same(const hada_image *dark, int a, int b)
{
    const size_t pixels = (size_t)dark->rows * (size_t)dark->cols;
    return !dark->data ||
           !memcmp(dark->data + (size_t)a * pixels, dark->data + (size_t)b * pixels, pixels * sizeof *dark->data);
}

static int is_filter_same(const hada_setup *setup, int a, int b)
{
    const hada_model *model = setup->model;
    const size_t channels = (size_t)model->info.channels, plane = 2 * hada_model_plane(model);
    for (int i = 0; i < setup->config.depths; i++) {
        const size_t at = (size_t)setup->depths[i] * channels * plane, from = at + (size_t)a * plane,
                     to = at + (size_t)b * plane;
        if (model->filter
                ? memcmp(model->filter + from, model->filter + to, plane * sizeof *model->filter)
                : memcmp(model->filter_half + from, model->filter_half + to, plane * sizeof *model->filter_half))
            return 0;
    }
    return 1;
}

static hada_status find_same_channels(hada_setup *setup, hada_error *err)
{
    const size_t channels = (size_t)setup->model->info.channels;
    HADA_TRY(HADA_NEW(setup->same_dark, channels, "a plan", err));
    HADA_TRY(HADA_NEW(setup->same_filter, channels, "a plan", err));
    for (int c = 0; c < setup->model->info.channels; c++) {
        setup->same_dark[c] = setup->same_filter[c] = c;
        for (int before = c - 1; before >= 0; before--) {
            if (is_dark_same(&setup->dark_frame, before, c))
                setup->same_dark[c] = before;
            if (!setup->config.joint && is_filter_same(setup, before, c))
                setup->same_filter[c] = before;
        }
    }
    return HADA_OK;
}

static hada_status make_gains(hada_setup *setup, const hada_context *context, hada_error *err)
{
    const hada_spectrum_layout layout = hada_hadamard_layout(context, hada_model_get_info(setup->model));
    int *list = NULL, count;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(list_depths(setup, &list, &count, err));
    HADA_TRY_OR_DONE(
        hada_gains_create(&setup->gains, setup->model, &layout, list, count, setup->config.half_by_error, err));
done:
    free(list);
    return status;
}

/* An image of the sensor's size is binned into *own, which takes its place. */
static hada_status bin_one(const hada_image **image, hada_image *own, const hada_model_info *info,
                           const hada_frame_kind *kind, hada_error *err)
{
    const hada_image *from = *image;
    if (!from || !from->data || !hada_is_of_sensor(info, kind->downsample, from->rows, from->cols))
        return HADA_OK;
    const hada_mosaic mosaic = from->channels == 1 && info->channels > 1 ? kind->sensor_mosaic : HADA_MOSAIC_NONE;
    *image = own;
    return hada_image_downsample(own, from, kind->downsample, mosaic, 0, err);
}

static hada_status begin(hada_setup *setup, hada_context *context, const hada_plan_options *options, hada_error *err)
{
    const hada_model *model = setup->model;
    HADA_TRY(config_of(model, options, &setup->config, err));
    if (options->pixel_weights)
        HADA_TRY(copy_weights(setup, options->pixel_weights, err));
    if (options->pixel_weights && !setup->pixel_weights.data) {
        hada_plan_options without = *options;
        without.pixel_weights = NULL;
        HADA_TRY(config_of(model, &without, &setup->config, err));
    }
    HADA_TRY(make_lists(setup, options, err));
    if (setup->config.classic)
        HADA_TRY(
            hada_classic_fit_grid(&setup->config.method, context, model, setup->depths, setup->config.depths, err));
    if (setup->config.dark)
        HADA_TRY(hada_dark_of_sensor(&setup->dark_frame, options->dark_frame, model->info.channels,
                                     setup->config.mosaic, err));
    return take_flat(setup, options->flat_frame, err);
}

hada_status hada_setup_begin(hada_setup *setup, hada_context *context, const hada_model *model,
                             const hada_plan_options *options, hada_error *err)
{
    const hada_frame_kind kind = kind_of(&model->info, options);
    hada_plan_options own = *options;
    hada_image binned[3] = {{0}};
    hada_status status = HADA_OK;
    HADA_TRY(settle(&own, err));
    *setup = (hada_setup){.model = hada_model_hold(model), .options = own};
    if (own.dark == HADA_DARK_MODEL)
        own.dark_frame = model->info.dark_frame;
    setup->options.depths = setup->options.occupied_list = NULL;
    setup->options.dark_frame = setup->options.flat_frame = setup->options.pixel_weights = NULL;
    setup->options.classic = NULL;
    HADA_TRY_OR_DONE(bin_one(&own.dark_frame, &binned[0], &model->info, &kind, err));
    HADA_TRY_OR_DONE(bin_one(&own.flat_frame, &binned[1], &model->info, &kind, err));
    HADA_TRY_OR_DONE(bin_one(&own.pixel_weights, &binned[2], &model->info, &kind, err));
    HADA_TRY_OR_DONE(begin(setup, context, &own, err));
done:
    for (size_t i = 0; i < HADA_COUNT(binned); i++)
        hada_image_destroy(&binned[i]);
    return status;
}

/* Where point spread functions are hardly wider than a pixel, frames look as if they had bad ones. The first, the
 * middle and the last depth are looked at. */
#define TOO_SHARP 1.0

static int is_too_sharp(const hada_setup *setup)
{
    const hada_model *model = setup->model;
    const size_t values = 2 * hada_model_plane(model), channels = (size_t)model->info.channels;
    const int last = setup->config.depths - 1, steps = last < 2 ? last : 2;
    if (!model->otf)
        return 1;
    for (int k = 0; k <= steps; k++)
        for (size_t c = 0; c < channels; c++) {
            const size_t depth = (size_t)setup->depths[steps ? k * last / steps : 0];
            if (hada_model_sharpness(model->otf + (depth * channels + c) * values, &model->info) > TOO_SHARP)
                return 1;
        }
    return 0;
}

hada_status hada_setup_make(hada_setup *setup, hada_context *context, const hada_model *model,
                            const hada_plan_options *options, hada_error *err)
{
    HADA_TRY(hada_setup_begin(setup, context, model, options, err));
    if (setup->config.joint && !setup->config.classic && setup->config.weights.tv > 0 && options->refine_tv < 0)
        setup->noise_share = hada_model_noise_share(model);
    if (setup->config.classic)
        HADA_TRY(make_camera(setup, err));
    HADA_TRY(find_same_channels(setup, err));
    setup->bad_pixels = setup->config.joint && !options->pixel_weights && !is_too_sharp(setup);
    return setup->config.measured ? make_gains(setup, context, err) : HADA_OK;
}

void hada_setup_free(hada_setup *setup)
{
    hada_gains_destroy(&setup->gains);
    HADA_FREE(setup->same_dark, setup->same_filter);
    hada_image_destroy(&setup->dark_frame);
    hada_image_destroy(&setup->own_flat);
    hada_image_destroy(&setup->pixel_weights);
    hada_classic_camera_free(&setup->camera);
    HADA_FREE(setup->depths, setup->distances, setup->listed);
    hada_model_destroy(&setup->model);
    *setup = (hada_setup){0};
}
