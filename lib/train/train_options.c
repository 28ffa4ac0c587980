#include "train/trainer.h"

#include "core/callers.h"
#include "train/feed.h"

int hada_stage_has_discriminator(const hada_train_options *options)
{
    return options->stage == HADA_STAGE_ADVERSARIAL;
}

int hada_stage_has_planes(hada_stage stage)
{
    return stage == HADA_STAGE_ENHANCE || stage == HADA_STAGE_ADVERSARIAL;
}

int hada_stage_keeps(const hada_augment *augment)
{
    return !augment->shift && !augment->flips && augment->noise <= 0.0 && augment->exposure <= 0.0;
}

/* The share of scenes of several depths where the caller does not say (docs/explanation/nets.md): of a net for all
 * planes, and of one that shares light out, as total variation leaves nothing else. */
#define COMPOSED      0.15
#define COMPOSED_ONLY 1.0

static int is_rate(double rate)
{
    return isfinite(rate) && rate > 0.0;
}

static int is_weight(double weight)
{
    return isfinite(weight) && weight >= 0.0;
}

/* The share of the rates that the warm-up begins with. */
#define WARMUP_FROM 0.1
#define PI          3.14159265358979323846

double hada_train_rate(const hada_train_options *options, uint64_t step)
{
    const double last = options->last_rate;
    if (step < options->warmup)
        return WARMUP_FROM + (1.0 - WARMUP_FROM) * ((double)step / (double)options->warmup);
    if (options->schedule == HADA_RATE_CONSTANT)
        return 1.0;
    const uint64_t period = options->steps > options->warmup ? options->steps - options->warmup : 1;
    step -= options->warmup;
    return step < period ? last + (1.0 - last) * (1.0 + cos(PI * (double)step / (double)period)) / 2.0 : last;
}

static hada_status check_numbers(const hada_train_options *options, hada_error *err)
{
    if (!options->steps)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "training needs at least one step");
    if (options->batch < 1 || options->batch > 4096 || (options->at_once < 1 && options->at_once != HADA_AUTO) ||
        options->at_once > options->batch)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a step takes 1 to 4096 pairs, and at most as many at once; not %d and %d", options->batch,
                         options->at_once);
    if ((int)options->rule < HADA_RULE_RMSPROP || options->rule > HADA_RULE_ADAM)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no rule %d", (int)options->rule);
    if (options->schedule != HADA_RATE_CONSTANT && options->schedule != HADA_RATE_COSINE)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no schedule %d", (int)options->schedule);
    if (!is_rate(options->rate) || !is_rate(options->filter_rate) || !is_rate(options->discriminator_rate))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "learning rates are above 0; not %g, %g, %g", options->rate,
                         options->filter_rate, options->discriminator_rate);
    if (!is_weight(options->clip) || !is_weight(options->last_rate))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "clipping and the last rate are not below 0; not %g, %g",
                         options->clip, options->last_rate);
    if (!is_weight(options->mse) || !is_weight(options->perceptual) || !is_weight(options->adversarial) ||
        !is_weight(options->variation))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "weights of losses are not below 0; not %g, %g, %g, %g",
                         options->mse, options->perceptual, options->adversarial, options->variation);
    if (options->net_rows < 0 || options->net_cols < 0 || !options->net_rows != !options->net_cols)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a net cannot run at %d x %d pixels", options->net_rows,
                         options->net_cols);
    return HADA_OK;
}

static hada_status take_augment(hada_augment *augment, const hada_augment *given, hada_stage stage,
                                const hada_model_info *info, hada_error *err)
{
    enum { BOTH_SIDES = 3 };
    HADA_TRY(HADA_OPTIONS_TAKE(augment, given, hada_augment, err));
    if (augment->plane_flips == HADA_AUTO)
        augment->plane_flips = hada_stage_has_planes(stage) ? BOTH_SIDES : 0;
    return hada_augment_check(augment, info, err);
}

/* Rates and weights that the caller leaves open (docs/explanation/nets.md). */
static void settle_rates(hada_train_options *options)
{
    const int paper = options->discriminator && !strcmp(options->discriminator, "paper");
    if (options->filter_rate == HADA_AUTO) /* filters have values around 1; those of a fit need little */
        options->filter_rate = options->random_start ? 0.1 : 1e-3;
    if (options->discriminator_rate == HADA_AUTO) /* fully connected layers die at more */
        options->discriminator_rate = paper ? 3e-4 : 1e-3;
    if (options->adversarial == HADA_AUTO) /* the authors', for the discriminator that they had */
        options->adversarial = paper ? 8e-3 : 2e-3;
}

int hada_train_may_see_others(const hada_train_options *options, const hada_model_info *info)
{
    const int own_size =
        !options->net_rows || (options->net_rows == info->window_rows && options->net_cols == info->window_cols);
    return info->refine_steps > 0 && own_size && !strcmp(options->net, "compact");
}

/* Whether the net to be trained is one that only shares light out, or becomes one. */
static int is_for_shares(const hada_train_options *options, const hada_model *model)
{
    const hada_model_info *info = hada_model_get_info(model);
    if (options->stage != HADA_STAGE_ENHANCE)
        return 0;
    if (options->net_given)
        return options->net_given->shares;
    if (!options->new_net)
        return hada_model_get_enhance(model)->shares;
    return info->refine_tv > 0.0 && hada_train_may_see_others(options, info);
}

static hada_status settle_compose(hada_train_options *options, const hada_model *model, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    const int can = hada_stage_has_planes(options->stage) && info->has_otf && info->depths > 1;
    if (options->compose == HADA_AUTO)
        options->compose = !can ? 0.0 : is_for_shares(options, model) ? COMPOSED_ONLY : COMPOSED;
    if (!(options->compose >= 0.0 && options->compose <= 1.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "scenes of several depths are a share from 0 to 1, not %g",
                         options->compose);
    if (options->compose > 0.0 && !can)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "scenes of several depths are composed for the stages enhance and adversarial, by a model of "
                         "several depths with transfer functions; set compose to 0");
    return HADA_OK;
}

/* What the stage has no use for is off, and what it must have is on. */
static void settle_stage(hada_train_options *options, const hada_model_info *info)
{
    if (!options->vgg)
        options->perceptual = 0.0;
    if (!hada_stage_has_discriminator(options)) {
        options->adversarial = 0.0;
        options->discriminator_steps = 0;
    }
    if (options->stage == HADA_STAGE_FILTERS)
        options->perceptual = options->variation = 0.0;
    if (options->stage == HADA_STAGE_CONVENTIONAL || !info->enhance)
        options->new_net = 1;
    if (!options->net_rows && !options->new_net) {
        options->net_rows = info->enhance_rows;
        options->net_cols = info->enhance_cols;
    }
}

hada_status hada_train_options_settle(hada_train_options *options, hada_augment *augment,
                                      const hada_train_options *callers, const hada_model *model, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    hada_status status = HADA_OK;
    hada_train_options_init(options, callers->stage);
    HADA_TRY(hada_sized_take(options, sizeof *options, callers, "hada_train_options", err));
    const hada_augment *given = options->augment;
    options->augment = augment;
    if ((options->stage < HADA_STAGE_FILTERS || options->stage > HADA_STAGE_ADVERSARIAL) &&
        options->stage != HADA_STAGE_CONVENTIONAL)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no stage %d", (int)options->stage);
    settle_rates(options);
    HADA_TRY(check_numbers(options, err));
    HADA_TRY(take_augment(augment, given, options->stage, info, err));
    if (options->random_start && options->stage != HADA_STAGE_FILTERS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a random start is for the stage that trains filters alone");
    HADA_TRY(hada_train_form(options, info, &options->form, err));
    settle_stage(options, info);
    HADA_TRY(settle_compose(options, model, err));
    if (!(options->mse + options->perceptual + options->adversarial + options->variation > 0.0))
        status = hada_fail(err, HADA_ERROR_ARGUMENT, "all losses are off; give one of them a weight");
    return status;
}
