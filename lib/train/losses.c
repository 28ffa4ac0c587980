/* The terms of the loss, and the store of features. */
#include "train/step.h"

#include "net/layers.h"

hada_status hada_features_create(hada_features *features, size_t scenes, size_t floats, size_t most, hada_error *err)
{
    *features = (hada_features){.floats = floats, .most = most};
    if (!scenes)
        return HADA_OK;
    hada_status status = HADA_NEW(features->kept, scenes, "the list of scenes", err);
    features->count = status ? 0 : scenes;
    return status;
}

void hada_features_free(hada_features *features)
{
    for (size_t i = 0; i < features->count; i++)
        free(features->kept[i]);
    free(features->kept);
    *features = (hada_features){0};
}

const float *hada_features_find(const hada_features *features, size_t scene)
{
    return scene && scene <= features->count ? features->kept[scene - 1] : NULL;
}

float *hada_features_room(hada_features *features, size_t scene)
{
    const size_t bytes = features->floats * sizeof(float);
    if (!scene || scene > features->count || features->kept[scene - 1] || bytes > features->most - features->bytes)
        return NULL;
    float **at = &features->kept[scene - 1];
    /* training goes on without what does not fit */
    if (HADA_NEW_RAW(*at, features->floats, "features", NULL))
        return NULL;
    features->bytes += bytes;
    return *at;
}

void hada_features_drop(hada_features *features, size_t scene)
{
    free(features->kept[scene - 1]);
    features->kept[scene - 1] = NULL;
    features->bytes -= features->floats * sizeof(float);
}

/* Labels of the discriminator. */
enum { FAKE, REAL };

/* A call in hand: its images among the tensors. */
typedef struct terms_call {
    hada_losses *losses;
    hada_step_images *images;
    const hada_losses_call *call;
    double weight; /* of a mean over the count */
    hada_tensor x, target, dx;
} terms_call;

static hada_status make_labels(hada_losses *losses, hada_error *err)
{
    hada_step_images *images = losses->images;
    hada_buffer *ones = &images->place[HADA_STEP_REAL];
    const size_t count = ones->bytes / sizeof(float);
    float *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(values, count, "labels", err));
    for (size_t i = 0; i < count; i++)
        values[i] = 1.0f;
    HADA_TRY_OR_DONE(hada_buffer_write(ones, images->slot, 0, values, ones->bytes, err));
    losses->labels[FAKE] =
        hada_step_logits(images->slot->context, images->shape, hada_step_mem(images, HADA_STEP_FAKE));
    losses->labels[REAL] =
        hada_step_logits(images->slot->context, images->shape, hada_step_mem(images, HADA_STEP_REAL));
done:
    free(values);
    return status;
}

static hada_status make_vgg(hada_losses *losses, const hada_replica_desc *desc, hada_error *err)
{
    hada_step_images *images = losses->images;
    hada_buffer *weights = &images->place[HADA_STEP_VGG];
    HADA_TRY(hada_graph_create(&losses->vgg, images->slot, desc->vgg, &images->shape->vgg_graph, err));
    losses->features =
        hada_step_features(images->slot->context, images->shape, desc->vgg, hada_step_mem(images, HADA_STEP_FEATURES));
    HADA_TRY(hada_buffer_write(weights, images->slot, 0, desc->vgg->values, weights->bytes, err));
    HADA_TRY(hada_graph_set_weights(losses->vgg, (hada_floats){weights->mem, 0}, err));
    return hada_features_create(&losses->kept, desc->scenes, losses->features.image_stride, desc->feature_bytes, err);
}

hada_status hada_losses_create(hada_losses *losses, const hada_generator *generator, const hada_replica_desc *desc,
                               const hada_train_options *options, hada_error *err)
{
    hada_step_images *images = generator->images;
    const hada_replica_shape *shape = images->shape;
    hada_context *context = images->slot->context;
    *losses = (hada_losses){
        .images = images, .parameters = generator->parameters, .generator = generator, .options = options};
    losses->target = hada_step_tensor(context, shape, desc->net, hada_step_mem(images, HADA_STEP_TARGET));
    losses->term_gradient = hada_step_tensor(context, shape, desc->net, hada_step_mem(images, HADA_STEP_TERM_GRADIENT));
    if (shape->has_discriminator) {
        HADA_TRY(
            hada_graph_create(&losses->discriminator, images->slot, desc->discriminator, &shape->discriminator, err));
        HADA_TRY(make_labels(losses, err));
    }
    if (shape->vgg)
        HADA_TRY(make_vgg(losses, desc, err));
    return HADA_OK;
}

void hada_losses_destroy(hada_losses *losses)
{
    hada_graph_destroy(&losses->discriminator);
    hada_graph_destroy(&losses->vgg);
    hada_features_free(&losses->kept);
}

static hada_floats term(const terms_call *now, int which)
{
    return (hada_floats){hada_step_mem(now->images, HADA_STEP_TERMS), (size_t)which};
}

static cl_mem scratch(const terms_call *now)
{
    return hada_step_mem(now->images, HADA_STEP_SCRATCH);
}

/* The first `count` of at_once images. */
static hada_tensor first_images(const terms_call *now, const hada_tensor *tensor)
{
    return hada_tensor_images(tensor, 0, tensor->images / now->images->shape->at_once * now->call->count);
}

/* Zero into the gradients of the other images; `finite` is any tensor of that shape. */
static hada_status clear_rest(const terms_call *now, const hada_tensor *finite, const hada_tensor *gradient,
                              hada_error *err)
{
    const int done = gradient->images / now->images->shape->at_once * now->call->count, rest = gradient->images - done;
    if (!rest)
        return HADA_OK;
    const hada_tensor from = hada_tensor_images(finite, done, rest), to = hada_tensor_images(gradient, done, rest);
    return hada_blend(now->images->slot, 0.0f, &from, 0.0f, &to, err);
}

static hada_status squared_error(const terms_call *now, hada_error *err)
{
    hada_losses *losses = now->losses;
    hada_slot *slot = now->images->slot;
    const hada_loss_desc loss = {.loss = HADA_LOSS_MSE, .weight = (float)(losses->options->mse * now->weight)};
    const hada_planar scenes = hada_planar_like(&losses->target, hada_step_mem(now->images, HADA_STEP_SCENES), 0);
    HADA_TRY(hada_tensor_load(slot, &scenes, &losses->target, err));
    HADA_TRY(
        hada_loss_run(slot, &loss, &now->x, &now->target, term(now, HADA_TERM_MSE), &now->dx, 0, scratch(now), err));
    return clear_rest(now, &losses->target, hada_generator_output_gradient(losses->generator), err);
}

static hada_status variation(const terms_call *now, hada_error *err)
{
    const hada_train_options *options = now->losses->options;
    /* the mean is over images, and colours are images to the loss */
    const hada_loss_desc loss = {.loss = options->variation_squared ? HADA_LOSS_TV_SQUARED : HADA_LOSS_TV,
                                 .weight =
                                     (float)(options->variation * now->weight * now->losses->generator->net->colours)};
    if (options->variation <= 0.0)
        return HADA_OK;
    return hada_loss_run(now->images->slot, &loss, &now->x, NULL, term(now, HADA_TERM_VARIATION), &now->dx, 1,
                         scratch(now), err);
}

/* Plain images of the window to the input of VGG-16 (repeated: one channel for all three) or of the discriminator. */
static hada_status load_images(const terms_call *now, hada_graph *graph, int repeated, cl_mem mem, hada_error *err)
{
    const hada_replica_shape *shape = now->images->shape;
    hada_planar images = hada_planar_at(mem, 0, shape->channels, shape->rows, shape->cols);
    if (repeated)
        images.channel_stride = 0;
    return hada_graph_load(graph, &images, err);
}

/* The gradient that a graph has of its input, which has so many channels, as plain floats. */
static hada_status store_gradient(const terms_call *now, hada_graph *graph, int channels, cl_mem mem, hada_error *err)
{
    const hada_replica_shape *shape = now->images->shape;
    const hada_planar all = hada_planar_at(mem, 0, channels, shape->rows, shape->cols);
    return hada_graph_store_gradient(graph, &all, err);
}

/* Adds plain floats to the gradient of the output. */
static hada_status add_gradient(const terms_call *now, const hada_planar *part, hada_error *err)
{
    hada_losses *losses = now->losses;
    hada_slot *slot = now->images->slot;
    HADA_TRY(hada_tensor_load(slot, part, &losses->term_gradient, err));
    return hada_blend(slot, 1.0f, &losses->term_gradient, 1.0f, hada_generator_output_gradient(losses->generator), err);
}

/* The output as plain floats. */
static hada_status store_output(const terms_call *now, hada_error *err)
{
    const hada_tensor *y = hada_generator_output(now->losses->generator);
    const hada_planar plain = hada_planar_like(y, hada_step_mem(now->images, HADA_STEP_PLAIN), 0);
    return hada_tensor_store(now->images->slot, y, &plain, err);
}

static size_t feature_bytes(const hada_losses *losses)
{
    return losses->features.image_stride * sizeof(float);
}

/* The scenes' features from the store, if it has them all. */
static hada_status find_features(const terms_call *now, int *found, hada_error *err)
{
    hada_losses *losses = now->losses;
    const size_t bytes = feature_bytes(losses);
    const int images = now->images->shape->at_once;
    *found = 1;
    for (int i = 0; i < images; i++)
        *found &= hada_features_find(&losses->kept, now->call->samples[i].scene_number) != NULL;
    for (int i = 0; *found && i < images; i++)
        HADA_TRY(hada_buffer_write(&now->images->place[HADA_STEP_FEATURES], now->images->slot, (size_t)i * bytes,
                                   hada_features_find(&losses->kept, now->call->samples[i].scene_number), bytes, err));
    return HADA_OK;
}

/* The scenes' features into the store, as far as there is room. */
static hada_status keep_features(const terms_call *now, hada_error *err)
{
    hada_losses *losses = now->losses;
    const size_t bytes = feature_bytes(losses);
    hada_status status = HADA_OK;
    for (int i = 0; i < now->images->shape->at_once; i++) {
        const size_t scene = now->call->samples[i].scene_number;
        float *room = hada_features_room(&losses->kept, scene);
        if (!room)
            continue;
        status = hada_buffer_read(&now->images->place[HADA_STEP_FEATURES], now->images->slot, (size_t)i * bytes, room,
                                  bytes, err);
        if (status)
            hada_features_drop(&losses->kept, scene);
        HADA_TRY(status);
    }
    return status;
}

/* What VGG-16 makes of the scenes, into HADA_STEP_FEATURES. */
static hada_status scene_features(const terms_call *now, int repeated, hada_error *err)
{
    hada_losses *losses = now->losses;
    int found;
    HADA_TRY(find_features(now, &found, err));
    if (found)
        return HADA_OK;
    HADA_TRY(load_images(now, losses->vgg, repeated, hada_step_mem(now->images, HADA_STEP_SCENES), err));
    HADA_TRY(hada_graph_forward(losses->vgg, err));
    HADA_TRY(hada_blend(now->images->slot, 1.0f, hada_graph_output(losses->vgg), 0.0f, &losses->features, err));
    return keep_features(now, err);
}

/* The perceptual term's gradient comes back from VGG-16: a channel that was repeated has as many gradients. */
static hada_status perceptual_backward(const terms_call *now, int repeated, hada_error *err)
{
    enum { VGG_CHANNELS = 3 };
    hada_losses *losses = now->losses;
    const cl_mem plain = hada_step_mem(now->images, HADA_STEP_PLAIN);
    const int repeats = repeated ? VGG_CHANNELS : 1;
    HADA_TRY(hada_graph_backward(losses->vgg, (hada_floats){0}, 0, err));
    HADA_TRY(store_gradient(now, losses->vgg, VGG_CHANNELS, plain, err));
    for (int i = 0; i < repeats; i++) {
        hada_planar part = hada_planar_like(&losses->term_gradient, plain, (size_t)i * now->images->shape->pixels);
        part.image_stride *= (size_t)repeats;
        HADA_TRY(add_gradient(now, &part, err));
    }
    return HADA_OK;
}

/* MSE between what VGG-16 makes of the output and of the scene. */
static hada_status perceptual(const terms_call *now, hada_error *err)
{
    hada_losses *losses = now->losses;
    const hada_replica_shape *shape = now->images->shape;
    const int repeated = shape->channels == 1;
    const hada_tensor *y = hada_graph_output(losses->vgg), *dy = hada_graph_output_gradient(losses->vgg);
    const hada_tensor x = first_images(now, y), target = first_images(now, &losses->features);
    const hada_tensor dx = first_images(now, dy);
    const hada_loss_desc loss = {.loss = HADA_LOSS_MSE, .weight = (float)(losses->options->perceptual * now->weight)};
    hada_slot_stage(now->images->slot, "perceptual");
    HADA_TRY(scene_features(now, repeated, err));
    HADA_TRY(store_output(now, err));
    HADA_TRY(load_images(now, losses->vgg, repeated, hada_step_mem(now->images, HADA_STEP_PLAIN), err));
    HADA_TRY(hada_graph_forward(losses->vgg, err));
    HADA_TRY(hada_loss_run(now->images->slot, &loss, &x, &target, term(now, HADA_TERM_PERCEPTUAL), &dx, 0, scratch(now),
                           err));
    HADA_TRY(clear_rest(now, &losses->features, dy, err));
    return perceptual_backward(now, repeated, err);
}

/* The discriminator on the images of `mem`, as far as the gradient of its logits; which: the term. */
static hada_status discriminate(const terms_call *now, cl_mem mem, int label, double weight, int which, hada_error *err)
{
    hada_losses *losses = now->losses;
    const hada_tensor *y = hada_graph_output(losses->discriminator);
    const hada_tensor *dy = hada_graph_output_gradient(losses->discriminator);
    const hada_tensor x = first_images(now, y), target = first_images(now, &losses->labels[label]);
    const hada_tensor dx = first_images(now, dy);
    const hada_loss_desc loss = {.loss = HADA_LOSS_LOGITS, .weight = (float)weight};
    HADA_TRY(load_images(now, losses->discriminator, 0, mem, err));
    HADA_TRY(hada_graph_forward(losses->discriminator, err));
    HADA_TRY(hada_loss_run(now->images->slot, &loss, &x, &target, term(now, which), &dx, 0, scratch(now), err));
    return clear_rest(now, &losses->labels[FAKE], dy, err);
}

/* The discriminator's own loss on scenes and on the output, which stands in HADA_STEP_PLAIN then. */
static hada_status discriminator_loss(const terms_call *now, hada_error *err)
{
    hada_losses *losses = now->losses;
    hada_parameters *parameters = losses->parameters;
    const hada_floats gradient = hada_parameters_gradient(parameters, HADA_GROUP_DISCRIMINATOR);
    HADA_TRY(discriminate(now, hada_step_mem(now->images, HADA_STEP_SCENES), REAL, now->weight, HADA_TERM_REAL, err));
    HADA_TRY(hada_graph_backward(losses->discriminator, gradient,
                                 hada_parameters_accumulates(parameters, HADA_GROUP_DISCRIMINATOR), err));
    HADA_TRY(store_output(now, err));
    HADA_TRY(discriminate(now, hada_step_mem(now->images, HADA_STEP_PLAIN), FAKE, now->weight, HADA_TERM_FAKE, err));
    return hada_graph_backward(losses->discriminator, gradient,
                               hada_parameters_accumulates(parameters, HADA_GROUP_DISCRIMINATOR), err);
}

/* The generator's loss: its output, in HADA_STEP_PLAIN, shall count as real. */
static hada_status generator_loss(const terms_call *now, hada_error *err)
{
    hada_losses *losses = now->losses;
    const cl_mem plain = hada_step_mem(now->images, HADA_STEP_PLAIN);
    const hada_planar part = hada_planar_like(&losses->term_gradient, plain, 0);
    /* backward overwrites what it passes, so the images go through the discriminator again */
    HADA_TRY(discriminate(now, plain, REAL, losses->options->adversarial * now->weight, HADA_TERM_ADVERSARIAL, err));
    HADA_TRY(hada_graph_backward(losses->discriminator, (hada_floats){0}, 0, err));
    HADA_TRY(store_gradient(now, losses->discriminator, now->images->shape->channels, plain, err));
    return add_gradient(now, &part, err);
}

static hada_status adversarial(const terms_call *now, hada_error *err)
{
    hada_losses *losses = now->losses;
    const hada_parameter_group *group = &losses->parameters->group[HADA_GROUP_DISCRIMINATOR];
    hada_slot_stage(now->images->slot, "discriminator");
    if (losses->discriminator_version != group->version)
        HADA_TRY(hada_graph_set_weights(losses->discriminator, (hada_floats){group->values.mem, 0}, err));
    losses->discriminator_version = group->version;
    hada_graph_set_step(losses->discriminator, losses->options->seed + 1, now->call->step);
    HADA_TRY(discriminator_loss(now, err));
    if (!now->call->discriminator_only && losses->options->adversarial > 0.0)
        HADA_TRY(generator_loss(now, err));
    return HADA_OK;
}

/* Samples that have a weight: their gradient by all terms alone, so that the terms stay what they are. */
static hada_status weigh(const terms_call *now, hada_error *err)
{
    const hada_losses *losses = now->losses;
    const hada_tensor *gradient = hada_generator_output_gradient(losses->generator);
    const int each = gradient->images / now->images->shape->at_once;
    for (int i = 0; i < now->call->count; i++) {
        const float weight = (float)now->call->samples[i].weight;
        if (weight <= 0.0f)
            continue;
        const hada_tensor finite = hada_tensor_images(&losses->target, i * each, each),
                          own = hada_tensor_images(gradient, i * each, each);
        HADA_TRY(hada_blend(now->images->slot, 0.0f, &finite, weight, &own, err));
    }
    return HADA_OK;
}

hada_status hada_losses_run(hada_losses *losses, const hada_losses_call *call, hada_error *err)
{
    terms_call now = {.losses = losses, .images = losses->images, .call = call, .weight = call->weight * call->count};
    const hada_replica_shape *shape = losses->images->shape;
    now.x = first_images(&now, hada_generator_output(losses->generator));
    now.target = first_images(&now, &losses->target);
    now.dx = first_images(&now, hada_generator_output_gradient(losses->generator));
    hada_slot_stage(losses->images->slot, "losses");
    if (!call->discriminator_only) {
        HADA_TRY(squared_error(&now, err));
        HADA_TRY(variation(&now, err));
        if (shape->vgg)
            HADA_TRY(perceptual(&now, err));
    }
    if (shape->has_discriminator)
        HADA_TRY(adversarial(&now, err));
    if (!call->discriminator_only)
        HADA_TRY(weigh(&now, err));
    return HADA_OK;
}
