/* Planes on the device: linear filters, or depths that are refined together. */
#include "planes/maker.h"

#include <hadalens/reconstruct.h>

#include <math.h>
#include <stdlib.h>

#include "core/base.h"
#include "filter/hadamard.h"
#include "launch/filter_hold_out.h"

void hada_maker_use_otf(hada_plane_maker *maker, cl_mem otf, size_t offset, int depths, cl_mem prior)
{
    maker->data = (hada_refine_data){.spectrum = maker->stage->spectrum.mem,
                                     .frame = maker->stage->raw.mem,
                                     .otf = otf,
                                     .otf_offset = offset,
                                     .otf_depths = depths,
                                     .prior = prior};
}

hada_maker_way hada_maker_way_of(const hada_model_info *info, double tv, hada_mosaic mosaic)
{
    const int least = mosaic == HADA_MOSAIC_NONE ? HADA_CHOSEN_STEPS : HADA_CHOSEN_MOSAIC_STEPS;
    const double own = tv == HADA_AUTO ? info->refine_tv : tv;
    hada_maker_way way = {.steps = info->has_otf ? info->refine_steps : 0,
                          .weights = {own, info->refine_colour, info->refine_ridge},
                          .boundary = info->boundary};
    way.choose = own == HADA_AUTO || own == HADA_REFINE_TV_FRAME;
    const int open = way.choose || (mosaic != HADA_MOSAIC_NONE && info->refine_tv == HADA_AUTO);
    if (open && way.steps > 0 && way.steps < least)
        way.steps = least;
    if (!way.choose)
        return way;
    way.boundary = HADA_BOUNDARY_PADDED;
    way.weights.tv = 0.0;
    if (info->refine_tv == HADA_AUTO) /* no fit has measured what pays beside it */
        way.weights = (hada_refine_weights){0.0, HADA_REFINE_COLOUR, HADA_REFINE_RIDGE};
    return way;
}

hada_status hada_maker_make_weights(hada_plane_maker *maker, int choose, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(maker->model);
    const size_t count = (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols,
                 bytes = count * sizeof(float);
    HADA_TRY(hada_buffer_take(&maker->pixels, maker->slot, HADA_OWN_STEPS, bytes, "the weights of pixels", err));
    if (!choose)
        return HADA_OK;
    HADA_TRY(hada_buffer_take(&maker->held, maker->slot, HADA_OWN_STEPS, bytes, "held-out pixels", err));
    HADA_TRY(hada_buffer_take(&maker->blocks, maker->slot, HADA_OWN_STEPS, count, "held-out blocks of pixels", err));
    return hada_prepare_filter_hold_out(maker->slot, HADA_PROGRAM_FILTER_HOLD_OUT_DEFAULT, err);
}

void hada_maker_free_weights(hada_plane_maker *maker)
{
    hada_buffer_destroy(&maker->pixels);
    hada_buffer_destroy(&maker->held);
    hada_buffer_destroy(&maker->blocks);
}

hada_status hada_maker_weigh(hada_plane_maker *maker, const hada_frame_exposure *exposure, hada_error *err)
{
    float *weights = NULL;
    hada_status status = HADA_OK;
    maker->data.weights = NULL;
    if (!maker->pixels.mem || !hada_exposure_is_weighted(exposure))
        return HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(weights, hada_exposure_count(exposure), "the weights of pixels", err));
    hada_exposure_weigh(exposure, weights);
    HADA_TRY_OR_DONE(hada_buffer_write(&maker->pixels, maker->slot, 0, weights,
                                       hada_exposure_count(exposure) * sizeof *weights, err));
    maker->data.weights = maker->pixels.mem;
done:
    free(weights);
    return status;
}

static size_t plane_values(const hada_plane_maker *maker)
{
    const hada_model_info *info = hada_model_get_info(maker->model);
    return (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols;
}

hada_status hada_maker_filter(const hada_plane_maker *maker, int first, int count, cl_mem planes, hada_error *err)
{
    HADA_TRY(hada_hadamard_run(maker->stage, maker->bank, first, count, planes, 0, err));
    return hada_image_clip(maker->slot, planes, plane_values(maker) * (size_t)count, err);
}

/* rho of refinement with a weight that a frame chose: hada_refine_rule_follow(); less where the steps that found it go
 * on */
#define RHO_PER_WEIGHT 100.0
#define RHO_CONTINUING 30.0
#define MOST_RHO       3e-2

hada_status hada_maker_refine(const hada_plane_maker *maker, const hada_maker_steps *steps, double unit, int count,
                              const int *list, int *done, hada_error *err)
{
    hada_model_info info = *hada_model_get_info(maker->model);
    hada_refine_weights weights = maker->weights;
    hada_refine_rule rule;
    hada_refine_rule_init(&rule);
    rule.steps = steps->steps;
    rule.whole = steps->whole ? steps->whole : info.refine_steps ? info.refine_steps : rule.whole;
    rule.resumes = steps->resume;
    info.boundary = maker->boundary;
    if (steps->tv > 0.0)
        weights.tv = steps->tv;
    hada_refine_rule_weigh(&rule, &info, &weights, count, hada_model_gain(maker->model), unit);
    if (steps->tv > 0.0)
        hada_refine_rule_follow(&rule, steps->tv, hada_model_gain(maker->model),
                                steps->before && !steps->resume ? RHO_CONTINUING : RHO_PER_WEIGHT, MOST_RHO);
    if (steps->mu > 0.0)
        rule.mu = fmin(rule.mu, steps->mu);
    if (steps->resume) {
        rule.rho *= steps->firm;
        rule.growth = pow(rule.growth, steps->hasten);
    } else if (steps->stop && steps->before) {
        hada_refine_rule_settle(&rule);
    } else if (steps->stop) {
        hada_refine_rule_stop(&rule, info.boundary, steps->stop);
    }
    rule.start = steps->before || steps->resume ? HADA_REFINE_CONTINUE : HADA_REFINE_COLD;
    rule.before = steps->before;
    rule.quiet = !(rule.stop > 0.0);
    return hada_refiner_run(maker->refiner, &maker->data, &rule, 1, count, list, done, err);
}

int hada_maker_ridge_steps(const hada_plane_maker *maker, int steps)
{
    enum { MOST = 3 };
    if (!(maker->weights.ridge > 0.0) || !(maker->weights.tv > 0.0 || maker->held.mem))
        return 0;
    return steps / 2 < MOST ? steps / 2 : MOST;
}

hada_status hada_maker_regularise(const hada_plane_maker *maker, int steps, double tv, int count, const int *list,
                                  int *done, hada_error *err)
{
    hada_refine_weights weights = maker->weights;
    hada_refine_rule rule;
    int made = 0;
    hada_refine_rule_init(&rule);
    rule.tv = hada_refiner_tv(maker->refiner);
    if (steps < 1 || !(rule.tv > 0.0))
        return HADA_OK;
    if (tv > 0.0)
        weights.tv = tv;
    hada_refine_rule_ridge(&rule, steps, hada_model_get_info(maker->model), &weights, count,
                           hada_model_gain(maker->model));
    HADA_TRY(hada_refiner_run(maker->refiner, &maker->data, &rule, 1, count, list, &made, err));
    *done += made;
    return HADA_OK;
}

hada_status hada_maker_fade(const hada_plane_maker *maker, int count, double share, hada_error *err)
{
    return count > 1 && share > 0.0 ? hada_refiner_fade(maker->refiner, count, share, err) : HADA_OK;
}

hada_status hada_maker_read(const hada_plane_maker *maker, cl_mem planes, int first, int count, float *out,
                            hada_error *err)
{
    const size_t bytes = plane_values(maker) * sizeof(float);
    const hada_buffer all = {.mem = planes, .bytes = (size_t)(first + count) * bytes};
    return hada_buffer_read(&all, maker->slot, (size_t)first * bytes, out, (size_t)count * bytes, err);
}
