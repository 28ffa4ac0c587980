/* A replica: its parts, a step, forward alone; the filters of a step; its gradient in buckets. */
#include "train/replica.h"
#include "filter/bank.h"
#include "filter/hadamard.h"
#include "kernels/shared_train.h"
#include "launch/train.h"
#include "net/layer_launch.h"

/* Work-items of a group. */
enum { GROUP = 64 };

static hada_status write_columns(hada_step_images *images, hada_error *err)
{
    const hada_spectrum_layout *layout = &images->shape->layout;
    float *columns = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(columns, layout->count, "a half spectrum", err));
    hada_layout_weights(layout, columns);
    HADA_TRY_OR_DONE(hada_buffer_write(&images->place[HADA_STEP_COLUMN_WEIGHTS], images->slot, 0, columns,
                                       layout->count * sizeof *columns, err));
done:
    free(columns);
    return status;
}

static hada_status filter_step_create(hada_filter_step *step, hada_step_images *images, hada_parameters *parameters,
                                      hada_error *err)
{
    const hada_replica_shape *shape = images->shape;
    *step = (hada_filter_step){.images = images, .parameters = parameters};
    HADA_TRY(hada_fft_create(&step->forward, images->slot, &shape->forward, err));
    HADA_TRY(hada_fft_create(&step->inverse, images->slot, &shape->inverse, err));
    HADA_TRY(hada_fft_create(&step->back, images->slot, &shape->back, err));
    return write_columns(images, err);
}

static hada_status upload_frames(hada_step_images *images, const hada_sample *samples, int count, hada_error *err)
{
    const size_t bytes = images->shape->frame * sizeof(float);
    hada_slot_stage(images->slot, "upload");
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_buffer_write(&images->place[HADA_STEP_RAW], images->slot, (size_t)i * bytes,
                                   samples[i].input->data, bytes, err));
    return HADA_OK;
}

/* Raw frames to planes: clipped at zero or as they are. */
static hada_status filter_step_forward(hada_filter_step *step, const hada_sample *samples, int count, int clipped,
                                       hada_error *err)
{
    hada_step_images *images = step->images;
    const hada_replica_shape *shape = images->shape;
    const cl_mem spectra = hada_step_mem(images, HADA_STEP_SPECTRA), planes = hada_step_mem(images, HADA_STEP_PLANES);
    const size_t values = (size_t)shape->channels * shape->layout.count;
    hada_fft_filter filter = {.product = shape->form == HADA_FORM_SPLIT ? HADA_FFT_SPLIT : HADA_FFT_COMPLEX,
                              .spectrum_count = shape->channels};
    HADA_TRY(upload_frames(images, samples, count, err));
    hada_slot_stage(images->slot, "filters");
    HADA_TRY(hada_fft_forward(step->forward, count * shape->channels, hada_step_mem(images, HADA_STEP_RAW), 0, spectra,
                              0, err));
    for (int i = 0; i < count; i++) {
        filter.filter = hada_parameters_values(step->parameters, HADA_GROUP_FILTERS + samples[i].depth).mem;
        HADA_TRY(hada_fft_inverse(step->inverse, shape->channels, spectra, (size_t)i * values, planes,
                                  (size_t)i * shape->plane, &filter, err));
    }
    if (clipped)
        HADA_TRY(hada_image_clip(images->slot, planes, (size_t)count * shape->plane, err));
    return HADA_OK;
}

/* Adds the gradient of one plane, whose spectrum stands in HADA_STEP_PLANE_SPECTRUM. */
static hada_status add_gradient(hada_filter_step *step, int image, int depth, hada_error *err)
{
    const hada_step_images *images = step->images;
    const hada_replica_shape *shape = images->shape;
    const size_t count = shape->layout.count, channels = (size_t)shape->channels;
    const hada_range range = hada_range_of(hada_divide_up(count, HADA_TRAIN_VECTOR), GROUP, channels, 1);
    const double values = (double)count * shape->channels;
    hada_slot_cost(images->slot, 32.0 * values, 10.0 * values);
    return hada_launch_train_filter(
        images->slot, HADA_PROGRAM_TRAIN_DEFAULT, &range, err, .b = hada_step_mem(images, HADA_STEP_SPECTRA),
        .offset = (size_t)image * channels * count, .g = hada_step_mem(images, HADA_STEP_PLANE_SPECTRUM),
        .weights = hada_step_mem(images, HADA_STEP_COLUMN_WEIGHTS),
        .gradient = hada_parameters_gradient(step->parameters, HADA_GROUP_FILTERS + depth).mem, .count = count,
        .scale = (cl_float)(1.0 / ((double)shape->layout.rows * shape->layout.cols)),
        .split = shape->form == HADA_FORM_SPLIT);
}

/* The gradients of `count` planes, in their place, to those of filters. */
static hada_status filter_step_backward(hada_filter_step *step, const hada_sample *samples, int count,
                                        unsigned char *touched, hada_error *err)
{
    const hada_step_images *images = step->images;
    const hada_replica_shape *shape = images->shape;
    const cl_mem planes = hada_step_mem(images, HADA_STEP_PLANES);
    hada_slot_stage(images->slot, "filters");
    for (int i = 0; i < count; i++) {
        HADA_TRY(hada_fft_forward(step->back, shape->channels, planes, (size_t)i * shape->plane,
                                  hada_step_mem(images, HADA_STEP_PLANE_SPECTRUM), 0, err));
        HADA_TRY(hada_parameters_settle(step->parameters, HADA_GROUP_FILTERS + samples[i].depth, err));
        HADA_TRY(add_gradient(step, i, samples[i].depth, err));
        if (touched)
            touched[samples[i].depth] = 1;
    }
    return HADA_OK;
}

/* The squared error of the planes, times `weight` over the samples; they become its gradient. */
static hada_status filter_step_error(hada_filter_step *step, int count, double weight, hada_error *err)
{
    const hada_step_images *images = step->images;
    const size_t plane = images->shape->plane, values = (size_t)count * plane;
    const size_t items = hada_divide_up(values, HADA_TRAIN_RUN);
    const double share = weight / (double)plane;
    const hada_range range = hada_layer_flat_range(images->slot, items, 1);
    const cl_mem sums = hada_step_mem(images, HADA_STEP_SCRATCH);
    const hada_floats value = {hada_step_mem(images, HADA_STEP_TERMS), HADA_TERM_MSE};
    hada_slot_stage(images->slot, "losses");
    hada_slot_cost(images->slot, 12.0 * (double)values, 4.0 * (double)values);
    HADA_TRY(hada_launch_train_error(images->slot, HADA_PROGRAM_TRAIN_DEFAULT, &range, err,
                                     .x = hada_step_mem(images, HADA_STEP_PLANES),
                                     .target = hada_step_mem(images, HADA_STEP_SCENES), .count = values,
                                     .scale = (cl_float)(2.0 * share), .sums = sums));
    return hada_sum_floats(images->slot, sums, items, (float)share, value, err);
}

hada_status hada_buckets_create(hada_buckets *buckets, const hada_communicator *ranks, hada_parameters *parameters,
                                hada_error *err)
{
    const size_t floats = hada_parameters_floats(parameters, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
    const int cpu = parameters->slot->context->info.kind == HADA_DEVICE_CPU;
    hada_status status = HADA_OK;
    *buckets = (hada_buckets){0};
    if (hada_ranks(ranks) == 1 || !floats || (cpu && !ranks->network))
        return HADA_OK;
    buckets->ranks = ranks;
    buckets->parameters = parameters;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(buckets->values, floats, "a gradient", err));
    HADA_TRY_OR_DONE(HADA_NEW(buckets->bucket, floats / HADA_BUCKET + 1, "a gradient", err));
done:
    if (status)
        hada_buckets_free(buckets);
    return status;
}

static void release(hada_buckets *buckets)
{
    for (int i = 0; i < buckets->count; i++)
        if (buckets->bucket[i].event)
            clReleaseEvent(buckets->bucket[i].event);
    buckets->count = 0;
}

void hada_buckets_free(hada_buckets *buckets)
{
    release(buckets);
    HADA_FREE(buckets->values, buckets->bucket);
    *buckets = (hada_buckets){0};
}

static void buckets_begin(hada_buckets *buckets)
{
    release(buckets);
    buckets->full = 0;
    buckets->from = hada_parameters_floats(buckets->parameters, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
}

/* The sizes are those of the net's layers, and so the same on all ranks. */
static hada_status buckets_ready(void *user, size_t from, hada_error *err)
{
    hada_buckets *buckets = user;
    hada_parameters *parameters = buckets->parameters;
    const size_t count = buckets->from > from ? buckets->from - from : 0;
    if (!count || (count < HADA_BUCKET && from))
        return HADA_OK;
    hada_bucket *next = &buckets->bucket[buckets->count];
    *next = (hada_bucket){from, count, NULL};
    HADA_TRY(hada_buffer_read_event(&parameters->group[HADA_GROUP_NET].gradient, parameters->slot, from * sizeof(float),
                                    buckets->values + from, count * sizeof(float), &next->event, err));
    buckets->count++;
    buckets->from = from;
    return HADA_OK;
}

/* After it was enqueued: waits for each bucket and adds it up over ranks. */
static hada_status buckets_exchange(hada_buckets *buckets, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(buckets_ready(buckets, 0, err));
    for (int i = 0; i < buckets->count; i++) {
        const hada_bucket *it = &buckets->bucket[i];
        const cl_int code = clWaitForEvents(1, &it->event);
        if (code != CL_SUCCESS)
            HADA_TRY_OR_DONE(hada_fail_cl(err, code, "clWaitForEvents"));
        HADA_TRY_OR_DONE(hada_reduce_floats(buckets->ranks, buckets->values + it->first, it->count, err));
    }
    buckets->full = 1;
done:
    /* nothing may still be written into `values` */
    if (status)
        hada_slot_finish(buckets->parameters->slot, NULL);
    release(buckets);
    return status;
}

struct hada_replica {
    hada_train_options options;
    hada_replica_shape shape;
    hada_step_images images;
    hada_parameters parameters;
    hada_filter_step filters; /* where the shape has them; so the others */
    hada_generator generator;
    hada_losses losses;
    hada_buckets *buckets; /* of the pass that comes; NULL: none */
};

hada_status hada_replica_create(hada_replica **out, hada_slot *slot, const hada_replica_desc *desc, hada_error *err)
{
    hada_replica *replica = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(replica, 1, "training", err));
    replica->images.slot = slot;
    replica->options = *desc->options;
    HADA_TRY_OR_DONE(hada_replica_shape_of(slot->context, desc, &replica->shape, err));
    HADA_TRY_OR_DONE(hada_step_images_create(&replica->images, slot, &replica->shape, err));
    HADA_TRY_OR_DONE(hada_parameters_create(&replica->parameters, &replica->images, desc, err));
    if (replica->shape.filters) {
        HADA_TRY_OR_DONE(filter_step_create(&replica->filters, &replica->images, &replica->parameters, err));
    } else {
        HADA_TRY_OR_DONE(hada_generator_create(&replica->generator, &replica->images, &replica->parameters, desc, err));
        HADA_TRY_OR_DONE(hada_losses_create(&replica->losses, &replica->generator, desc, &replica->options, err));
    }
done:
    if (status)
        hada_replica_destroy(&replica);
    *out = replica;
    return status;
}

void hada_replica_destroy(hada_replica **pointer)
{
    hada_replica *replica = hada_taken(pointer);
    if (!replica)
        return;
    hada_slot_finish(replica->images.slot, NULL);
    hada_losses_destroy(&replica->losses);
    hada_generator_destroy(&replica->generator);
    hada_fft_destroy(&replica->filters.forward);
    hada_fft_destroy(&replica->filters.inverse);
    hada_fft_destroy(&replica->filters.back);
    hada_parameters_destroy(&replica->parameters);
    hada_step_images_destroy(&replica->images);
    free(replica);
}

hada_status hada_replica_bytes(const hada_context *context, const hada_replica_desc *desc, size_t *bytes,
                               hada_error *err)
{
    hada_dry dry;
    hada_replica *replica;
    hada_dry_begin(&dry, context);
    const hada_status status = hada_replica_create(&replica, &dry.slot, desc, err);
    *bytes = (size_t)hada_context_bytes(&dry.context);
    hada_replica_destroy(&replica);
    hada_dry_end(&dry);
    return status;
}

hada_parameters *hada_replica_parameters(hada_replica *replica)
{
    return &replica->parameters;
}

hada_features *hada_replica_features(hada_replica *replica)
{
    return &replica->losses.kept;
}

void hada_replica_share(hada_replica *replica, hada_buckets *buckets)
{
    replica->buckets = buckets;
    if (replica->shape.net)
        hada_graph_watch(replica->generator.training, buckets ? buckets_ready : NULL, buckets);
}

/* `count` samples: frames refocused, or planes as they are; scenes. */
static hada_status take_samples(hada_replica *replica, const hada_sample *samples, int count, hada_error *err)
{
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_step_upload(&replica->images, HADA_STEP_SCENES, samples[i].scene, i, err));
    if (replica->shape.filters)
        return filter_step_forward(&replica->filters, samples, count, 0, err);
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_step_upload(&replica->images, HADA_STEP_PLANES, samples[i].input, i, err));
    return HADA_OK;
}

/* A step of a net on all at_once samples. */
static hada_status net_step(hada_replica *replica, const hada_losses_call *call, hada_error *err)
{
    const int at_once = replica->shape.at_once;
    HADA_TRY(take_samples(replica, call->samples, at_once, err));
    HADA_TRY(hada_generator_forward(&replica->generator, call->step, err));
    HADA_TRY(hada_losses_run(&replica->losses, call, err));
    if (call->discriminator_only)
        return HADA_OK;
    if (replica->buckets)
        buckets_begin(replica->buckets);
    HADA_TRY(hada_generator_backward(&replica->generator, err));
    if (replica->buckets) /* the device goes on meanwhile */
        HADA_TRY(buckets_exchange(replica->buckets, err));
    return HADA_OK;
}

/* All images of the graphs are computed: where there are fewer samples they come again. */
static hada_status filled_step(hada_replica *replica, hada_losses_call call, hada_error *err)
{
    const int at_once = replica->shape.at_once;
    hada_sample *all = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(all, (size_t)at_once, "the pairs of a step", err));
    for (int i = 0; i < at_once; i++)
        all[i] = call.samples[i % call.count];
    call.samples = all;
    HADA_TRY_OR_DONE(net_step(replica, &call, err));
done:
    free(all);
    return status;
}

static hada_status filters_alone(hada_replica *replica, const hada_sample *samples, int count, double weight,
                                 unsigned char *touched, hada_error *err)
{
    HADA_TRY(take_samples(replica, samples, count, err));
    HADA_TRY(filter_step_error(&replica->filters, count, replica->options.mse * weight, err));
    return filter_step_backward(&replica->filters, samples, count, touched, err);
}

hada_status hada_replica_backward(hada_replica *replica, const hada_sample *samples, int count, double weight,
                                  uint64_t step, int discriminator_only, hada_terms *terms, unsigned char *touched,
                                  hada_error *err)
{
    hada_slot *slot = replica->images.slot;
    hada_buffer *buffer = &replica->images.place[HADA_STEP_TERMS];
    const hada_losses_call call = {samples, count, weight, step, discriminator_only};
    float values[HADA_TERM_COUNT] = {0.0f};
    HADA_TRY(hada_buffer_clear(buffer, slot, 0, sizeof values, err));
    HADA_TRY(replica->shape.net ? filled_step(replica, call, err)
                                : filters_alone(replica, samples, count, weight, touched, err));
    HADA_TRY(hada_buffer_read(buffer, slot, 0, values, sizeof values, err));
    *terms = (hada_terms){.mse = values[HADA_TERM_MSE],
                          .perceptual = values[HADA_TERM_PERCEPTUAL],
                          .adversarial = values[HADA_TERM_ADVERSARIAL],
                          .variation = values[HADA_TERM_VARIATION],
                          .discriminator = (double)values[HADA_TERM_REAL] + values[HADA_TERM_FAKE]};
    return HADA_OK;
}

static int is_black(const hada_image *image)
{
    for (size_t i = 0; i < hada_image_count(image); i++)
        if (image->data[i] != 0.0f)
            return 0;
    return 1;
}

/* The plane that the net takes, on the device and in `out`. */
static hada_status make_plane(hada_replica *replica, const hada_sample *sample, hada_image *out, hada_error *err)
{
    hada_step_images *images = &replica->images;
    const size_t bytes = replica->shape.plane * sizeof(float);
    if (!replica->shape.filters) {
        memcpy(out->data, sample->input->data, bytes);
        return hada_step_upload(images, HADA_STEP_PLANES, sample->input, 0, err);
    }
    HADA_TRY(filter_step_forward(&replica->filters, sample, 1, 1, err));
    return hada_buffer_read(&images->place[HADA_STEP_PLANES], images->slot, 0, out->data, bytes, err);
}

hada_status hada_replica_forward(hada_replica *replica, const hada_sample *sample, hada_image *before,
                                 hada_image *after, hada_error *err)
{
    hada_step_images *images = &replica->images;
    const hada_replica_shape *shape = &replica->shape;
    const size_t bytes = shape->plane * sizeof(float);
    HADA_TRY(hada_image_ensure(after, shape->channels, shape->rows, shape->cols, err));
    if (before)
        HADA_TRY(hada_image_ensure(before, shape->channels, shape->rows, shape->cols, err));
    HADA_TRY(make_plane(replica, sample, after, err));
    if (before)
        memcpy(before->data, after->data, bytes);
    /* a plane without content stays so, as in reconstruction */
    if (!shape->net || is_black(after))
        return HADA_OK;
    HADA_TRY(hada_generator_infer(&replica->generator, err));
    return hada_buffer_read(&images->place[HADA_STEP_PLAIN], images->slot, 0, after->data, bytes, err);
}
