/* Optimisers, clipping of gradients, learning rates. */
#include "net/optimizer.h"

#include <limits.h>
#include <math.h>

#include "launch/net_optimizer.h"
#include "net/layer_launch.h"

enum { ROW_ITEMS = 128 }; /* work-items that share a run on GPUs */

void hada_optimizer_desc_init(hada_optimizer_desc *desc, hada_optimizer optimizer)
{
    *desc = (hada_optimizer_desc){.optimizer = optimizer, .beta1 = 0.9, .beta2 = 0.999, .eps = 1e-8, .scale = 1.0};
    desc->decay = optimizer == HADA_OPTIMIZER_RMSPROP ? 0.9 : 0.99;
    if (optimizer == HADA_OPTIMIZER_RMSPROP)
        desc->eps = 1e-7;
    if (optimizer == HADA_OPTIMIZER_ADAMW)
        desc->weight_decay = 0.01;
}

static int is_rmsprop(const hada_optimizer_desc *desc)
{
    return desc->optimizer == HADA_OPTIMIZER_RMSPROP || desc->optimizer == HADA_OPTIMIZER_RMSPROP_TORCH;
}

size_t hada_optimizer_state_floats(const hada_optimizer_desc *desc, size_t count)
{
    const size_t arrays = is_rmsprop(desc) ? 1 + (desc->centered != 0) + (desc->momentum > 0.0) : 2;
    return arrays * count;
}

static hada_status check_optimizer(const hada_optimizer_desc *desc, uint64_t step, double rate, size_t count,
                                   hada_error *err)
{
    if ((int)desc->optimizer < HADA_OPTIMIZER_RMSPROP || desc->optimizer > HADA_OPTIMIZER_ADAMW)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no optimiser %d", (int)desc->optimizer);
    if (!step || !count || count > UINT_MAX - HADA_OPTIMIZER_RUN)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "step %llu on %zu parameters: steps count from 1, and an array holds "
                         "1 to 4 thousand million",
                         (unsigned long long)step, count);
    if (!(rate >= 0.0 && isfinite(rate)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a learning rate of %g is not possible", rate);
    const double shares[] = {desc->decay, desc->momentum, desc->beta1, desc->beta2};
    for (size_t i = 0; i < HADA_COUNT(shares); i++)
        if (!(shares[i] >= 0.0 && shares[i] < 1.0))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "decay, momentum and betas must be from 0 to below 1, not %g",
                             shares[i]);
    if (!isfinite(desc->scale))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a gradient cannot be scaled by %g", desc->scale);
    if (!(desc->eps > 0.0 && isfinite(desc->eps)) || !(desc->weight_decay >= 0.0 && isfinite(desc->weight_decay)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "eps must be above 0 and weight decay at least 0, not %g and %g",
                         desc->eps, desc->weight_decay);
    return HADA_OK;
}

static size_t row_items(const hada_slot *slot)
{
    return slot->context->shape == HADA_SHAPE_GROUPS ? ROW_ITEMS : 1;
}

static hada_range runs_range(const hada_slot *slot, size_t count)
{
    return hada_range_groups(1, row_items(slot), hada_divide_up(count, HADA_OPTIMIZER_RUN), 1);
}

static hada_update_layout update_of(const hada_optimizer_desc *desc, hada_floats gradient, hada_floats parameters,
                                    hada_floats state, size_t count)
{
    return (hada_update_layout){.gradient = gradient.offset,
                                .parameters = parameters.offset,
                                .state = state.offset,
                                .count = (cl_uint)count,
                                .scale = (cl_float)desc->scale};
}

static hada_status rmsprop(hada_slot *slot, const hada_optimizer_desc *desc, double rate, hada_floats gradient,
                           hada_floats parameters, hada_floats state, size_t count, hada_error *err)
{
    const hada_range range = runs_range(slot, count);
    const hada_rmsprop rule = {.rate = (cl_float)rate,
                               .decay = (cl_float)desc->decay,
                               .rest = (cl_float)(1.0 - desc->decay),
                               .eps = (cl_float)desc->eps,
                               .momentum = (cl_float)desc->momentum,
                               .weight_decay = (cl_float)desc->weight_decay,
                               .centered = desc->centered != 0,
                               .outside = desc->optimizer == HADA_OPTIMIZER_RMSPROP_TORCH};
    return hada_launch_net_optimizer_rmsprop(slot, hada_program_net_optimizer_of(slot), &range, err,
                                             .gradient = gradient.mem, .parameters = parameters.mem, .state = state.mem,
                                             .at = update_of(desc, gradient, parameters, state, count), .rule = rule);
}

static hada_status adam(hada_slot *slot, const hada_optimizer_desc *desc, uint64_t t, double rate, hada_floats gradient,
                        hada_floats parameters, hada_floats state, size_t count, hada_error *err)
{
    const int decoupled = desc->optimizer == HADA_OPTIMIZER_ADAMW;
    const hada_range range = runs_range(slot, count);
    const hada_adam rule = {.rate = (cl_float)(rate / (1.0 - pow(desc->beta1, (double)t))),
                            .inverse_root = (cl_float)(1.0 / sqrt(1.0 - pow(desc->beta2, (double)t))),
                            .beta1 = (cl_float)desc->beta1,
                            .rest1 = (cl_float)(1.0 - desc->beta1),
                            .beta2 = (cl_float)desc->beta2,
                            .rest2 = (cl_float)(1.0 - desc->beta2),
                            .eps = (cl_float)desc->eps,
                            .weight_decay = decoupled ? 0.0f : (cl_float)desc->weight_decay,
                            .shrink = decoupled ? (cl_float)(1.0 - rate * desc->weight_decay) : 1.0f};
    return hada_launch_net_optimizer_adam(slot, hada_program_net_optimizer_of(slot), &range, err,
                                          .gradient = gradient.mem, .parameters = parameters.mem, .state = state.mem,
                                          .at = update_of(desc, gradient, parameters, state, count), .rule = rule);
}

hada_status hada_optimizer_step(hada_slot *slot, const hada_optimizer_desc *desc, uint64_t step, double rate,
                                hada_floats gradient, hada_floats parameters, hada_floats state, size_t count,
                                hada_error *err)
{
    hada_status status = check_optimizer(desc, step, rate, count, err);
    if (status)
        return status;
    return is_rmsprop(desc) ? rmsprop(slot, desc, rate, gradient, parameters, state, count, err)
                            : adam(slot, desc, step, rate, gradient, parameters, state, count, err);
}

static size_t items_of(size_t count, size_t items)
{
    return hada_divide_up(count, HADA_OPTIMIZER_RUN) * items;
}

size_t hada_clip_scratch(const hada_gradient_part *parts, int part_count)
{
    size_t sums = 0;
    for (int i = 0; i < part_count; i++)
        sums += items_of(parts[i].count, ROW_ITEMS);
    return (sums + hada_sum_scratch(sums) + 1) * sizeof(float);
}

/* The sums of squares of all parts, one after the other, into scratch; *sums counts them. */
static hada_status squares(hada_slot *slot, const hada_gradient_part *parts, int part_count, cl_mem scratch,
                           size_t *sums, hada_error *err)
{
    *sums = 0;
    for (int i = 0; i < part_count; i++) {
        const hada_range range = runs_range(slot, parts[i].count);
        HADA_TRY(hada_launch_net_optimizer_squares(
            slot, hada_program_net_optimizer_of(slot), &range, err, .values = parts[i].values.mem,
            .offset = parts[i].values.offset, .count = (cl_uint)parts[i].count, .sums = scratch, .sums_offset = *sums));
        *sums += items_of(parts[i].count, row_items(slot));
    }
    return HADA_OK;
}

static hada_status scale_part(hada_slot *slot, const hada_gradient_part *part, hada_floats norm, hada_error *err)
{
    const hada_range range = runs_range(slot, part->count);
    return hada_launch_net_optimizer_scale(slot, hada_program_net_optimizer_of(slot), &range, err,
                                           .values = part->values.mem, .offset = part->values.offset,
                                           .count = (cl_uint)part->count, .norm = norm.mem, .norm_offset = norm.offset);
}

hada_status hada_clip_gradients(hada_slot *slot, const hada_gradient_part *parts, int part_count, float max_norm,
                                hada_floats norm, cl_mem scratch, hada_error *err)
{
    if (part_count < 1 || !(max_norm >= 0.0f))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "clipping %d gradients to a norm of %g is not possible", part_count,
                         max_norm);
    for (int i = 0; i < part_count; i++)
        if (!parts[i].count || parts[i].count > UINT_MAX - HADA_OPTIMIZER_RUN)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "clipping: a gradient of %zu values is not possible",
                             parts[i].count);
    const hada_range one = hada_range_of(1, 1, 1, 1);
    size_t sums;
    HADA_TRY(squares(slot, parts, part_count, scratch, &sums, err));
    HADA_TRY(hada_sum_floats(slot, scratch, 0, sums, 1.0f, 0.0f, norm, err));
    HADA_TRY(hada_launch_net_optimizer_norm(slot, hada_program_net_optimizer_of(slot), &one, err, .norm = norm.mem,
                                            .offset = norm.offset, .limit = max_norm));
    for (int i = 0; max_norm > 0.0f && i < part_count; i++)
        HADA_TRY(scale_part(slot, &parts[i], norm, err));
    return HADA_OK;
}

#define PI 3.14159265358979323846

static int is_rate(double rate)
{
    return rate >= 0.0 && isfinite(rate);
}

hada_status hada_schedule_validate(const hada_schedule *schedule, hada_error *err)
{
    if ((int)schedule->kind < HADA_SCHEDULE_CONSTANT || schedule->kind > HADA_SCHEDULE_COSINE)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no schedule %d", (int)schedule->kind);
    if (!is_rate(schedule->rate) || !is_rate(schedule->factor) || !is_rate(schedule->last))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "learning rates and factors must be at least 0, not %g, %g and %g",
                         schedule->rate, schedule->factor, schedule->last);
    if (schedule->kind != HADA_SCHEDULE_CONSTANT && !schedule->period)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a schedule that changes needs a period of at least one step");
    if (!(schedule->warmup_from >= 0.0 && schedule->warmup_from <= 1.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a warm-up from %g of the rate is not possible; take 0 to 1",
                         schedule->warmup_from);
    return HADA_OK;
}

double hada_schedule_rate(const hada_schedule *schedule, uint64_t step)
{
    const double rate = schedule->rate;
    if (step < schedule->warmup) {
        const double done = (double)step / (double)schedule->warmup;
        return rate * (schedule->warmup_from + (1.0 - schedule->warmup_from) * done);
    }
    step -= schedule->warmup;
    if (schedule->kind == HADA_SCHEDULE_STEP)
        return rate * pow(schedule->factor, (double)(step / schedule->period));
    if (schedule->kind == HADA_SCHEDULE_COSINE) {
        if (step >= schedule->period)
            return schedule->last;
        const double cosine = cos(PI * (double)step / (double)schedule->period);
        return schedule->last + (rate - schedule->last) * (1.0 + cosine) / 2.0;
    }
    return rate;
}
