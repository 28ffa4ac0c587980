/* An engine as a whole: making, a step forward and backward, a look forward. */
#include "train/engine.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "filter/layout.h"
#include "train/engine_parts.h"

static hada_status make_transforms(hada_engine *engine, hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    if (!shape->filters)
        return HADA_OK;
    hada_status status = hada_fft_create(&engine->forward, engine->slot, &shape->forward, err);
    if (!status)
        status = hada_fft_create(&engine->inverse, engine->slot, &shape->inverse, err);
    return status ? status : hada_fft_create(&engine->back, engine->slot, &shape->back, err);
}

static hada_status make_graphs(hada_engine *engine, hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    hada_status status = HADA_OK;
    if (shape->net)
        status = hada_graph_create(&engine->train, engine->slot, engine->net, &shape->train, err);
    if (!status && shape->net)
        status = hada_graph_create(&engine->look, engine->slot, engine->net, &shape->look, err);
    if (!status && shape->critic)
        status = hada_graph_create(&engine->judge, engine->slot, engine->critic, &shape->judge, err);
    if (!status && shape->vgg)
        status = hada_graph_create(&engine->see, engine->slot, engine->vgg, &shape->see, err);
    return status;
}

/* All are zero at first: halos, and what fills up tensors, stay so. */
static hada_status make_buffers(hada_engine *engine, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < ENGINE_BUFFERS; i++) {
        const size_t bytes = engine->shape.bytes[i];
        if (!bytes)
            continue;
        status = hada_buffer_create(&engine->buffers[i], engine->slot->context, bytes, "the images of a step", err);
        if (!status)
            status = hada_buffer_clear(&engine->buffers[i], engine->slot, 0, bytes, err);
    }
    return status;
}

static hada_tensor window_tensor(const hada_engine *engine, int buffer)
{
    return hada_engine_tensor(engine->slot->context, &engine->shape, engine->net, engine->buffers[buffer].mem);
}

static hada_status make_labels(hada_engine *engine, hada_error *err)
{
    hada_buffer *ones = &engine->buffers[ENGINE_TRUE];
    const size_t count = ones->bytes / sizeof(float);
    float *values;
    hada_status status = hada_alloc_raw((void **)&values, count, sizeof *values, "labels", err);
    if (status)
        return status;
    for (size_t i = 0; i < count; i++)
        values[i] = 1.0f;
    status = hada_buffer_write(ones, engine->slot, 0, values, ones->bytes, err);
    free(values);
    for (int label = 0; label < 2; label++)
        engine->labels[label] =
            hada_engine_logits(engine->slot->context, &engine->shape, engine->buffers[ENGINE_FALSE + label].mem);
    return status;
}

static hada_status fill(hada_engine *engine, hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    hada_status status = HADA_OK;
    float *columns = NULL;
    if (shape->net) {
        engine->in = window_tensor(engine, ENGINE_IN);
        engine->out = window_tensor(engine, ENGINE_OUT);
        engine->fall = window_tensor(engine, ENGINE_FALL);
        engine->target = window_tensor(engine, ENGINE_TARGET);
        engine->share = window_tensor(engine, ENGINE_SHARE);
    }
    if (shape->vgg) {
        hada_buffer *weights = &engine->buffers[ENGINE_VGG];
        engine->features =
            hada_engine_features(engine->slot->context, shape, engine->vgg, engine->buffers[ENGINE_FEATURES].mem);
        status = hada_buffer_write(weights, engine->slot, 0, engine->vgg->values, weights->bytes, err);
        if (!status)
            status = hada_graph_set_weights(engine->see, (hada_floats){weights->mem, 0}, err);
    }
    if (!status && shape->critic)
        status = make_labels(engine, err);
    if (status || !shape->filters)
        return status;
    status = hada_alloc((void **)&columns, shape->layout.count, sizeof *columns, "a half spectrum", err);
    if (!status) {
        hada_layout_weights(&shape->layout, columns);
        status = hada_buffer_write(&engine->buffers[ENGINE_COLUMNS], engine->slot, 0, columns,
                                   shape->layout.count * sizeof *columns, err);
    }
    free(columns);
    return status;
}

hada_status hada_engine_create(hada_engine **out, hada_slot *slot, const hada_engine_desc *desc, hada_error *err)
{
    hada_engine *engine;
    *out = NULL;
    hada_status status = hada_alloc((void **)&engine, 1, sizeof *engine, "training", err);
    if (status)
        return status;
    engine->slot = slot;
    engine->options = *desc->options;
    engine->net = desc->net;
    engine->critic = desc->critic;
    engine->vgg = desc->vgg;
    engine->new_train = engine->new_look = engine->new_judge = 1;
    status = hada_engine_shape_of(slot->context, desc, &engine->shape, err);
    if (!status)
        status = make_transforms(engine, err);
    if (!status)
        status = make_graphs(engine, err);
    if (!status)
        status = make_buffers(engine, err);
    if (!status)
        status = hada_engine_groups_make(engine, desc, err);
    if (!status)
        status = fill(engine, err);
    if (!status)
        status = hada_engine_features_make(engine, desc, err);
    if (status)
        hada_engine_destroy(&engine);
    *out = engine;
    return status;
}

void hada_engine_destroy(hada_engine **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_engine *engine = *pointer;
    *pointer = NULL;
    hada_slot_finish(engine->slot, NULL);
    hada_graph *graphs[] = {engine->train, engine->look, engine->judge, engine->see};
    for (size_t i = 0; i < HADA_COUNT(graphs); i++)
        hada_graph_destroy(&graphs[i]);
    hada_fft *transforms[] = {engine->forward, engine->inverse, engine->back};
    for (size_t i = 0; i < HADA_COUNT(transforms); i++)
        hada_fft_destroy(&transforms[i]);
    for (int i = 0; i < ENGINE_BUFFERS; i++)
        hada_buffer_destroy(&engine->buffers[i]);
    hada_engine_groups_free(engine);
    hada_features_free(&engine->kept);
    free(engine);
}

static hada_status check_samples(const hada_engine *engine, const hada_sample *samples, int count, int scenes,
                                 hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    if (count < 1 || count > shape->at_once)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "training: %d pairs of at most %d at once", count, shape->at_once);
    for (int i = 0; i < count; i++) {
        const hada_sample *sample = &samples[i];
        if (shape->filters && (sample->depth < 0 || sample->depth >= shape->depths))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "training: a pair of depth %d of %d", sample->depth,
                             shape->depths);
        if (hada_image_count(sample->input) != (shape->filters ? shape->frame : shape->plane) ||
            (scenes && hada_image_count(sample->scene) != shape->plane))
            return hada_fail(err, HADA_ERROR_SIZE, "training: an image of another size than the model's");
    }
    return HADA_OK;
}

static hada_status upload(hada_engine *engine, int buffer, const hada_image *image, int place, hada_error *err)
{
    const size_t bytes = engine->shape.plane * sizeof(float);
    hada_slot_stage(engine->slot, "upload");
    return hada_buffer_write(&engine->buffers[buffer], engine->slot, (size_t)place * bytes, image->data, bytes, err);
}

/* `count` samples: frames refocused, or planes as they are; scenes. */
static hada_status take_samples(hada_engine *engine, const hada_sample *samples, int count, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < count; i++)
        status = upload(engine, ENGINE_SCENES, samples[i].scene, i, err);
    if (status || engine->shape.filters)
        return status ? status : hada_engine_refocus(engine, samples, count, engine->shape.net, err);
    for (int i = 0; !status && i < count; i++)
        status = upload(engine, ENGINE_PLANES, samples[i].input, i, err);
    return status;
}

/* All images of the graphs are looked at: where there are fewer samples they come again. */
static hada_status net_step(hada_engine *engine, const hada_sample *samples, int count, double weight, uint64_t step,
                            int critic_only, unsigned char *touched, hada_error *err)
{
    const int at_once = engine->shape.at_once;
    hada_sample *all;
    hada_status status = hada_alloc((void **)&all, (size_t)at_once, sizeof *all, "the pairs of a step", err);
    for (int i = 0; !status && i < at_once; i++)
        all[i] = samples[i % count];
    engine->samples = all;
    if (!status)
        status = take_samples(engine, all, at_once, err);
    if (!status)
        status = hada_engine_net_forward(engine, step, err);
    if (!status)
        status = hada_engine_losses(engine, count, weight, step, critic_only, err);
    if (!status && !critic_only)
        status = hada_engine_net_backward(engine, err);
    if (!status && !critic_only && engine->shape.filters)
        status = hada_engine_mask(engine, err);
    if (!status && !critic_only && engine->shape.filters)
        status = hada_engine_filter_gradients(engine, all, at_once, engine->buffers[ENGINE_FLAT].mem, touched, err);
    engine->samples = NULL;
    free(all);
    return status;
}

static hada_status filter_step(hada_engine *engine, const hada_sample *samples, int count, double weight,
                               unsigned char *touched, hada_error *err)
{
    hada_status status = take_samples(engine, samples, count, err);
    if (!status)
        status = hada_engine_plane_error(engine, count, weight, err);
    return status
               ? status
               : hada_engine_filter_gradients(engine, samples, count, engine->buffers[ENGINE_PLANES].mem, touched, err);
}

hada_status hada_engine_backward(hada_engine *engine, const hada_sample *samples, int count, double weight,
                                 uint64_t step, int critic_only, hada_terms *terms, unsigned char *touched,
                                 hada_error *err)
{
    const hada_buffer *buffer = &engine->buffers[ENGINE_TERMS];
    float values[ENGINE_TERM_COUNT] = {0.0f};
    hada_status status = check_samples(engine, samples, count, 1, err);
    if (!status && critic_only && !engine->shape.critic)
        status = hada_fail(err, HADA_ERROR_ARGUMENT, "training: there is no discriminator");
    if (!status)
        status = hada_buffer_clear(&engine->buffers[ENGINE_TERMS], engine->slot, 0, sizeof values, err);
    if (!status)
        status = engine->shape.net ? net_step(engine, samples, count, weight, step, critic_only, touched, err)
                                   : filter_step(engine, samples, count, weight, touched, err);
    if (!status)
        status = hada_buffer_read(buffer, engine->slot, 0, values, sizeof values, err);
    if (!status)
        *terms = (hada_terms){.mse = values[ENGINE_MSE],
                              .perceptual = values[ENGINE_PERCEPTUAL],
                              .adversarial = values[ENGINE_ADVERSARIAL],
                              .variation = values[ENGINE_VARIATION],
                              .critic = (double)values[ENGINE_REAL] + values[ENGINE_FAKE]};
    return status;
}

static hada_status make_image(const hada_engine *engine, hada_image *image, hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    if (image->data && hada_image_count(image) == shape->plane)
        return HADA_OK;
    hada_image_destroy(image);
    return hada_image_create(image, shape->channels, shape->rows, shape->cols, err);
}

static int is_black(const hada_image *image)
{
    for (size_t i = 0; i < hada_image_count(image); i++)
        if (image->data[i] != 0.0f)
            return 0;
    return 1;
}

/* The plane that the net sees, on the device and in `after`. */
static hada_status look_before(hada_engine *engine, const hada_sample *sample, hada_image *after, hada_error *err)
{
    const size_t bytes = engine->shape.plane * sizeof(float);
    if (!engine->shape.filters) {
        memcpy(after->data, sample->input->data, bytes);
        return upload(engine, ENGINE_PLANES, sample->input, 0, err);
    }
    hada_status status = hada_engine_refocus(engine, sample, 1, 1, err);
    return status ? status
                  : hada_buffer_read(&engine->buffers[ENGINE_PLANES], engine->slot, 0, after->data, bytes, err);
}

hada_status hada_engine_forward(hada_engine *engine, const hada_sample *sample, hada_image *before, hada_image *after,
                                hada_error *err)
{
    const size_t bytes = engine->shape.plane * sizeof(float);
    hada_status status = check_samples(engine, sample, 1, 0, err);
    if (!status)
        status = make_image(engine, after, err);
    if (!status && before)
        status = make_image(engine, before, err);
    if (!status)
        status = look_before(engine, sample, after, err);
    if (!status && before)
        memcpy(before->data, after->data, bytes);
    /* a plane without content stays so, as in reconstruction */
    if (status || !engine->shape.net || is_black(after))
        return status;
    status = hada_engine_net_look(engine, err);
    return status ? status : hada_buffer_read(&engine->buffers[ENGINE_FLAT], engine->slot, 0, after->data, bytes, err);
}
