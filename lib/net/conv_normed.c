/* Convolutions that normalise what they read (layers.h). */
#include "launch/conv_normed.h"
#include "core/alloc.h"
#include "net/conv_internal.h"
#include "net/layers.h"

enum { PLACES = 9, VALUES = 3 }; /* of a kernel; vectors of a block that the norm needs */
enum { MOST_CHANNELS = 1024 };   /* for which both find room in local memory everywhere */

static int program_of(int block, int few)
{
    if (block == 16)
        return few == 1 ? HADA_PROGRAM_CONV_NORMED_BLOCK16_FEW1 : HADA_PROGRAM_CONV_NORMED_BLOCK16_FEW3;
    return few == 1 ? HADA_PROGRAM_CONV_NORMED_BLOCK8_FEW1 : HADA_PROGRAM_CONV_NORMED_BLOCK8_FEW3;
}

static int norms(const hada_conv_plan *plan)
{
    const hada_conv_desc *d = &plan->desc;
    const hada_conv_pass *pass = &plan->pass[HADA_CONV_FORWARD];
    return !d->training && !d->transposed && pass->method == HADA_CONV_DIRECT && pass->few &&
           d->in_channels <= MOST_CHANNELS && d->kernel_rows == 3 && d->kernel_cols == 3 && d->stride == 1 &&
           d->pad_rows == 1 && d->pad_cols == 1;
}

int hada_conv_norms(const hada_context *context, const hada_conv_desc *desc)
{
    hada_conv_plan plan;
    return !hada_conv_plan_make(&plan, context, desc, NULL, NULL) && norms(&plan);
}

hada_status hada_conv_forward_normed(hada_conv *conv, const hada_batch_norm *norm, const hada_tensor *x,
                                     hada_floats bias, const hada_tensor *y, hada_error *err)
{
    const hada_conv_plan *plan = &conv->plan;
    const hada_conv_pass *pass = &plan->pass[HADA_CONV_FORWARD];
    const hada_conv_finish finish = {bias, plan->desc.activation, plan->desc.slope, NULL, NULL, 0};
    if (norm->bias.mem != norm->weight.mem || norm->mean.mem != norm->weight.mem ||
        norm->variance.mem != norm->weight.mem)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a batch norm before a convolution has its values in one buffer");
    if (!norms(plan))
        return hada_fail(err, HADA_ERROR_STATE, "a convolution that takes what is normalised, not what is to be");
    const hada_status status = hada_conv_ready(conv, HADA_CONV_FORWARD, x, NULL, y, &finish, err);
    if (status)
        return status;
    const hada_norm_values at = {.weight = norm->weight.offset,
                                 .bias = norm->bias.offset,
                                 .mean = norm->mean.offset,
                                 .second = norm->variance.offset,
                                 .is_variance = 1,
                                 .eps = norm->eps};
    const size_t lanes = (size_t)hada_layout_of(x).blocks * (size_t)x->block;
    const hada_range range =
        hada_range_of(hada_divide_up((size_t)y->rows, (size_t)pass->rows_each), 1, (size_t)x->images, 1);
    const hada_local local = {(PLACES * (size_t)pass->few + VALUES) * lanes * sizeof(float)};
    return hada_launch_conv_normed(
        conv->slot, (hada_program_conv_normed)program_of(plan->block, pass->few), &range, err, .x = x->mem,
        .weights = conv->weights[HADA_CONV_FORWARD].mem, .bias = bias.mem, .y = y->mem, .values = norm->weight.mem,
        .w = local, .problem = hada_conv_problem_of(conv, HADA_CONV_FORWARD, x, y, &finish, 0), .norm = at);
}
