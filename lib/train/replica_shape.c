#include "train/replica_shape.h"

#include "filter/hadamard.h"
#include "kernels/shared_train.h"
#include "net/enhance.h"
#include "net/layer_launch.h"

/* The rule's eps is negligible for filters, whose gradients are far smaller than those of nets: beside the root of the
 * mean square, or below it. */
#define FILTER_EPS         1e-12
#define FILTER_EPS_SQUARED 1e-24

hada_optimizer_desc hada_group_rule(const hada_train_options *options, int group)
{
    hada_optimizer_desc rule;
    hada_optimizer_desc_init(&rule, options->rule == HADA_RULE_RMSPROP ? HADA_OPTIMIZER_RMSPROP : HADA_OPTIMIZER_ADAM);
    if (group >= HADA_GROUP_FILTERS)
        rule.eps = options->rule == HADA_RULE_RMSPROP ? FILTER_EPS_SQUARED : FILTER_EPS;
    return rule;
}

/* Whole vectors and lines of the cache. */
hada_part hada_group_part(const hada_replica_desc *desc, int group, size_t trained)
{
    enum { UNIT = 64 };
    if (desc->shares < 2 || group >= HADA_GROUP_FILTERS)
        return (hada_part){0, trained};
    const size_t units = trained / UNIT, share = (size_t)desc->share, shares = (size_t)desc->shares;
    const size_t first = units * share / shares * UNIT;
    return (hada_part){first, (share + 1 < shares ? units * (share + 1) / shares * UNIT : trained) - first};
}

void hada_group_sizes(const hada_replica_shape *shape, const hada_replica_desc *desc, int group, size_t *floats,
                      size_t *trained)
{
    const hada_net *net = group == HADA_GROUP_NET ? desc->net : desc->discriminator;
    *floats = *trained = 0;
    if (group >= HADA_GROUP_FILTERS) {
        *floats = *trained = 2 * (size_t)shape->channels * shape->layout.count;
    } else if (group == HADA_GROUP_NET ? shape->net : shape->has_discriminator) {
        *floats = net->floats;
        *trained = net->trained;
    }
}

hada_tensor hada_step_tensor(const hada_context *context, const hada_replica_shape *shape, const hada_net *net,
                             cl_mem mem)
{
    return hada_tensor_at(context, mem, 0, shape->at_once * net->colours, net->layers[net->count - 1].channels,
                          shape->rows, shape->cols);
}

hada_tensor hada_step_logits(const hada_context *context, const hada_replica_shape *shape, cl_mem mem)
{
    return hada_tensor_at(context, mem, 0, shape->at_once, 1, shape->logits.rows, shape->logits.cols);
}

hada_tensor hada_step_features(const hada_context *context, const hada_replica_shape *shape, const hada_net *vgg,
                               cl_mem mem)
{
    return hada_tensor_at(context, mem, 0, shape->at_once, vgg->layers[vgg->count - 1].channels, shape->features.rows,
                          shape->features.cols);
}

static hada_status output_size(const hada_net *net, const char *what, int rows, int cols, hada_size *out,
                               hada_error *err)
{
    const hada_status status = hada_net_output_size(net, rows, cols, out, err);
    if (status)
        hada_error_prefix(err, "the %s: ", what);
    return status;
}

hada_status hada_train_form(const hada_train_options *options, const hada_model_info *info, hada_form *form,
                            hada_error *err)
{
    const hada_form own = info->form == HADA_FORM_SPLIT ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX;
    const int random = options->random_start;
    *form = options->form ? options->form : random ? HADA_FORM_COMPLEX : own;
    if (*form != HADA_FORM_COMPLEX && *form != HADA_FORM_SPLIT)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "filters are trained in the forms complex and split");
    if (!random && *form != own)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model's filters are %s, those to be trained %s: start from random ones, or from a model "
                         "of that form",
                         hada_form_name(own), hada_form_name(*form));
    return HADA_OK;
}

static hada_status filter_shape(const hada_context *context, const hada_replica_desc *desc, hada_replica_shape *shape,
                                hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(desc->model);
    hada_geometry geometry;
    HADA_TRY(hada_geometry_of(info, &geometry, err));
    HADA_TRY(hada_train_form(desc->options, info, &shape->form, err));
    shape->frame = (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
    shape->layout = hada_hadamard_layout(context, info);
    const int rows = info->grid_rows, cols = info->grid_cols;
    const hada_rectangle frame = {geometry.raw_row, geometry.raw_col, info->raw_rows, info->raw_cols};
    const hada_rectangle window = {geometry.window_row, geometry.window_col, info->window_rows, info->window_cols};
    shape->forward = hada_fft_of(HADA_FFT_FORWARD, rows, cols, info->channels * shape->at_once, frame);
    shape->back = hada_fft_of(HADA_FFT_FORWARD, rows, cols, info->channels, window);
    shape->inverse = hada_fft_of(HADA_FFT_INVERSE, rows, cols, info->channels, window);
    return HADA_OK;
}

static hada_status net_shape(const hada_replica_desc *desc, hada_replica_shape *shape, hada_error *err)
{
    const hada_train_options *options = desc->options;
    hada_size out = {0, 0};
    shape->net_rows = options->net_rows ? options->net_rows : shape->rows;
    shape->net_cols = options->net_cols ? options->net_cols : shape->cols;
    shape->resized = shape->net_rows != shape->rows || shape->net_cols != shape->cols;
    const hada_net_info *info = hada_net_get_info(desc->net);
    const int others = hada_enhance_sees_others(desc->net, shape->channels);
    if (others && shape->resized)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the net sees the other planes beside its own, at the window's size alone: leave "
                         "options.net_size, or train a new net (options.net)");
    shape->input = shape->plane << others;
    HADA_TRY(output_size(desc->net, "net", shape->net_rows, shape->net_cols, &out, err));
    if (out.rows != shape->net_rows || out.cols != shape->net_cols)
        return hada_fail(err, HADA_ERROR_MODEL, "the net makes %d channel(s) of %d x %d pixels of %d of %d x %d",
                         info->out_channels, out.rows, out.cols, shape->channels, shape->net_rows, shape->net_cols);
    shape->training = (hada_graph_options){.images = shape->at_once,
                                           .rows = shape->net_rows,
                                           .cols = shape->net_cols,
                                           .training = 1,
                                           .weight_gradients = 1,
                                           .recompute = options->recompute};
    shape->inference = (hada_graph_options){.images = 1, .rows = shape->net_rows, .cols = shape->net_cols};
    return HADA_OK;
}

static hada_status loss_shapes(const hada_replica_desc *desc, hada_replica_shape *shape, hada_error *err)
{
    const hada_graph_options options = {.images = shape->at_once,
                                        .rows = shape->rows,
                                        .cols = shape->cols,
                                        .training = 1,
                                        .input_gradient = 1,
                                        .recompute = desc->options->recompute};
    shape->discriminator = shape->vgg_graph = options;
    shape->discriminator.weight_gradients = 1;
    if (shape->has_discriminator)
        HADA_TRY(output_size(desc->discriminator, "discriminator", shape->rows, shape->cols, &shape->logits, err));
    if (shape->vgg)
        HADA_TRY(output_size(desc->vgg, "net of the perceptual loss", shape->rows, shape->cols, &shape->features, err));
    return HADA_OK;
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

static void filter_buffers(hada_replica_shape *shape)
{
    const size_t at_once = (size_t)shape->at_once, channels = (size_t)shape->channels, count = shape->layout.count;
    const size_t items = hada_divide_up(at_once * shape->plane, HADA_TRAIN_RUN);
    shape->bytes[HADA_STEP_RAW] = at_once * shape->frame * sizeof(float);
    shape->bytes[HADA_STEP_SPECTRA] = at_once * channels * count * 2 * sizeof(float);
    shape->bytes[HADA_STEP_PLANE_SPECTRUM] = channels * count * 2 * sizeof(float);
    shape->bytes[HADA_STEP_COLUMN_WEIGHTS] = count * sizeof(float);
    at_least(&shape->bytes[HADA_STEP_SCRATCH], (items + hada_sum_scratch(items)) * sizeof(float));
}

static void net_buffers(const hada_context *context, const hada_replica_desc *desc, hada_replica_shape *shape)
{
    const hada_tensor out = hada_step_tensor(context, shape, desc->net, NULL);
    const size_t tensor = tensor_bytes(&out), at_once = (size_t)shape->at_once;
    size_t *bytes = shape->bytes;
    bytes[HADA_STEP_PLANES] = at_once * shape->input * sizeof(float);
    bytes[HADA_STEP_PLAIN] = at_once * shape->plane * sizeof(float);
    bytes[HADA_STEP_TARGET] = tensor;
    if (shape->resized)
        bytes[HADA_STEP_INPUT] = bytes[HADA_STEP_OUTPUT] = bytes[HADA_STEP_OUTPUT_GRADIENT] = tensor;
    at_least(&bytes[HADA_STEP_SCRATCH], hada_loss_scratch(&out));
    if (shape->has_discriminator || shape->vgg)
        bytes[HADA_STEP_TERM_GRADIENT] = tensor;
    if (shape->has_discriminator) {
        const hada_tensor logits = hada_step_logits(context, shape, NULL);
        bytes[HADA_STEP_FAKE] = bytes[HADA_STEP_REAL] = tensor_bytes(&logits);
        at_least(&bytes[HADA_STEP_SCRATCH], hada_loss_scratch(&logits));
    }
    if (!shape->vgg)
        return;
    const hada_tensor features = hada_step_features(context, shape, desc->vgg, NULL);
    bytes[HADA_STEP_FEATURES] = tensor_bytes(&features);
    bytes[HADA_STEP_VGG] = desc->vgg->floats * sizeof(float);
    at_least(&bytes[HADA_STEP_PLAIN], at_once * 3 * shape->pixels * sizeof(float));
    at_least(&bytes[HADA_STEP_SCRATCH], hada_loss_scratch(&features));
}

/* Scratch for the norm of all groups together. */
static hada_status norm_buffer(const hada_replica_desc *desc, hada_replica_shape *shape, hada_error *err)
{
    hada_gradient_part *parts = NULL;
    int count = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(parts, (size_t)shape->groups, "the norm of gradients", err));
    for (int group = 0; group < shape->groups; group++) {
        size_t floats;
        hada_group_sizes(shape, desc, group, &floats, &parts[count].count);
        count += parts[count].count > 0;
    }
    at_least(&shape->bytes[HADA_STEP_SCRATCH], hada_squares_scratch(parts, count));
done:
    free(parts);
    return status;
}

static void base_shape(const hada_replica_desc *desc, hada_replica_shape *shape)
{
    const hada_model_info *info = hada_model_get_info(desc->model);
    const hada_stage stage = desc->options->stage;
    *shape = (hada_replica_shape){.stage = stage,
                                  .channels = info->channels,
                                  .rows = info->window_rows,
                                  .cols = info->window_cols,
                                  .at_once = desc->at_once,
                                  .depths = info->depths,
                                  .filters = stage == HADA_STAGE_FILTERS,
                                  .net = stage != HADA_STAGE_FILTERS};
    shape->has_discriminator = shape->net && desc->discriminator;
    shape->vgg = shape->net && desc->vgg && desc->options->perceptual > 0.0;
    shape->pixels = (size_t)shape->rows * (size_t)shape->cols;
    shape->input = shape->plane = shape->pixels * (size_t)shape->channels;
    shape->groups = HADA_GROUP_FILTERS + (shape->filters ? shape->depths : 0);
    shape->bytes[HADA_STEP_PLANES] = shape->bytes[HADA_STEP_SCENES] =
        (size_t)shape->at_once * shape->plane * sizeof(float);
    shape->bytes[HADA_STEP_TERMS] = HADA_TERM_FLOATS * sizeof(float);
}

hada_status hada_replica_shape_of(const hada_context *context, const hada_replica_desc *desc, hada_replica_shape *shape,
                                  hada_error *err)
{
    base_shape(desc, shape);
    if (shape->filters) {
        HADA_TRY(filter_shape(context, desc, shape, err));
        filter_buffers(shape);
    } else {
        HADA_TRY(net_shape(desc, shape, err));
        HADA_TRY(loss_shapes(desc, shape, err));
        net_buffers(context, desc, shape);
    }
    return norm_buffer(desc, shape, err);
}

/* All are zero at first: halos, and what fills up tensors, stay so. */
hada_status hada_step_images_create(hada_step_images *images, hada_slot *slot, const hada_replica_shape *shape,
                                    hada_error *err)
{
    *images = (hada_step_images){.slot = slot, .shape = shape};
    for (int i = 0; i < HADA_STEP_PLACES; i++) {
        const size_t bytes = shape->bytes[i];
        if (!bytes)
            continue;
        HADA_TRY(hada_buffer_create(&images->place[i], slot->context, bytes, "the images of a step", err));
        HADA_TRY(hada_buffer_clear(&images->place[i], slot, 0, bytes, err));
    }
    return HADA_OK;
}

void hada_step_images_destroy(hada_step_images *images)
{
    for (int i = 0; i < HADA_STEP_PLACES; i++)
        hada_buffer_destroy(&images->place[i]);
}

hada_status hada_step_upload(hada_step_images *images, hada_step_place place, const hada_image *image, int number,
                             hada_error *err)
{
    const hada_replica_shape *shape = images->shape;
    const size_t bytes = (place == HADA_STEP_PLANES ? shape->input : shape->plane) * sizeof(float);
    hada_slot_stage(images->slot, "upload");
    return hada_buffer_write(&images->place[place], images->slot, (size_t)number * bytes, image->data, bytes, err);
}
