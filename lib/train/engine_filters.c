/* The filters of an engine: frames to planes, and gradients of planes to those of filters. */
#include <stdlib.h>

#include "core/alloc.h"
#include "core/random.h"
#include "filter/clip.h"
#include "filter/layout.h"
#include "io/safetensors.h"
#include "launch/train.h"
#include "net/layer_launch.h"
#include "runtime/kernel.h"
#include "train/engine_parts.h"

/* Of the real and imaginary parts of a random start. */
#define START_DEVIATION 0.05

/* A filter of normal numbers, row-major. The columns that stand for themselves hold both signs of a frequency: there
 * the filter of a real kernel is conj-symmetric (complex), and both its parts are even (split). */
static void random_filter(const hada_spectrum_layout *layout, int split, hada_random *random, float *filter)
{
    const int cols = layout->cols / 2 + 1;
    for (size_t i = 0; i < 2 * (size_t)layout->rows * (size_t)cols; i++)
        filter[i] = (float)(START_DEVIATION * hada_random_normal(random));
    for (int kx = 0; kx < cols; kx++) {
        if (kx && 2 * kx != layout->cols)
            continue;
        for (int ky = 0; ky < layout->rows; ky++) {
            const int other = ky ? layout->rows - ky : 0;
            const size_t to = 2 * ((size_t)ky * (size_t)cols + (size_t)kx);
            const size_t from = 2 * ((size_t)other * (size_t)cols + (size_t)kx);
            if (other > ky)
                continue;
            filter[to] = filter[from];
            filter[to + 1] = split ? filter[from + 1] : other == ky ? 0.0f : -filter[from + 1];
        }
    }
}

static void take_filter(const hada_model *model, size_t first, size_t count, float *filter)
{
    for (size_t i = 0; i < count; i++)
        filter[i] = model->filter ? model->filter[first + i] : hada_float_from_half(model->filter_half[first + i]);
}

hada_status hada_engine_first_filters(const hada_engine *engine, const hada_engine_desc *desc, int depth, float *values,
                                      hada_error *err)
{
    const hada_spectrum_layout *layout = &engine->shape.layout;
    const size_t channels = (size_t)engine->shape.channels, plane = hada_model_plane(desc->model);
    const int drawn = engine->shape.stage == HADA_STAGE_FILTERS && engine->options.random_start;
    float *filter;
    hada_random random;
    hada_status status = hada_alloc((void **)&filter, 2 * plane, sizeof *filter, "a filter", err);
    hada_random_seed(&random, engine->options.seed, (uint64_t)depth);
    for (size_t c = 0; !status && c < channels; c++) {
        const size_t first = ((size_t)depth * channels + c) * 2 * plane;
        if (drawn)
            random_filter(layout, engine->shape.form == HADA_FORM_SPLIT, &random, filter);
        else
            take_filter(desc->model, first, 2 * plane, filter);
        hada_layout_pack(layout, filter, values + 2 * c * layout->count);
    }
    free(filter);
    return status;
}

hada_status hada_engine_refocus(hada_engine *engine, const hada_sample *samples, int count, int clipped,
                                hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    const hada_buffer *spectra = &engine->buffers[ENGINE_SPECTRA];
    const size_t values = (size_t)shape->channels * shape->layout.count;
    const hada_fft_filter filter = {.product = shape->form == HADA_FORM_SPLIT ? HADA_FFT_SPLIT : HADA_FFT_COMPLEX,
                                    .spectrum_count = shape->channels};
    hada_status status = HADA_OK;
    hada_slot_stage(engine->slot, "upload");
    for (int i = 0; !status && i < count; i++)
        status = hada_buffer_write(&engine->buffers[ENGINE_RAW], engine->slot, (size_t)i * shape->frame * sizeof(float),
                                   samples[i].input->data, shape->frame * sizeof(float), err);
    hada_slot_stage(engine->slot, "filters");
    if (!status)
        status = hada_fft_forward(engine->forward, count * shape->channels, engine->buffers[ENGINE_RAW].mem, 0,
                                  spectra->mem, 0, err);
    for (int i = 0; !status && i < count; i++) {
        hada_fft_filter here = filter;
        here.filter = engine->groups[HADA_GROUP_FILTERS + samples[i].depth].values.mem;
        status = hada_fft_inverse(engine->inverse, shape->channels, spectra->mem, (size_t)i * values,
                                  engine->buffers[ENGINE_PLANES].mem, (size_t)i * shape->plane, &here, err);
    }
    if (status || !clipped)
        return status;
    return hada_image_clip(engine->slot, engine->buffers[ENGINE_PLANES].mem, (size_t)count * shape->plane, err);
}

/* Adds the gradient of one plane, whose spectrum stands in ENGINE_FLOW. */
static hada_status add_gradient(hada_engine *engine, int image, int depth, hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    const cl_int split = shape->form == HADA_FORM_SPLIT;
    const cl_ulong count = shape->layout.count, offset = (cl_ulong)image * (cl_ulong)shape->channels * count;
    const cl_float scale = (cl_float)(1.0 / ((double)shape->layout.rows * shape->layout.cols));
    const size_t local[2] = {64, 1}, global[2] = {((size_t)count + 511) / 512 * 64, (size_t)shape->channels};
    const hada_arg args[] = {HADA_ARG(engine->buffers[ENGINE_SPECTRA].mem),
                             HADA_ARG(offset),
                             HADA_ARG(engine->buffers[ENGINE_FLOW].mem),
                             HADA_ARG(engine->buffers[ENGINE_COLUMNS].mem),
                             HADA_ARG(engine->groups[HADA_GROUP_FILTERS + depth].gradient.mem),
                             HADA_ARG(count),
                             HADA_ARG(scale),
                             HADA_ARG(split)};
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(engine->slot, "train", "train_filter", "", &kernel, err);
    hada_slot_cost(engine->slot, 32.0 * (double)count * shape->channels, 10.0 * (double)count * shape->channels);
    return status
               ? status
               : hada_slot_launch(engine->slot, kernel, "train_filter", 2, global, local, args, HADA_COUNT(args), err);
}

hada_status hada_engine_filter_gradients(hada_engine *engine, const hada_sample *samples, int count, cl_mem mem,
                                         unsigned char *touched, hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    hada_status status = HADA_OK;
    hada_slot_stage(engine->slot, "filters");
    for (int i = 0; !status && i < count; i++) {
        status = hada_fft_forward(engine->back, shape->channels, mem, (size_t)i * shape->plane,
                                  engine->buffers[ENGINE_FLOW].mem, 0, err);
        if (!status)
            status = hada_engine_settle(engine, HADA_GROUP_FILTERS + samples[i].depth, err);
        if (!status)
            status = add_gradient(engine, i, samples[i].depth, err);
        if (touched)
            touched[samples[i].depth] = 1;
    }
    return status;
}

hada_status hada_engine_plane_error(hada_engine *engine, int count, double weight, hada_error *err)
{
    const size_t values = (size_t)count * engine->shape.plane, items = (values + ENGINE_RUN - 1) / ENGINE_RUN;
    const double share = engine->options.mse * weight / (double)engine->shape.plane;
    const hada_range range = hada_layer_flat_range(engine->slot, items, 1);
    const cl_mem sums = engine->buffers[ENGINE_SUMS].mem;
    const hada_floats value = {engine->buffers[ENGINE_TERMS].mem, ENGINE_MSE};
    hada_slot_stage(engine->slot, "losses");
    hada_slot_cost(engine->slot, 12.0 * (double)values, 4.0 * (double)values);
    hada_status status = hada_launch_train_error(
        engine->slot, HADA_PROGRAM_TRAIN_DEFAULT, &range, err, .x = engine->buffers[ENGINE_PLANES].mem,
        .target = engine->buffers[ENGINE_SCENES].mem, .count = values, .scale = (cl_float)(2.0 * share), .sums = sums);
    return status ? status : hada_sum_floats(engine->slot, sums, 0, items, (float)share, 0.0f, value, err);
}

hada_status hada_engine_mask(hada_engine *engine, hada_error *err)
{
    const size_t values = (size_t)engine->shape.at_once * engine->shape.plane;
    const hada_range range = hada_layer_flat_range(engine->slot, hada_divide_up(values, ENGINE_RUN), 1);
    hada_slot_cost(engine->slot, 12.0 * (double)values, (double)values);
    return hada_launch_train_mask(engine->slot, HADA_PROGRAM_TRAIN_DEFAULT, &range, err,
                                  .plane = engine->buffers[ENGINE_PLANES].mem,
                                  .gradient = engine->buffers[ENGINE_FLAT].mem, .count = values);
}
