/* Optimisers, and the norm of gradients. */
#include "net/optimizer.h"

#include <limits.h>

#include "launch/net_optimizer.h"
#include "net/layer_launch.h"

enum { ROW_ITEMS = 128 }; /* work-items that share a run on GPUs */

void hada_optimizer_desc_init(hada_optimizer_desc *desc, hada_optimizer optimizer)
{
    *desc = (hada_optimizer_desc){
        .optimizer = optimizer, .eps = optimizer == HADA_OPTIMIZER_RMSPROP ? 1e-7 : 1e-8, .scale = 1.0};
}

size_t hada_optimizer_state_floats(const hada_optimizer_desc *desc, size_t count)
{
    return (desc->optimizer == HADA_OPTIMIZER_RMSPROP ? 1 : 2) * count;
}

/* Places in an array are counted in 32 bits. */
static int countable(size_t count)
{
    return count <= UINT_MAX - HADA_OPTIMIZER_RUN;
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

hada_status hada_optimizer_step(hada_slot *slot, const hada_optimizer_desc *desc, uint64_t step, double rate,
                                hada_floats gradient, hada_floats parameters, hada_floats state, size_t count,
                                hada_error *err)
{
    const hada_range range = runs_range(slot, count);
    const hada_program_net_optimizer program = hada_program_net_optimizer_of(slot);
    const hada_update_layout at = update_of(desc, gradient, parameters, state, count);
    if (!countable(count))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "step %llu on %zu parameters: steps count from 1, and an array holds "
                         "1 to 4 thousand million",
                         (unsigned long long)step, count);
    if (desc->optimizer == HADA_OPTIMIZER_RMSPROP) {
        const hada_rmsprop rule = {.rate = (cl_float)rate,
                                   .decay = (cl_float)HADA_RMSPROP_DECAY,
                                   .rest = (cl_float)(1.0 - HADA_RMSPROP_DECAY),
                                   .eps = (cl_float)desc->eps};
        return hada_launch_net_optimizer_rmsprop(slot, program, &range, err, .gradient = gradient.mem,
                                                 .parameters = parameters.mem, .state = state.mem, .at = at,
                                                 .rule = rule);
    }
    const hada_adam rule = {.rate = (cl_float)(rate / (1.0 - pow(HADA_ADAM_BETA1, (double)step))),
                            .inverse_root = (cl_float)(1.0 / sqrt(1.0 - pow(HADA_ADAM_BETA2, (double)step))),
                            .beta1 = (cl_float)HADA_ADAM_BETA1,
                            .rest1 = (cl_float)(1.0 - HADA_ADAM_BETA1),
                            .beta2 = (cl_float)HADA_ADAM_BETA2,
                            .rest2 = (cl_float)(1.0 - HADA_ADAM_BETA2),
                            .eps = (cl_float)desc->eps};
    return hada_launch_net_optimizer_adam(slot, program, &range, err, .gradient = gradient.mem,
                                          .parameters = parameters.mem, .state = state.mem, .at = at, .rule = rule);
}

static size_t items_of(size_t count, size_t items)
{
    return hada_divide_up(count, HADA_OPTIMIZER_RUN) * items;
}

size_t hada_squares_scratch(const hada_gradient_part *parts, int part_count)
{
    size_t sums = 0;
    for (int i = 0; i < part_count; i++)
        sums += items_of(parts[i].count, ROW_ITEMS);
    return (sums + hada_sum_scratch(sums) + 1) * sizeof(float);
}

hada_status hada_gradient_squares(hada_slot *slot, const hada_gradient_part *parts, int part_count, hada_floats out,
                                  cl_mem scratch, hada_error *err)
{
    size_t sums = 0; /* of all parts, one after the other */
    for (int i = 0; i < part_count; i++)
        if (!countable(parts[i].count))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "the norm of %zu values is not possible", parts[i].count);
    for (int i = 0; i < part_count; i++) {
        const hada_range range = runs_range(slot, parts[i].count);
        HADA_TRY(hada_launch_net_optimizer_squares(
            slot, hada_program_net_optimizer_of(slot), &range, err, .values = parts[i].values.mem,
            .offset = parts[i].values.offset, .count = (cl_uint)parts[i].count, .sums = scratch, .sums_offset = sums));
        sums += items_of(parts[i].count, row_items(slot));
    }
    return hada_sum_floats(slot, scratch, sums, 1.0f, out, err);
}
