#include "engine/config.h"

#include <math.h>

#include "core/options.h"
#include "filter/bank.h"
#include "filter/gains.h"

enum { MOST_QUEUES = 64 };

void hada_plan_options_defaults(hada_plan_options *options, size_t size)
{
    const hada_plan_options own = {.size = sizeof own,
                                   .refine = HADA_AUTO,
                                   .refine_tv = HADA_AUTO,
                                   .enhance = 1,
                                   .gamma = 1.0,
                                   .skip = HADA_SKIP_ALL,
                                   .band = 1.0};
    HADA_OPTIONS_GIVE(options, size, &own);
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

static hada_status check_options(const hada_model_info *info, const hada_plan_options *options, hada_error *err)
{
    if (options->depth_count < 0 || options->occupied_count < 0 || options->batch < 0 || !(options->gamma > 0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "plan options: counts are not negative and gamma is above 0");
    if (!isfinite(options->refine_tv))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "plan options: the weight of total variation is not a number");
    if (options->queues < 0 || options->queues > MOST_QUEUES)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "plan options: %d queues; a device can have 1 to %d",
                         options->queues, MOST_QUEUES);
    if (!(options->max_error >= 0 && options->max_error < 1) || !(options->band > 0 && options->band <= 1) ||
        options->skip & ~(unsigned)HADA_SKIP_ALL)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "plan options: max_error is from 0 to below 1, band above 0 and at most 1, and skip made of "
                         "HADA_SKIP_...");
    hada_status status = HADA_OK;
    if (options->depths)
        status = options->depth_count ? check_list(options->depths, options->depth_count, info->depths, "depths", err)
                                      : hada_fail(err, HADA_ERROR_ARGUMENT, "the list of depths is empty");
    if (!status && options->occupied == HADA_OCCUPIED_LIST)
        status = options->occupied_list && options->occupied_count
                     ? check_list(options->occupied_list, options->occupied_count, info->depths, "occupied depths", err)
                     : hada_fail(err, HADA_ERROR_ARGUMENT, "the list of occupied depths is empty");
    if (!status && options->refine > 0 && !info->has_otf)
        status =
            hada_fail(err, HADA_ERROR_MODEL,
                      "the model %s holds no transfer functions, so nothing can be refined: use --refine 0, or make "
                      "the model again with fit",
                      info->name);
    const hada_image *dark = options->dark_frame;
    if (!status && options->dark == HADA_DARK_FRAME &&
        (!dark || dark->channels != info->channels || dark->rows != info->raw_rows || dark->cols != info->raw_cols))
        status =
            hada_fail(err, HADA_ERROR_SIZE, "the dark frame must have %d channel(s) of %d x %d pixels, as the model",
                      info->channels, info->raw_rows, info->raw_cols);
    return status;
}

/* Half filters change the light on the grid by 2^-11 at most; the planes, which have some of that light, by a few times
 * as much. Each frame is verified. */
static const double half_pays = 0x1p-8;

static int at_least_one(double value)
{
    return value < 1.0 ? 1 : (int)value;
}

static hada_status skip_shape(const hada_model *model, const hada_plan_options *options, hada_plan_shape *shape,
                              hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    shape->full_look = shape->pursuit && !(options->skip & HADA_SKIP_DEPTHS);
    shape->pruned = shape->refined || (options->skip & HADA_SKIP_PRUNE);
    if (options->band < 1.0 && shape->refined)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT, "a band limits the linear filters, but the planes are to %s, or leave --band out",
            shape->classic ? "come from another method: take the model's own filters" : "be refined: add --refine 0");
    if (options->band < 1.0) {
        shape->band_rows = at_least_one(options->band * (info->grid_rows / 2));
        shape->band_cols = at_least_one(options->band * (info->grid_cols / 2));
    }
    /* how much a net makes of a change of its planes is not known */
    if (options->max_error > 0 && !shape->refined && !shape->enhance) {
        shape->half_by_error = (options->skip & HADA_SKIP_HALF) && !shape->half && options->max_error >= half_pays &&
                               hada_gains_fits_half(model, options->depths, shape->depths);
        shape->half |= shape->half_by_error;
        shape->bounded = shape->half_by_error || (options->skip & (HADA_SKIP_FREQUENCIES | HADA_SKIP_FRAMES));
    }
    shape->measured = shape->bounded || options->band < 1.0;
    return HADA_OK;
}

/* The planes come from a classic method, all depths of the list at once. */
static hada_status classic_shape(const hada_model_info *info, const hada_plan_options *options, hada_plan_shape *shape,
                                 hada_error *err)
{
    const int listed = options->occupied == HADA_OCCUPIED_LIST && options->occupied_count < shape->depths;
    hada_classic_options classic;
    hada_classic_options_init(&classic);
    hada_status status = HADA_OPTIONS_TAKE(&classic, options->classic, hada_classic_options, err);
    shape->classic = classic.method != HADA_METHOD_MODEL;
    if (status || !shape->classic)
        return status;
    status =
        hada_classic_shape_of(info, listed ? options->occupied_count : shape->depths, &classic, &shape->method, err);
    shape->steps = shape->method.options.iterations;
    return status;
}

hada_status hada_plan_shape_of(const hada_model *model, const hada_plan_options *options, hada_plan_shape *shape,
                               hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    hada_status status = check_options(info, options, err);
    if (status)
        return status;
    *shape = (hada_plan_shape){.depths = options->depths ? options->depth_count : info->depths};
    /* auto: what leave-one-out found to pay for this camera */
    shape->steps = options->refine >= 0 ? options->refine : info->has_otf ? info->refine_steps : 0;
    shape->tv = options->refine_tv >= 0 ? options->refine_tv : info->refine_tv;
    status = classic_shape(info, options, shape, err);
    if (status)
        return status;
    shape->refined = shape->steps > 0;
    shape->pursuit = shape->refined && !shape->classic && options->occupied == HADA_OCCUPIED_AUTO && shape->depths > 1;
    shape->dark = options->dark == HADA_DARK_FRAME;
    shape->enhance = options->enhance && info->enhance && !shape->classic;
    shape->half = options->half || info->half;
    shape->parts = shape->refined ? HADA_BANK_OTFS : HADA_BANK_FILTERS;
    /* more depths at once than this only cost memory: the spectrum stays in the cache either way */
    shape->batch = options->batch ? options->batch : 8;
    if (shape->batch > shape->depths)
        shape->batch = shape->depths;
    shape->queues = options->queues ? options->queues : 1;
    hada_focus_options_init(&shape->focus, shape->refined);
    return skip_shape(model, options, shape, err);
}

size_t hada_plane_values(const hada_model_info *info)
{
    return (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols;
}

hada_focus_desc hada_plan_focus_of(const hada_model_info *info, const hada_plan_shape *shape)
{
    return (hada_focus_desc){.options = shape->focus,
                             .channels = info->channels,
                             .rows = info->window_rows,
                             .cols = info->window_cols,
                             .depths = shape->depths};
}

hada_refine_shape hada_plan_refine_of(const hada_model *model, const hada_plan_shape *shape)
{
    hada_refine_shape refine = hada_refine_shape_of(hada_model_get_info(model), shape->depths, shape->steps);
    refine.tv = shape->tv > 0;
    return refine;
}

hada_pursuit_options hada_plan_pursuit_of(const hada_model *model, const hada_plan_shape *shape)
{
    hada_pursuit_options options;
    hada_pursuit_options_init(&options);
    options.shape = hada_refine_shape_of(hada_model_get_info(model), shape->depths, 1);
    options.depths = shape->depths;
    options.rho *= hada_model_gain(model);
    options.full = shape->full_look;
    return options;
}
