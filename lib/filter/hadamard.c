#include "filter/hadamard.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "program/kernel.h"

enum { GROUP = 64 };

static hada_fft_desc forward_desc(const hada_model_info *info, const hada_geometry *geometry)
{
    return (hada_fft_desc){.direction = HADA_FFT_FORWARD,
                           .rows = info->grid_rows,
                           .cols = info->grid_cols,
                           .batch = info->channels,
                           .row0 = geometry->raw_row,
                           .col0 = geometry->raw_col,
                           .real_rows = info->raw_rows,
                           .real_cols = info->raw_cols,
                           .real_pitch = (size_t)info->raw_cols,
                           .real_distance = (size_t)info->raw_rows * (size_t)info->raw_cols};
}

static hada_fft_desc inverse_desc(const hada_model_info *info, const hada_geometry *geometry, int batch)
{
    return (hada_fft_desc){.direction = HADA_FFT_INVERSE,
                           .rows = info->grid_rows,
                           .cols = info->grid_cols,
                           .batch = batch * info->channels,
                           .row0 = geometry->window_row,
                           .col0 = geometry->window_col,
                           .real_rows = info->window_rows,
                           .real_cols = info->window_cols,
                           .real_pitch = (size_t)info->window_cols,
                           .real_distance = (size_t)info->window_rows * (size_t)info->window_cols};
}

hada_spectrum_layout hada_hadamard_layout(const hada_context *context, const hada_model_info *info)
{
    return hada_fft_layout(context, info->grid_rows, info->grid_cols, HADA_FFT_AUTO);
}

uint64_t hada_hadamard_bytes(const hada_context *context, const hada_model_info *info, int batch)
{
    hada_geometry geometry;
    if (hada_geometry_of(info, &geometry, NULL))
        return 0;
    const hada_fft_desc forward = forward_desc(info, &geometry), inverse = inverse_desc(info, &geometry, batch);
    const hada_spectrum_layout layout = hada_hadamard_layout(context, info);
    const uint64_t frame = (uint64_t)info->raw_rows * (uint64_t)info->raw_cols * 4u;
    return (uint64_t)info->channels * (frame + (uint64_t)layout.count * 8u) + hada_fft_bytes(context, &forward) +
           hada_fft_bytes(context, &inverse);
}

hada_status hada_hadamard_create(hada_hadamard **out, hada_slot *slot, const hada_model_info *info, int batch,
                                 hada_error *err)
{
    hada_hadamard *stage;
    *out = NULL;
    if (batch < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a batch of %d depths is not possible", batch);
    hada_status status = hada_alloc((void **)&stage, 1, sizeof *stage, "a Hadamard stage", err);
    if (status)
        return status;
    stage->slot = slot;
    stage->channels = info->channels;
    stage->raw_rows = info->raw_rows;
    stage->raw_cols = info->raw_cols;
    stage->window_rows = info->window_rows;
    stage->window_cols = info->window_cols;
    stage->batch = batch;
    status = hada_geometry_of(info, &stage->geometry, err);
    const hada_fft_desc forward = forward_desc(info, &stage->geometry);
    const hada_fft_desc inverse = inverse_desc(info, &stage->geometry, batch);
    if (!status)
        status = hada_fft_create(&stage->forward, slot, &forward, err);
    if (!status)
        status = hada_fft_create(&stage->inverse, slot, &inverse, err);
    if (!status) {
        stage->layout = *hada_fft_plan_layout(stage->forward);
        status = hada_buffer_create(&stage->raw, slot->context, (size_t)info->channels * forward.real_distance * 4,
                                    "the raw frame", err);
    }
    if (!status)
        status = hada_buffer_create(&stage->spectrum, slot->context, (size_t)info->channels * stage->layout.count * 8,
                                    "the frame's spectrum", err);
    if (status)
        hada_hadamard_destroy(&stage);
    *out = stage;
    return status;
}

void hada_hadamard_destroy(hada_hadamard **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_hadamard *stage = *pointer;
    *pointer = NULL;
    hada_slot_finish(stage->slot, NULL);
    hada_fft_destroy(&stage->forward);
    hada_fft_destroy(&stage->inverse);
    hada_buffer_destroy(&stage->raw);
    hada_buffer_destroy(&stage->dark);
    hada_buffer_destroy(&stage->spectrum);
    free(stage);
}

hada_status hada_hadamard_set_dark(hada_hadamard *stage, const float *dark, hada_error *err)
{
    hada_status status = HADA_OK;
    stage->has_dark = 0;
    if (!dark)
        return HADA_OK;
    if (!stage->dark.mem)
        status = hada_buffer_create(&stage->dark, stage->slot->context, stage->raw.bytes, "the dark frame", err);
    if (!status)
        status = hada_buffer_write(&stage->dark, stage->slot, 0, dark, stage->raw.bytes, err);
    stage->has_dark = !status;
    return status;
}

static hada_status subtract(hada_hadamard *stage, int channel, double level, hada_error *err)
{
    cl_kernel kernel;
    const cl_ulong count = (cl_ulong)stage->raw_rows * (cl_ulong)stage->raw_cols, offset = (cl_ulong)channel * count;
    const cl_float taken = (cl_float)level;
    const cl_int framed = stage->has_dark;
    const size_t local = GROUP, global = ((size_t)count + 8 * GROUP - 1) / (8 * GROUP) * GROUP;
    cl_mem dark = framed ? stage->dark.mem : stage->raw.mem; /* not read without a dark frame */
    hada_status status = hada_slot_kernel(stage->slot, "filter_dark", "filter_dark", "", &kernel, err);
    hada_arg args[] = {HADA_ARG(stage->raw.mem), HADA_ARG(dark),  HADA_ARG(offset),
                       HADA_ARG(framed),         HADA_ARG(taken), HADA_ARG(count)};
    hada_slot_cost(stage->slot, (framed ? 12.0 : 8.0) * (double)count, (double)count);
    if (!status)
        status = hada_slot_launch(stage->slot, kernel, "filter_dark", 1, &global, &local, args, HADA_COUNT(args), err);
    return status;
}

hada_status hada_hadamard_frame(hada_hadamard *stage, const float *raw, const double *levels, hada_error *err)
{
    hada_status status = hada_buffer_write(&stage->raw, stage->slot, 0, raw, stage->raw.bytes, err);
    for (int c = 0; !status && c < stage->channels; c++)
        if (stage->has_dark || (levels && levels[c] != 0.0))
            status = subtract(stage, c, levels ? levels[c] : 0.0, err);
    if (!status)
        status = hada_fft_forward(stage->forward, stage->channels, stage->raw.mem, 0, stage->spectrum.mem, 0, err);
    return status;
}

hada_status hada_hadamard_run(hada_hadamard *stage, const hada_bank *bank, int first, int count, cl_mem planes,
                              size_t offset, hada_error *err)
{
    const size_t window = (size_t)stage->window_rows * (size_t)stage->window_cols;
    if (first < 0 || count < 0 || count > bank->depths - first || bank->channels != stage->channels)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "depths %d to %d of a bank of %d were asked for", first,
                         first + count - 1, bank->depths);
    hada_status status = HADA_OK;
    for (int done = 0; !status && done < count;) {
        size_t first_image;
        int here;
        cl_mem mem = hada_bank_filter(bank, first + done, &first_image, &here);
        if (here > stage->batch)
            here = stage->batch;
        if (here > count - done)
            here = count - done;
        const hada_fft_filter filter = {.product = bank->product,
                                        .filter = mem,
                                        .half = bank->half,
                                        .spectrum_count = stage->channels,
                                        .filter_first = (int)first_image};
        status = hada_fft_inverse(stage->inverse, here * stage->channels, stage->spectrum.mem, 0, planes,
                                  offset + (size_t)done * (size_t)stage->channels * window, &filter, err);
        done += here;
    }
    return status;
}
