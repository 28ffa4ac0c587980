/* Planes on the device: linear filters, or depths that are refined together; the weight of total variation of
 * refinement, found from the frame alone. */
#include "planes/maker.h"

#include <hadalens/reconstruct.h>
#include <hadalens/response.h>

#include <math.h>
#include <stdlib.h>

#include "core/base.h"
#include "filter/hadamard.h"
#include "launch/filter_hold_out.h"
#include "planes/weight_search.h"

void hada_maker_use_otf(hada_plane_maker *maker, cl_mem otf, size_t offset, int depths, cl_mem prior)
{
    maker->data = (hada_refine_data){.spectrum = maker->stage->spectrum.mem,
                                     .frame = maker->stage->raw.mem,
                                     .otf = otf,
                                     .otf_offset = offset,
                                     .otf_depths = depths,
                                     .prior = prior};
}

/* Steps that refinement with a chosen weight takes at least from nothing, and for a mosaic. */
enum { CHOSEN_STEPS = 20, CHOSEN_MOSAIC_STEPS = 30 };

hada_maker_way hada_maker_way_of(const hada_model_info *info, double tv, hada_mosaic mosaic)
{
    const int least = mosaic == HADA_MOSAIC_NONE ? CHOSEN_STEPS : CHOSEN_MOSAIC_STEPS;
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

/* The weight of total variation. */

/* rho of the sweep: hada_refine_rule_follow(); it begins at FIRST_RHO, or at this part of the weight, and grows. With
 * less the first weights are judged by planes that have not settled, which favours small ones. */
#define SWEEP_RHO_PER_WEIGHT 30.0
#define SWEEP_MOST_RHO       3e-3
#define FIRST_RHO            1e-3
#define FIRST_PER_WEIGHT     0.3
#define GROWTH               1.1

/* Large or slow cameras take more steps with a weight, as long as LOOK of them explain so much more of held-out pixels:
 * planes that have not settled favour small weights. Those of several depths predict worse for some steps with each
 * smaller weight, and then better: they go on as long as that changes (perf/results/weights.md). */
#define SETTLED 0.005
enum {
    LOOK = 4,
    MOST_MORE = 60, /* of these steps */
    HOLD_OUT_GROUP = 128,
    BLOCK = 8, /* pixels a side that are left out together: errors of a point spread function are alike nearby, and
                  small weights would fit those of a single pixel to its neighbours */
    STEPS = 8, /* with each weight after the first, which takes HADA_CHOICE_STEPS from nothing */
    MOSAIC_STEPS = 12 /* the same of a mosaic, a third of whose values are known: after 6, weights were too small */
};

typedef struct sweep {
    hada_plane_maker *maker;
    int count;
    const int *list;
    double unit;
    int each;  /* steps with each weight after the first */
    int level; /* hada_refine_data.level */
} sweep;

/* Steps with the rule's weight, and what they leave of held-out pixels. */
static hada_status take_steps(const sweep *s, hada_refine_rule *rule, int count, int *steps, double *left,
                              hada_error *err)
{
    const hada_plane_maker *maker = s->maker;
    hada_refine_data held = maker->data;
    int done;
    held.weights = maker->held.mem;
    held.score_mu = 1.0;
    held.level = s->level;
    rule->steps = count;
    rule->before = *steps;
    rule->start = *steps ? HADA_REFINE_CONTINUE : HADA_REFINE_COLD;
    HADA_TRY(hada_refiner_run(maker->refiner, &maker->data, rule, 1, s->count, s->list, &done, err));
    *steps += done;
    return hada_refiner_residual(maker->refiner, &held, 1, s->count, s->list, left, err);
}

static int has_settled(const sweep *s, double before, double left)
{
    return left >= (1.0 - SETTLED) * before && (s->count == 1 || left <= (1.0 + SETTLED) * before);
}

static hada_status try_weight(void *user, double tv, int *steps, double *left, hada_error *err)
{
    const sweep *s = user;
    const hada_plane_maker *maker = s->maker;
    const hada_model_info *info = hada_model_get_info(maker->model);
    const hada_refine_weights weights = {tv, maker->weights.colour, 0.0};
    const double gain = hada_model_gain(maker->model);
    const int planned = *steps ? s->each : HADA_CHOICE_STEPS;
    double before;
    hada_refine_rule rule;
    hada_refine_rule_init(&rule);
    hada_refine_rule_weigh(&rule, info, &weights, 1, gain, s->unit);
    hada_refine_rule_follow(&rule, tv, gain, SWEEP_RHO_PER_WEIGHT, SWEEP_MOST_RHO);
    rule.growth = GROWTH;
    rule.first_rho = gain * fmax(FIRST_RHO, FIRST_PER_WEIGHT * tv);
    rule.rho = fmax(rule.rho, rule.first_rho);
    rule.quiet = 1;
    HADA_TRY(take_steps(s, &rule, planned - LOOK, steps, &before, err));
    HADA_TRY(take_steps(s, &rule, LOOK, steps, left, err));
    for (int more = 0; more < MOST_MORE && !has_settled(s, before, *left); more += LOOK) {
        before = *left;
        HADA_TRY(take_steps(s, &rule, LOOK, steps, left, err));
    }
    return HADA_OK;
}

hada_status hada_maker_hold_out(hada_plane_maker *maker, const hada_frame_exposure *exposure, int block, int by_weight,
                                hada_error *err)
{
    const size_t cols = (size_t)exposure->came.cols, rows = hada_exposure_count(exposure) / cols; /* of all channels */
    const size_t side = (size_t)block, count = hada_divide_up(rows, side) * hada_divide_up(cols, side);
    const hada_range range = hada_range_of(cols, HOLD_OUT_GROUP, rows, 1);
    unsigned char *blocks = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_maker_weigh(maker, exposure, err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(blocks, count, "held-out pixels", err));
    hada_hold_out_blocks(blocks, count);
    HADA_TRY_OR_DONE(hada_buffer_write(&maker->blocks, maker->slot, 0, blocks, count, err));
    hada_slot_cost(maker->slot, 12.0 * (double)(rows * cols), 4.0 * (double)(rows * cols));
    HADA_TRY_OR_DONE(hada_launch_filter_hold_out(maker->slot, HADA_PROGRAM_FILTER_HOLD_OUT_DEFAULT, &range, err,
                                                 .blocks = maker->blocks.octets, .side = block, .cols = (int)cols,
                                                 .by_weight = by_weight, .weighted = maker->data.weights != NULL,
                                                 .weights = maker->pixels.mem, .held = maker->held.mem));
    maker->data.weights = maker->pixels.mem;
done:
    free(blocks);
    return status;
}

/* Of a camera that was learned from pairs, what predicts the frame best leaves more noise than the best planes have,
 * and more so where they are compared as a display shows them: so many times the weight. */
#define LEARNED         1.4
#define LEARNED_ENCODED 2.0

/* A camera that is known by a point spread function, which may not be quite right. What errors of a block have in
 * common says nothing of planes' detail, so their mean does not count. Predictions see too little of detail that passes
 * weakly, and errors of the optics are explained by smaller and smaller weights; so the usual weight counts as well:
 * USUAL (r^2 / N)^(1/3), with r as for hada_weight_search.usual, and N = (sum h)^2 / sum h^2 the number of pixels, of
 * all channels, over which the point spread function h of the first depth spreads. Planes of several depths need less,
 * and predict better. (perf/results/weights.md) */
#define DOUBT         0.01
#define USUAL         0.65
#define TRUST         0.5
#define USUAL_SEVERAL 1.0

static double spread_of(const hada_model *model)
{
    const size_t plane = hada_model_plane(model);
    double light = 0.0, energy = 0.0;
    for (int c = 0; c < model->info.channels; c++) {
        const float *otf = model->otf + 2 * plane * (size_t)c;
        light += hypot(otf[0], otf[1]);
        energy += hada_model_mean_square(otf, &model->info); /* sum h^2, by Parseval */
    }
    return light > 0.0 && energy > 0.0 ? light * light / energy : 1.0;
}

/* Finds the weight of total variation with which the planes of `count` depths predict held-out pixels best. The
 * frame's own weights are on the device afterwards. */
static hada_status choose(hada_plane_maker *maker, const hada_frame_exposure *exposure, int count, const int *list,
                          hada_maker_choice *choice, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(maker->model);
    const int known = info->refine_tv == HADA_AUTO;
    sweep s = {.maker = maker,
               .count = count,
               .list = list,
               .unit = exposure->energy / (double)hada_exposure_count(exposure),
               .each = exposure->mosaic == HADA_MOSAIC_NONE ? STEPS : MOSAIC_STEPS,
               .level = known ? BLOCK : 0};
    hada_weight_search search = {.solve = try_weight, .user = &s, .factor = 1.0, .trust = count > 1 ? 1.0 : TRUST};
    if (known) {
        search.doubt = DOUBT;
        search.usual = (count > 1 ? USUAL_SEVERAL : USUAL) / cbrt(spread_of(maker->model));
    } else {
        search.factor = info->scene_response == HADA_RESPONSE_LINEAR ? LEARNED : LEARNED_ENCODED;
    }
    HADA_TRY(hada_maker_hold_out(maker, exposure, BLOCK, 1, err));
    HADA_TRY(hada_weight_find(&search, exposure, choice, err));
    return hada_maker_weigh(maker, exposure, err);
}

hada_status hada_maker_refine_exposure(hada_plane_maker *maker, const hada_frame_exposure *exposure,
                                       const hada_maker_steps *steps, int count, const int *list,
                                       hada_maker_choice *choice, int *done, hada_error *err)
{
    const double unit = hada_exposure_noise_unit(exposure, &maker->noise_share);
    hada_maker_steps own = *steps;
    if (maker->held.mem && !(choice->tv > 0.0))
        HADA_TRY(choose(maker, exposure, count, list, choice, err));
    else
        HADA_TRY(hada_maker_weigh(maker, exposure, err));
    if (maker->held.mem && count == 1) { /* anew, for planes of smaller weights keep their noise for long; several
                                            planes part from the beginning */
        const hada_maker_steps first = {.steps = HADA_CHOICE_STEPS, .tv = choice->tv};
        HADA_TRY(hada_maker_refine(maker, &first, unit, count, list, &choice->steps, err));
        own.before = choice->steps;
        own.steps = own.stop ? HADA_SETTLING_STEPS : own.steps;
    }
    if (choice->tv > 0.0)
        own.tv = choice->tv;
    return hada_maker_refine(maker, &own, unit, count, list, done, err);
}
