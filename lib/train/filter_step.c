#include "train/step.h"

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

hada_status hada_filter_step_create(hada_filter_step *step, hada_step_images *images, hada_parameters *parameters,
                                    hada_error *err)
{
    const hada_replica_shape *shape = images->shape;
    *step = (hada_filter_step){.images = images, .parameters = parameters};
    HADA_TRY(hada_fft_create(&step->forward, images->slot, &shape->forward, err));
    HADA_TRY(hada_fft_create(&step->inverse, images->slot, &shape->inverse, err));
    HADA_TRY(hada_fft_create(&step->back, images->slot, &shape->back, err));
    return write_columns(images, err);
}

void hada_filter_step_destroy(hada_filter_step *step)
{
    hada_fft_destroy(&step->forward);
    hada_fft_destroy(&step->inverse);
    hada_fft_destroy(&step->back);
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

hada_status hada_filter_step_forward(hada_filter_step *step, const hada_sample *samples, int count, int clipped,
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

hada_status hada_filter_step_backward(hada_filter_step *step, const hada_sample *samples, int count,
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

hada_status hada_filter_step_error(hada_filter_step *step, int count, double weight, hada_error *err)
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
    return hada_sum_floats(images->slot, sums, 0, items, (float)share, 0.0f, value, err);
}
