/* Convolutions: objects, and which implementation a call goes to. */

#include "net/conv_plan.h"

hada_status hada_conv_create(hada_conv **out, hada_slot *slot, const hada_conv_desc *desc, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_conv_plan plan;
    hada_conv *conv = NULL;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_conv_plan_make(&plan, slot->context, desc, err));
    HADA_TRY_OR_DONE(HADA_NEW(conv, 1, "a convolution", err));
    conv->slot = slot;
    conv->plan = plan;
    for (int p = 0; p < plan.pass_count; p++)
        HADA_TRY_OR_DONE(hada_buffer_create(&conv->weights[p], slot->context,
                                            plan.pass[p].weight_floats * sizeof(float), "the weights of a convolution",
                                            err));
    if (plan.scratch_floats)
        HADA_TRY_OR_DONE(hada_buffer_create(&conv->scratch, slot->context, plan.scratch_floats * sizeof(float),
                                            "the scratch memory of a convolution", err));
done:
    if (status)
        hada_conv_destroy(&conv);
    *out = conv;
    return status;
}

void hada_conv_destroy(hada_conv **pointer)
{
    hada_conv *conv = hada_taken(pointer);
    if (!conv)
        return;
    for (int p = 0; p < HADA_CONV_PASSES; p++)
        hada_buffer_destroy(&conv->weights[p]);
    hada_buffer_destroy(&conv->scratch);
    free(conv);
}

hada_conv_method hada_conv_serving(const hada_conv *conv)
{
    return conv->plan.pass[HADA_CONV_FORWARD].method;
}

hada_status hada_conv_set_weights(hada_conv *conv, hada_floats weights, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int p = 0; p < conv->plan.pass_count; p++)
        HADA_TRY_OR_DONE(conv->plan.pass[p].winograd ? hada_conv_winograd_pack(conv, p, weights, err)
                                                     : hada_conv_pack(conv, p, weights, err));
done:
    conv->has_weights = !status;
    return status;
}

static hada_status tensor_fits(const hada_conv *conv, const hada_tensor *tensor, const char *name, int images,
                               int channels, int rows, int cols, hada_error *err)
{
    if (tensor->images == images && tensor->images >= 1 && tensor->images <= conv->plan.desc.images &&
        tensor->channels == channels && tensor->rows == rows && tensor->cols == cols &&
        tensor->block == conv->plan.block)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_SIZE,
                     "a convolution's %s has %d images of %dx%dx%d in blocks of %d, it takes %d (at most %d) of "
                     "%dx%dx%d in blocks of %d",
                     name, tensor->images, tensor->channels, tensor->rows, tensor->cols, tensor->block, images,
                     conv->plan.desc.images, channels, rows, cols, conv->plan.block);
}

static hada_status ready(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *low,
                         const hada_tensor *out, const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const char *const names[HADA_CONV_PASSES][2] = {{"x", "y"}, {"dy", "dx"}};
    if (!conv->has_weights)
        return hada_fail(err, HADA_ERROR_STATE, "a convolution needs hada_conv_set_weights() first");
    const int doubled = conv->plan.desc.doubled;
    if (!low != !doubled)
        return hada_fail(err, HADA_ERROR_STATE, "a convolution with doubled channels takes them apart, others do not");
    HADA_TRY(tensor_fits(conv, in, names[index][0], in->images, pass->in_channels - doubled, pass->in_rows,
                         pass->in_cols, err));
    if (low)
        HADA_TRY(
            tensor_fits(conv, low, "doubled channels", in->images, doubled, pass->in_rows / 2, pass->in_cols / 2, err));
    HADA_TRY(
        tensor_fits(conv, out, names[index][1], in->images, pass->out_channels, pass->out_rows, pass->out_cols, err));
    if (finish->mask)
        HADA_TRY(tensor_fits(conv, finish->mask, "mask", in->images, pass->out_channels, pass->out_rows, pass->out_cols,
                             err));
    if (finish->pooled)
        HADA_TRY(tensor_fits(conv, finish->pooled, "pooled output", in->images, pass->out_channels, pass->out_rows / 2,
                             pass->out_cols / 2, err));
    hada_conv_cost(conv, pass->to_coarse ? out : in, pass->to_coarse ? in : out);
    return HADA_OK;
}

static hada_status run(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *low,
                       const hada_tensor *out, const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    HADA_TRY(ready(conv, index, in, low, out, finish, err));
    if (pass->winograd)
        return hada_conv_winograd(conv, index, in, low, out, finish, err);
    return pass->method == HADA_CONV_PLAIN ? hada_conv_plain(conv, index, in, out, finish, err)
                                           : hada_conv_direct(conv, index, in, out, finish, err);
}

int hada_conv_doubles(const hada_context *context, const hada_conv_desc *desc)
{
    hada_conv_plan plan;
    return desc->doubled && !hada_conv_plan_make(&plan, context, desc, NULL);
}

hada_status hada_conv_forward_doubled(hada_conv *conv, const hada_tensor *x, const hada_tensor *low, hada_floats bias,
                                      const hada_tensor *y, const hada_tensor *pooled, hada_error *err)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_finish finish = {bias, d->activation, d->slope, NULL, pooled, 0};
    return run(conv, HADA_CONV_FORWARD, x, low, y, &finish, err);
}

hada_status hada_conv_forward(hada_conv *conv, const hada_tensor *x, hada_floats bias, const hada_tensor *y,
                              const hada_tensor *pooled, hada_error *err)
{
    return hada_conv_forward_doubled(conv, x, NULL, bias, y, pooled, err);
}

static hada_status must_train(const hada_conv *conv, hada_error *err)
{
    return conv->plan.desc.training
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_STATE, "a convolution whose description has no `training` has no gradients");
}

hada_status hada_conv_backward_data(hada_conv *conv, const hada_tensor *dy, const hada_tensor *masked_by,
                                    const hada_tensor *dx, int accumulate, hada_error *err)
{
    const hada_conv_finish finish = {.mask = masked_by, .accumulate = accumulate};
    HADA_TRY(must_train(conv, err));
    return run(conv, HADA_CONV_DATA, dy, NULL, dx, &finish, err);
}

hada_status hada_conv_backward_weights(hada_conv *conv, const hada_tensor *x, const hada_tensor *dy, hada_floats dw,
                                       hada_floats db, int accumulate, hada_error *err)
{
    HADA_TRY(must_train(conv, err));
    const hada_conv_pass *forward = &conv->plan.pass[HADA_CONV_FORWARD];
    HADA_TRY(tensor_fits(conv, x, "x", x->images, forward->in_channels, forward->in_rows, forward->in_cols, err));
    HADA_TRY(tensor_fits(conv, dy, "dy", x->images, forward->out_channels, forward->out_rows, forward->out_cols, err));
    return hada_conv_gradients(conv, x, dy, dw, db, accumulate, err);
}
