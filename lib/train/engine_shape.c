/* Sizes and bytes of an engine, before anything is allocated. */
#include <stdlib.h>

#include "core/alloc.h"
#include "filter/hadamard.h"
#include "net/layer_launch.h"
#include "train/engine_parts.h"

hada_optimizer_desc hada_engine_rule(const hada_train_options *options, int group)
{
    static const hada_optimizer rules[] = {HADA_OPTIMIZER_RMSPROP, HADA_OPTIMIZER_ADAM, HADA_OPTIMIZER_ADAMW};
    hada_optimizer_desc rule;
    hada_optimizer_desc_init(&rule, rules[options->rule]);
    rule.weight_decay = options->rule == HADA_RULE_ADAMW && group < HADA_GROUP_FILTERS ? options->weight_decay : 0.0;
    if (group >= HADA_GROUP_FILTERS) /* below the root of squares, or beside it */
        rule.eps = options->rule == HADA_RULE_RMSPROP ? 1e-24 : 1e-12;
    return rule;
}

/* Whole vectors and lines of the cache. */
hada_part hada_engine_part_of(const hada_engine_desc *desc, int group, size_t trained)
{
    enum { UNIT = 64 };
    if (desc->shares < 2 || group >= HADA_GROUP_FILTERS)
        return (hada_part){0, trained};
    const size_t units = trained / UNIT, share = (size_t)desc->share, shares = (size_t)desc->shares;
    const size_t first = units * share / shares * UNIT;
    return (hada_part){first, (share + 1 < shares ? units * (share + 1) / shares * UNIT : trained) - first};
}

void hada_engine_group_sizes(const engine_shape *shape, const hada_engine_desc *desc, int group, size_t *floats,
                             size_t *trained)
{
    const hada_net *net = group == HADA_GROUP_NET ? desc->net : desc->critic;
    *floats = *trained = 0;
    if (group >= HADA_GROUP_FILTERS) {
        *floats = *trained = 2 * (size_t)shape->channels * shape->layout.count;
    } else if (group == HADA_GROUP_NET ? shape->net : shape->critic) {
        *floats = net->floats;
        *trained = net->trained;
    }
}

hada_tensor hada_engine_tensor(const hada_context *context, const engine_shape *shape, const hada_net *net, cl_mem mem)
{
    return hada_tensor_at(context, mem, 0, shape->at_once * net->colours, net->layers[0].channels, shape->rows,
                          shape->cols);
}

hada_tensor hada_engine_logits(const hada_context *context, const engine_shape *shape, cl_mem mem)
{
    return hada_tensor_at(context, mem, 0, shape->at_once, 1, shape->logits.rows, shape->logits.cols);
}

hada_tensor hada_engine_features(const hada_context *context, const engine_shape *shape, const hada_net *vgg,
                                 cl_mem mem)
{
    return hada_tensor_at(context, mem, 0, shape->at_once, vgg->layers[vgg->count - 1].channels, shape->features.rows,
                          shape->features.cols);
}

static hada_status check(const hada_engine_desc *desc, hada_error *err)
{
    const hada_train_options *options = desc->options;
    const hada_stage stage = options->stage;
    if ((int)stage < HADA_STAGE_FILTERS || stage > HADA_STAGE_CONVENTIONAL)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no stage of training %d", (int)stage);
    if ((int)options->rule < HADA_RULE_RMSPROP || options->rule > HADA_RULE_ADAMW)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no rule of training %d", (int)options->rule);
    if (desc->at_once < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "training with %d pairs at once is not possible", desc->at_once);
    if (!desc->model || (stage != HADA_STAGE_FILTERS && !desc->net) ||
        (stage == HADA_STAGE_ADVERSARIAL && !desc->critic))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "training needs a model%s",
                         stage == HADA_STAGE_FILTERS       ? ""
                         : stage == HADA_STAGE_ADVERSARIAL ? ", a net and a discriminator"
                                                           : " and a net");
    return HADA_OK;
}

/* The net gives images like those that it takes, and which channels the others take fits. */
static hada_status check_net(const hada_net *net, const char *what, int channels, int rows, int cols, hada_size *out,
                             hada_error *err)
{
    hada_net_info info;
    hada_size *sizes;
    hada_net_get_info(net, &info);
    if (info.channels != channels)
        return hada_fail(err, HADA_ERROR_MODEL, "the %s takes %d channel(s), but images have %d", what, info.channels,
                         channels);
    hada_status status = hada_alloc((void **)&sizes, (size_t)net->count, sizeof *sizes, "a net", err);
    if (!status)
        status = hada_net_sizes(net, rows, cols, sizes, err);
    if (!status)
        *out = sizes[net->count - 1];
    else
        hada_error_prefix(err, "the %s: ", what);
    free(sizes);
    return status;
}

static hada_status filter_shape(const hada_context *context, const hada_engine_desc *desc, engine_shape *shape,
                                hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(desc->model);
    const hada_form own = info->form == HADA_FORM_SPLIT ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX;
    const int random = shape->stage == HADA_STAGE_FILTERS && desc->options->random_start;
    hada_geometry geometry;
    hada_status status = hada_geometry_of(info, &geometry, err);
    if (status)
        return status;
    shape->form = own;
    if (shape->stage == HADA_STAGE_FILTERS && (desc->options->form || random))
        shape->form = desc->options->form ? desc->options->form : HADA_FORM_COMPLEX;
    if (shape->form != HADA_FORM_COMPLEX && shape->form != HADA_FORM_SPLIT)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "filters are trained in the forms complex and split");
    if (!random && shape->form != own)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model's filters are %s, those to be trained %s: start from random ones, or from a model "
                         "of that form",
                         hada_form_name(own), hada_form_name(shape->form));
    shape->frame = (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
    shape->layout = hada_hadamard_layout(context, info);
    shape->forward = (hada_fft_desc){.direction = HADA_FFT_FORWARD,
                                     .rows = info->grid_rows,
                                     .cols = info->grid_cols,
                                     .batch = info->channels * shape->at_once,
                                     .row0 = geometry.raw_row,
                                     .col0 = geometry.raw_col,
                                     .real_rows = info->raw_rows,
                                     .real_cols = info->raw_cols,
                                     .real_pitch = (size_t)info->raw_cols,
                                     .real_distance = (size_t)info->raw_rows * (size_t)info->raw_cols};
    shape->back = shape->forward;
    shape->back.batch = info->channels;
    shape->back.row0 = geometry.window_row;
    shape->back.col0 = geometry.window_col;
    shape->back.real_rows = info->window_rows;
    shape->back.real_cols = info->window_cols;
    shape->back.real_pitch = (size_t)info->window_cols;
    shape->back.real_distance = shape->pixels;
    shape->inverse = shape->back;
    shape->inverse.direction = HADA_FFT_INVERSE;
    return HADA_OK;
}

static hada_status net_shape(const hada_engine_desc *desc, engine_shape *shape, hada_error *err)
{
    const hada_train_options *options = desc->options;
    hada_net_info info;
    hada_size out = {0, 0};
    shape->net_rows = options->net_rows ? options->net_rows : shape->rows;
    shape->net_cols = options->net_cols ? options->net_cols : shape->cols;
    shape->resized = shape->net_rows != shape->rows || shape->net_cols != shape->cols;
    hada_net_get_info(desc->net, &info);
    hada_status status = check_net(desc->net, "net", shape->channels, shape->net_rows, shape->net_cols, &out, err);
    if (!status && (info.out_channels != shape->channels || out.rows != shape->net_rows || out.cols != shape->net_cols))
        status = hada_fail(err, HADA_ERROR_MODEL, "the net makes %d channel(s) of %d x %d pixels of %d of %d x %d",
                           info.out_channels, out.rows, out.cols, shape->channels, shape->net_rows, shape->net_cols);
    shape->train = (hada_graph_options){.images = shape->at_once,
                                        .rows = shape->net_rows,
                                        .cols = shape->net_cols,
                                        .training = 1,
                                        .weight_gradients = 1,
                                        .input_gradient = shape->filters,
                                        .recompute = options->recompute};
    shape->look = (hada_graph_options){.images = 1, .rows = shape->net_rows, .cols = shape->net_cols};
    return status;
}

static hada_status judge_shapes(const hada_engine_desc *desc, engine_shape *shape, hada_error *err)
{
    hada_net_info info;
    hada_status status = HADA_OK;
    const hada_graph_options options = {.images = shape->at_once,
                                        .rows = shape->rows,
                                        .cols = shape->cols,
                                        .training = 1,
                                        .input_gradient = 1,
                                        .recompute = desc->options->recompute};
    shape->judge = shape->see = options;
    shape->judge.weight_gradients = 1;
    if (shape->critic) {
        hada_net_get_info(desc->critic, &info);
        shape->paired = info.channels == 2 * shape->channels;
        status = check_net(desc->critic, "discriminator", shape->channels << shape->paired, shape->rows, shape->cols,
                           &shape->logits, err);
        if (!status && info.out_channels != 1)
            status = hada_fail(err, HADA_ERROR_MODEL, "a discriminator gives one channel of logits, not %d",
                               info.out_channels);
    }
    if (status || !shape->vgg)
        return status;
    if (shape->channels != 1 && shape->channels != 3)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the perceptual loss takes images of one or three channels, not %d: leave it out",
                         shape->channels);
    return check_net(desc->vgg, "net of the perceptual loss", 3, shape->rows, shape->cols, &shape->features, err);
}

static size_t tensor_bytes(const hada_tensor *tensor)
{
    return (size_t)tensor->images * tensor->image_stride * sizeof(float);
}

static void at_least(size_t *bytes, size_t wanted)
{
    if (*bytes < wanted)
        *bytes = wanted;
}

static void filter_buffers(engine_shape *shape)
{
    const size_t at_once = (size_t)shape->at_once, channels = (size_t)shape->channels, count = shape->layout.count;
    const size_t items = (at_once * shape->plane + ENGINE_RUN - 1) / ENGINE_RUN;
    shape->bytes[ENGINE_RAW] = at_once * shape->frame * sizeof(float);
    shape->bytes[ENGINE_SPECTRA] = at_once * channels * count * 2 * sizeof(float);
    shape->bytes[ENGINE_FLOW] = channels * count * 2 * sizeof(float);
    shape->bytes[ENGINE_COLUMNS] = count * sizeof(float);
    at_least(&shape->bytes[ENGINE_SUMS], (items + hada_sum_scratch(items)) * sizeof(float));
}

static void net_buffers(const hada_context *context, const hada_engine_desc *desc, engine_shape *shape)
{
    const hada_tensor out = hada_engine_tensor(context, shape, desc->net, NULL);
    const hada_loss_desc loss = {.loss = HADA_LOSS_MSE};
    const size_t tensor = tensor_bytes(&out), at_once = (size_t)shape->at_once;
    size_t *bytes = shape->bytes;
    bytes[ENGINE_FLAT] = at_once * shape->plane * sizeof(float);
    bytes[ENGINE_TARGET] = tensor;
    if (shape->resized)
        bytes[ENGINE_IN] = bytes[ENGINE_OUT] = bytes[ENGINE_FALL] = tensor;
    at_least(&bytes[ENGINE_SUMS], hada_loss_scratch(&loss, &out));
    if (shape->critic || shape->vgg)
        bytes[ENGINE_SHARE] = tensor;
    if (shape->critic) {
        const hada_tensor logits = hada_engine_logits(context, shape, NULL);
        bytes[ENGINE_FALSE] = bytes[ENGINE_TRUE] = tensor_bytes(&logits);
        at_least(&bytes[ENGINE_SUMS], hada_loss_scratch(&loss, &logits));
    }
    if (shape->paired)
        bytes[ENGINE_PAIRS] = 2 * at_once * shape->plane * sizeof(float);
    if (!shape->vgg)
        return;
    const hada_tensor features = hada_engine_features(context, shape, desc->vgg, NULL);
    bytes[ENGINE_FEATURES] = tensor_bytes(&features);
    bytes[ENGINE_VGG] = desc->vgg->floats * sizeof(float);
    at_least(&bytes[ENGINE_FLAT], at_once * 3 * shape->pixels * sizeof(float));
    at_least(&bytes[ENGINE_SUMS], hada_loss_scratch(&loss, &features));
}

/* Scratch for the norm of all groups together. */
static hada_status norm_buffer(const hada_engine_desc *desc, engine_shape *shape, hada_error *err)
{
    hada_gradient_part *parts;
    int count = 0;
    hada_status status =
        hada_alloc((void **)&parts, (size_t)shape->groups, sizeof *parts, "the norm of gradients", err);
    for (int group = 0; !status && group < shape->groups; group++) {
        size_t floats;
        hada_engine_group_sizes(shape, desc, group, &floats, &parts[count].count);
        count += parts[count].count > 0;
    }
    if (!status)
        at_least(&shape->bytes[ENGINE_SUMS], hada_clip_scratch(parts, count));
    free(parts);
    return status;
}

hada_status hada_engine_shape_of(const hada_context *context, const hada_engine_desc *desc, engine_shape *shape,
                                 hada_error *err)
{
    hada_status status = check(desc, err);
    if (status)
        return status;
    const hada_model_info *info = hada_model_get_info(desc->model);
    const hada_stage stage = desc->options->stage;
    *shape = (engine_shape){.stage = stage,
                            .channels = info->channels,
                            .rows = info->window_rows,
                            .cols = info->window_cols,
                            .at_once = desc->at_once,
                            .depths = info->depths,
                            .filters = stage == HADA_STAGE_FILTERS || stage == HADA_STAGE_JOINT,
                            .net = stage != HADA_STAGE_FILTERS};
    shape->critic = shape->net && desc->critic;
    shape->vgg = shape->net && desc->vgg && desc->options->perceptual > 0.0;
    shape->pixels = (size_t)shape->rows * (size_t)shape->cols;
    shape->plane = shape->pixels * (size_t)shape->channels;
    shape->groups = HADA_GROUP_FILTERS + (shape->filters ? shape->depths : 0);
    shape->bytes[ENGINE_PLANES] = shape->bytes[ENGINE_SCENES] = (size_t)shape->at_once * shape->plane * sizeof(float);
    shape->bytes[ENGINE_TERMS] = ENGINE_TERM_FLOATS * sizeof(float);
    if (shape->filters)
        status = filter_shape(context, desc, shape, err);
    if (!status && shape->net)
        status = net_shape(desc, shape, err);
    if (!status)
        status = judge_shapes(desc, shape, err);
    if (status)
        return status;
    if (shape->filters)
        filter_buffers(shape);
    if (shape->net)
        net_buffers(context, desc, shape);
    return norm_buffer(desc, shape, err);
}

static hada_status add_graph(const hada_context *context, const hada_net *net, const hada_graph_options *options,
                             size_t *bytes, hada_error *err)
{
    size_t more = 0;
    hada_status status = hada_graph_bytes(context, net, options, &more, err);
    *bytes += more;
    return status;
}

hada_status hada_engine_bytes(const hada_context *context, const hada_engine_desc *desc, size_t *bytes, hada_error *err)
{
    engine_shape shape;
    *bytes = 0;
    hada_status status = hada_engine_shape_of(context, desc, &shape, err);
    if (status)
        return status;
    for (int i = 0; i < ENGINE_BUFFERS; i++)
        *bytes += shape.bytes[i];
    for (int group = 0; group < shape.groups; group++) {
        size_t floats, trained;
        const hada_optimizer_desc rule = hada_engine_rule(desc->options, group);
        hada_engine_group_sizes(&shape, desc, group, &floats, &trained);
        const hada_part part = hada_engine_part_of(desc, group, trained);
        *bytes += (floats + trained + hada_optimizer_state_floats(&rule, part.count)) * sizeof(float);
    }
    if (shape.filters)
        *bytes += hada_fft_bytes(context, &shape.forward) + hada_fft_bytes(context, &shape.inverse) +
                  hada_fft_bytes(context, &shape.back);
    if (shape.net)
        status = add_graph(context, desc->net, &shape.train, bytes, err);
    if (!status && shape.net)
        status = add_graph(context, desc->net, &shape.look, bytes, err);
    if (!status && shape.critic)
        status = add_graph(context, desc->critic, &shape.judge, bytes, err);
    if (!status && shape.vgg)
        status = add_graph(context, desc->vgg, &shape.see, bytes, err);
    return status;
}
