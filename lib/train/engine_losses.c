/* The losses of a net's output, with their gradients: of the output, and of the critic.
 *
 * Graphs run on at_once images; the terms look at the first `count` of them, and the others' gradients are zero. */
#include "train/engine_parts.h"

/* A call in hand. */
typedef struct judged {
    hada_engine *engine;
    int count;
    double weight; /* of a mean over the count */
    hada_tensor x, target, dx;
} judged;

static hada_floats term(const judged *j, int which)
{
    return (hada_floats){j->engine->buffers[ENGINE_TERMS].mem, (size_t)which};
}

/* The first `count` of at_once images. */
static hada_tensor first_images(const judged *j, const hada_tensor *tensor)
{
    return hada_tensor_images(tensor, 0, tensor->images / j->engine->shape.at_once * j->count);
}

/* Zero into the gradients of the other images; `finite` is any tensor of that shape. */
static hada_status clear_rest(const judged *j, const hada_tensor *finite, const hada_tensor *gradient, hada_error *err)
{
    const int done = gradient->images / j->engine->shape.at_once * j->count, rest = gradient->images - done;
    if (!rest)
        return HADA_OK;
    const hada_tensor from = hada_tensor_images(finite, done, rest), to = hada_tensor_images(gradient, done, rest);
    return hada_blend(j->engine->slot, 0.0f, &from, 0.0f, &to, err);
}

static hada_status squared_error(const judged *j, hada_error *err)
{
    hada_engine *engine = j->engine;
    const hada_loss_desc loss = {.loss = HADA_LOSS_MSE, .weight = (float)(engine->options.mse * j->weight)};
    const hada_planar scenes = hada_engine_plain(&engine->target, engine->buffers[ENGINE_SCENES].mem, 0);
    hada_status status = hada_tensor_load(engine->slot, &scenes, &engine->target, err);
    if (!status)
        status = hada_loss_run(engine->slot, &loss, &j->x, &j->target, term(j, ENGINE_MSE), &j->dx, 0,
                               engine->buffers[ENGINE_SUMS].mem, err);
    return status ? status : clear_rest(j, &engine->target, hada_engine_output_gradient(engine), err);
}

static hada_status variation(const judged *j, hada_error *err)
{
    hada_engine *engine = j->engine;
    /* the mean is over images, and colours are images to the loss */
    const hada_loss_desc loss = {.loss = engine->options.variation_squared ? HADA_LOSS_TV_SQUARED : HADA_LOSS_TV,
                                 .weight = (float)(engine->options.variation * j->weight * engine->net->colours)};
    if (engine->options.variation <= 0.0)
        return HADA_OK;
    return hada_loss_run(engine->slot, &loss, &j->x, NULL, term(j, ENGINE_VARIATION), &j->dx, 1,
                         engine->buffers[ENGINE_SUMS].mem, err);
}

/* Plain images of the window to the input of VGG (repeated: one channel for all three) or of the critic. */
static hada_status show(const judged *j, hada_graph *graph, int repeated, cl_mem mem, size_t image_stride,
                        hada_error *err)
{
    const hada_planar images = {.mem = mem,
                                .image_stride = image_stride,
                                .channel_stride = repeated ? 0 : j->engine->shape.pixels,
                                .row_stride = (size_t)j->engine->shape.cols};
    return hada_graph_load(graph, &images, err);
}

/* The gradient that a graph has of its input, which has so many channels, as plain floats. */
static hada_status store_gradient(const judged *j, hada_graph *graph, int channels, cl_mem mem, hada_error *err)
{
    const size_t pixels = j->engine->shape.pixels;
    const hada_planar all = {.mem = mem,
                             .image_stride = (size_t)channels * pixels,
                             .channel_stride = pixels,
                             .row_stride = (size_t)j->engine->shape.cols};
    return hada_graph_store_gradient(graph, &all, err);
}

/* Adds plain floats to the gradient of the output. */
static hada_status take_share(const judged *j, const hada_planar *part, hada_error *err)
{
    hada_engine *engine = j->engine;
    hada_status status = hada_tensor_load(engine->slot, part, &engine->share, err);
    return status ? status
                  : hada_blend(engine->slot, 1.0f, &engine->share, 1.0f, hada_engine_output_gradient(engine), err);
}

/* The output as plain floats in ENGINE_FLAT. */
static hada_status store_output(const judged *j, hada_error *err)
{
    const hada_tensor *y = hada_engine_output(j->engine);
    const hada_planar flat = hada_engine_plain(y, j->engine->buffers[ENGINE_FLAT].mem, 0);
    return hada_tensor_store(j->engine->slot, y, &flat, err);
}

/* What VGG-16 makes of the scenes, into ENGINE_FEATURES. */
static hada_status scene_features(const judged *j, int repeated, hada_error *err)
{
    hada_engine *engine = j->engine;
    hada_graph *see = engine->see;
    int found;
    hada_status status = hada_engine_features_find(engine, &found, err);
    if (status || found)
        return status;
    status = show(j, see, repeated, engine->buffers[ENGINE_SCENES].mem, engine->shape.plane, err);
    if (!status)
        status = hada_graph_forward(see, err);
    if (!status)
        status = hada_blend(engine->slot, 1.0f, hada_graph_output(see), 0.0f, &engine->features, err);
    return status ? status : hada_engine_features_keep(engine, err);
}

/* MSE between what VGG-16 makes of the output and of the scene. */
static hada_status perceptual(const judged *j, hada_error *err)
{
    hada_engine *engine = j->engine;
    hada_graph *see = engine->see;
    const int repeated = engine->shape.channels == 1;
    const hada_tensor *y = hada_graph_output(see), *dy = hada_graph_output_gradient(see);
    const hada_tensor x = first_images(j, y), target = first_images(j, &engine->features), dx = first_images(j, dy);
    const hada_loss_desc loss = {.loss = HADA_LOSS_MSE, .weight = (float)(engine->options.perceptual * j->weight)};
    hada_slot_stage(engine->slot, "perceptual");
    hada_status status = scene_features(j, repeated, err);
    if (!status)
        status = store_output(j, err);
    if (!status)
        status = show(j, see, repeated, engine->buffers[ENGINE_FLAT].mem, engine->shape.plane, err);
    if (!status)
        status = hada_graph_forward(see, err);
    if (!status)
        status = hada_loss_run(engine->slot, &loss, &x, &target, term(j, ENGINE_PERCEPTUAL), &dx, 0,
                               engine->buffers[ENGINE_SUMS].mem, err);
    if (!status)
        status = clear_rest(j, &engine->features, dy, err);
    if (!status)
        status = hada_graph_backward(see, (hada_floats){0}, 0, err);
    if (!status)
        status = store_gradient(j, see, 3, engine->buffers[ENGINE_FLAT].mem, err);
    /* a channel that was repeated has as many gradients */
    const int repeats = repeated ? 3 : 1;
    for (int i = 0; !status && i < repeats; i++) {
        hada_planar part =
            hada_engine_plain(&engine->share, engine->buffers[ENGINE_FLAT].mem, (size_t)i * engine->shape.pixels);
        part.image_stride *= (size_t)repeats;
        status = take_share(j, &part, err);
    }
    return status;
}

/* All at_once images of `mem` into one half of ENGINE_PAIRS, or (out) out of it: planes are the first half, what is
 * judged the second. */
static hada_status copy_half(const judged *j, int half, cl_mem mem, int out, hada_error *err)
{
    const hada_engine *engine = j->engine;
    const cl_mem pairs = engine->buffers[ENGINE_PAIRS].mem;
    const size_t bytes = engine->shape.plane * sizeof(float), alone[3] = {0, 0, 0},
                 paired[3] = {half ? bytes : 0, 0, 0};
    const size_t region[3] = {bytes, (size_t)engine->shape.at_once, 1};
    const cl_int code = out ? clEnqueueCopyBufferRect(engine->slot->queue, pairs, mem, paired, alone, region, 2 * bytes,
                                                      0, bytes, 0, 0, NULL, NULL)
                            : clEnqueueCopyBufferRect(engine->slot->queue, mem, pairs, alone, paired, region, bytes, 0,
                                                      2 * bytes, 0, 0, NULL, NULL);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueCopyBufferRect");
}

/* The critic on the images of `mem`, as far as the gradient of its logits. */
static hada_status judge(const judged *j, cl_mem mem, int label, double weight, int which, hada_error *err)
{
    hada_engine *engine = j->engine;
    const hada_tensor *y = hada_graph_output(engine->judge), *dy = hada_graph_output_gradient(engine->judge);
    const hada_tensor x = first_images(j, y), target = first_images(j, &engine->labels[label]);
    const hada_tensor dx = first_images(j, dy);
    const hada_loss_desc loss = {.loss = HADA_LOSS_LOGITS, .weight = (float)weight};
    hada_status status = HADA_OK;
    if (engine->shape.paired) {
        status = copy_half(j, 1, mem, 0, err);
        mem = engine->buffers[ENGINE_PAIRS].mem;
    }
    if (!status)
        status = show(j, engine->judge, 0, mem, engine->shape.plane << engine->shape.paired, err);
    if (!status)
        status = hada_graph_forward(engine->judge, err);
    if (!status)
        status = hada_loss_run(engine->slot, &loss, &x, &target, term(j, which), &dx, 0,
                               engine->buffers[ENGINE_SUMS].mem, err);
    return status ? status : clear_rest(j, &engine->labels[0], dy, err);
}

static hada_status adversarial(const judged *j, uint64_t step, int critic_only, hada_error *err)
{
    hada_engine *engine = j->engine;
    const engine_group *group = &engine->groups[HADA_GROUP_CRITIC];
    const hada_floats gradient = {group->gradient.mem, 0}, none = {0};
    const cl_mem flat = engine->buffers[ENGINE_FLAT].mem, scenes = engine->buffers[ENGINE_SCENES].mem;
    hada_status status = HADA_OK;
    hada_slot_stage(engine->slot, "critic");
    if (engine->new_judge)
        status = hada_graph_set_weights(engine->judge, (hada_floats){group->values.mem, 0}, err);
    if (!status)
        engine->new_judge = 0;
    hada_graph_set_step(engine->judge, engine->options.seed + 1, step);
    if (!status && engine->shape.paired)
        status = copy_half(j, 0, engine->buffers[ENGINE_PLANES].mem, 0, err);
    if (!status)
        status = judge(j, scenes, 1, j->weight, ENGINE_REAL, err);
    if (!status)
        status = hada_graph_backward(engine->judge, gradient, hada_engine_accumulates(engine, HADA_GROUP_CRITIC), err);
    if (!status)
        status = store_output(j, err);
    if (!status)
        status = judge(j, flat, 0, j->weight, ENGINE_FAKE, err);
    if (!status)
        status = hada_graph_backward(engine->judge, gradient, hada_engine_accumulates(engine, HADA_GROUP_CRITIC), err);
    if (status || critic_only || engine->options.adversarial <= 0.0)
        return status;
    /* backward overwrites what it passes, so the net's images are looked at again for its own loss */
    status = judge(j, flat, 1, engine->options.adversarial * j->weight, ENGINE_ADVERSARIAL, err);
    if (!status)
        status = hada_graph_backward(engine->judge, none, 0, err);
    const int paired = engine->shape.paired;
    const cl_mem pairs = engine->buffers[ENGINE_PAIRS].mem;
    if (!status)
        status = store_gradient(j, engine->judge, engine->shape.channels << paired, paired ? pairs : flat, err);
    if (!status && paired)
        status = copy_half(j, 1, flat, 1, err);
    const hada_planar part = hada_engine_plain(&engine->share, flat, 0);
    return status ? status : take_share(j, &part, err);
}

hada_status hada_engine_losses(hada_engine *engine, int count, double weight, uint64_t step, int critic_only,
                               hada_error *err)
{
    judged j = {.engine = engine, .count = count, .weight = weight * count};
    j.x = first_images(&j, hada_engine_output(engine));
    j.target = first_images(&j, &engine->target);
    j.dx = first_images(&j, hada_engine_output_gradient(engine));
    hada_status status = HADA_OK;
    hada_slot_stage(engine->slot, "losses");
    if (!critic_only) {
        status = squared_error(&j, err);
        if (!status)
            status = variation(&j, err);
        if (!status && engine->shape.vgg)
            status = perceptual(&j, err);
    }
    return status || !engine->shape.critic ? status : adversarial(&j, step, critic_only, err);
}
