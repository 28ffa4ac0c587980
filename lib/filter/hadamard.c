#include "filter/hadamard.h"

#include <stdlib.h>
#include <string.h>

#include "launch/fft_plain.h"
#include "launch/filter_clip.h"
#include "launch/filter_dark.h"
#include "launch/filter_unpack.h"

hada_range hada_values_range(const hada_slot *slot, size_t offset, size_t count)
{
    enum { WIDTH_LANES = 8, LOCAL_LANES = 64, WIDTH_GROUPS = 4, LOCAL_GROUPS = 128 };
    if (slot->context->shape != HADA_SHAPE_GROUPS)
        return hada_range_of(hada_divide_up(count, WIDTH_LANES), LOCAL_LANES, 1, 1);
    return hada_range_of(hada_divide_up(offset % WIDTH_GROUPS + count, WIDTH_GROUPS), LOCAL_GROUPS, 1, 1);
}

hada_status hada_image_clip(hada_slot *slot, cl_mem planes, size_t count, hada_error *err)
{
    const hada_range range = hada_values_range(slot, 0, count);
    hada_slot_cost(slot, 8.0 * (double)count, (double)count);
    return hada_launch_filter_clip(slot, hada_program_filter_clip_of(slot), &range, err, .values = planes, .offset = 0,
                                   .count = count);
}

hada_status hada_image_blend(hada_slot *slot, cl_mem planes, size_t offset, cl_mem others, size_t count, double share,
                             hada_error *err)
{
    const hada_range range = hada_values_range(slot, offset, count);
    hada_slot_cost(slot, 12.0 * (double)count, 5.0 * (double)count);
    return hada_launch_filter_blend(slot, hada_program_filter_clip_of(slot), &range, err, .values = planes,
                                    .offset = offset, .others = others, .count = count, .share = (cl_float)share);
}

enum { GROUP = 128, NUMBERS = 8 /* of a work-item */ };

/* For frames of `values` values. Pinned memory is made where the device has memory of its own. */
static hada_status upload_make(hada_upload *upload, hada_slot *slot, size_t values, hada_error *err)
{
    cl_int code;
    *upload = (hada_upload){.slot = slot};
    if (slot->context->info.unified_memory || slot->context->dry)
        return HADA_OK;
    const size_t bytes = values * sizeof(float); /* of a frame that takes all of them */
    upload->pinned = clCreateBuffer(slot->context->cl, CL_MEM_READ_WRITE | CL_MEM_ALLOC_HOST_PTR, bytes, NULL, &code);
    if (code == CL_SUCCESS)
        upload->staged = clEnqueueMapBuffer(slot->queue, upload->pinned, CL_TRUE, CL_MAP_READ | CL_MAP_WRITE, 0, bytes,
                                            0, NULL, NULL, &code);
    if (code == CL_SUCCESS)
        return hada_prepare_filter_unpack(slot, HADA_PROGRAM_FILTER_UNPACK_DEFAULT, err);
    upload->staged = NULL;
    return hada_fail_cl(err, code, "memory from which frames go to the device");
}

void hada_upload_free(hada_upload *upload)
{
    if (upload->staged &&
        clEnqueueUnmapMemObject(upload->slot->queue, upload->pinned, upload->staged, 0, NULL, NULL) == CL_SUCCESS)
        hada_slot_finish(upload->slot, NULL);
    if (upload->pinned)
        clReleaseMemObject(upload->pinned);
    *upload = (hada_upload){0};
}

hada_status hada_upload_unpack(hada_slot *slot, const hada_stored *stored, hada_bytes between, cl_mem raw,
                               hada_error *err)
{
    const hada_stored_form *form = &stored->form;
    const size_t rows = (size_t)form->rows, cols = (size_t)form->cols, channels = (size_t)form->channels,
                 count = channels * rows * cols;
    hada_slot_cost(slot, 4.0 * (double)count + (double)stored->bytes, 5.0 * (double)count);
    if (!stored->dense || form->bytes == (int)sizeof(float)) {
        const hada_range range = hada_range_of(cols, GROUP, rows, channels);
        return hada_launch_filter_gather(slot, HADA_PROGRAM_FILTER_UNPACK_DEFAULT, &range, err, .stored = between,
                                         .form = *form, .raw = raw);
    }
    const hada_range range = hada_range_of(hada_divide_up(count, NUMBERS), GROUP, 1, 1);
    return hada_launch_filter_unpack(slot, HADA_PROGRAM_FILTER_UNPACK_DEFAULT, &range, err, .stored = between,
                                     .bytes = form->bytes, .scale = form->scale, .inverse = form->inverse, .raw = raw,
                                     .count = count);
}

/* A frame (hada_pixels_uploads()) as planar floats into `raw`, through `between`, a buffer of at least the bytes of the
 * floats that is free until then. Enqueued: the frame must stay until the slot was waited for. Waits first if the
 * previous frame may still be on its way from pinned memory. */
static hada_status upload_frame(hada_upload *upload, const hada_pixels *frame, hada_buffer *raw, hada_buffer *between,
                                hada_error *err)
{
    const hada_stored stored = hada_pixels_stored(frame);
    const int ready = hada_pixels_is_image(frame);
    const void *from = stored.data;
    if (upload->staged) {
        if (upload->waits && upload->waits == upload->slot->calls.waits + 1)
            HADA_TRY(hada_slot_finish(upload->slot, err));
        from = memcpy(upload->staged, stored.data, stored.bytes);
        upload->waits = upload->slot->calls.waits + 1;
    }
    HADA_TRY(hada_buffer_write_later(ready ? raw : between, upload->slot, 0, from, stored.bytes, err));
    return ready ? HADA_OK : hada_upload_unpack(upload->slot, &stored, between->octets, raw->mem, err);
}

enum { CROP_GROUP = 64 };

hada_fft_desc hada_geometry_transform(const hada_model_info *info, const hada_geometry *at,
                                      hada_fft_direction direction, int window, int depths)
{
    const hada_rectangle frame = {at->raw_row, at->raw_col, info->raw_rows, info->raw_cols};
    const hada_rectangle inside = {at->window_row, at->window_col, info->window_rows, info->window_cols};
    return hada_fft_of(direction, info->grid_rows, info->grid_cols, depths * info->channels, window ? inside : frame);
}

hada_spectrum_layout hada_hadamard_layout(const hada_context *context, const hada_model_info *info)
{
    return hada_fft_layout(context, info->grid_rows, info->grid_cols, HADA_FFT_AUTO);
}

hada_status hada_hadamard_create(hada_hadamard **out, hada_slot *slot, const hada_model_info *info, int batch,
                                 hada_error *err)
{
    hada_status status = HADA_OK;
    hada_hadamard *stage;
    *out = NULL;
    if (batch < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a batch of %d depths is not possible", batch);
    HADA_TRY_OR_DONE(HADA_NEW(stage, 1, "a Hadamard stage", err));
    stage->slot = slot;
    stage->channels = info->channels;
    stage->raw_rows = info->raw_rows;
    stage->raw_cols = info->raw_cols;
    stage->window_rows = info->window_rows;
    stage->window_cols = info->window_cols;
    stage->batch = batch;
    HADA_TRY_OR_DONE(hada_geometry_of(info, &stage->geometry, err));
    const hada_fft_desc forward = hada_geometry_transform(info, &stage->geometry, HADA_FFT_FORWARD, 0, 1);
    const hada_fft_desc inverse = hada_geometry_transform(info, &stage->geometry, HADA_FFT_INVERSE, 1, batch);
    HADA_TRY_OR_DONE(hada_fft_create(&stage->forward, slot, &forward, err));
    HADA_TRY_OR_DONE(hada_fft_create(&stage->inverse, slot, &inverse, err));
    stage->layout = *hada_fft_plan_layout(stage->forward);
    HADA_TRY_OR_DONE(hada_buffer_take(&stage->raw, slot, HADA_RESULT,
                                      (size_t)info->channels * forward.real_distance * 4, "the raw frame", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&stage->spectrum, slot->context,
                                        (size_t)info->channels * stage->layout.count * 8, "the frame's spectrum", err));
    HADA_TRY_OR_DONE(upload_make(&stage->upload, slot, (size_t)info->channels * forward.real_distance, err));
done:
    if (status)
        hada_hadamard_destroy(&stage);
    *out = stage;
    return status;
}

void hada_hadamard_destroy(hada_hadamard **pointer)
{
    hada_hadamard *stage = hada_taken(pointer);
    if (!stage)
        return;
    hada_slot_finish(stage->slot, NULL);
    hada_fft_destroy(&stage->forward);
    hada_fft_destroy(&stage->inverse);
    hada_upload_free(&stage->upload);
    HADA_DESTROY_BUFFERS(&stage->raw, &stage->dark, &stage->spectrum, &stage->whole);
    free(stage);
}

hada_status hada_hadamard_unprune(hada_hadamard *stage, hada_error *err)
{
    const hada_fft_desc desc =
        hada_fft_whole(HADA_FFT_INVERSE, stage->layout.rows, stage->layout.cols, stage->batch * stage->channels);
    HADA_TRY(hada_slot_finish(stage->slot, err));
    hada_fft_destroy(&stage->inverse);
    HADA_TRY(hada_fft_create(&stage->inverse, stage->slot, &desc, err));
    return hada_buffer_create(&stage->whole, stage->slot->context,
                              (size_t)desc.batch * desc.real_distance * sizeof(float), "the whole planes", err);
}

hada_status hada_hadamard_set_dark(hada_hadamard *stage, const float *dark, hada_error *err)
{
    stage->has_dark = 0;
    if (!dark)
        return HADA_OK;
    if (!stage->dark.mem)
        HADA_TRY(hada_buffer_create(&stage->dark, stage->slot->context, stage->raw.bytes, "the dark frame", err));
    HADA_TRY(hada_buffer_write(&stage->dark, stage->slot, 0, dark, stage->raw.bytes, err));
    stage->has_dark = 1;
    return HADA_OK;
}

static hada_status subtract(hada_hadamard *stage, int channel, double level, hada_error *err)
{
    const size_t count = (size_t)stage->raw_rows * (size_t)stage->raw_cols;
    const size_t offset = (size_t)channel * count;
    const hada_range range = hada_values_range(stage->slot, offset, count);
    hada_slot_cost(stage->slot, (stage->has_dark ? 12.0 : 8.0) * (double)count, (double)count);
    return hada_launch_filter_dark(stage->slot, hada_program_filter_dark_of(stage->slot), &range, err,
                                   .raw = stage->raw.mem,
                                   /* not read without a dark frame */
                                   .dark = stage->has_dark ? stage->dark.mem : stage->raw.mem, .offset = offset,
                                   .framed = stage->has_dark, .level = (float)level, .count = count);
}

/* Where a channel's spectrum or plane comes from. */
static int source_of(const int *list, int channel)
{
    return list ? list[channel] : channel;
}

static int all_computed(const hada_hadamard *stage, const int *list)
{
    for (int c = 0; c < stage->channels; c++)
        if (source_of(list, c) != c)
            return 0;
    return 1;
}

/* What a channel that is not computed has, in bytes of `mem`: zeros, or what another one has. */
static hada_status give(hada_hadamard *stage, int source, cl_mem mem, size_t from, size_t to, size_t bytes,
                        hada_error *err)
{
    return source == HADA_CHANNEL_BLACK ? hada_buffer_fill(stage->slot, mem, to, 0.0f, bytes / sizeof(float), err)
                                        : hada_buffer_copy(stage->slot, mem, from, mem, to, bytes, err);
}

/* Spectra of the channels, each by itself where some need no transform. */
static hada_status transform(hada_hadamard *stage, hada_error *err)
{
    const int *list = stage->part.spectra;
    const size_t frame = (size_t)stage->raw_rows * (size_t)stage->raw_cols, count = stage->layout.count;
    if (all_computed(stage, list))
        return hada_fft_forward(stage->forward, stage->channels, stage->raw.mem, 0, stage->spectrum.mem, 0, err);
    for (int c = 0; c < stage->channels; c++) {
        const int source = source_of(list, c);
        const size_t to = (size_t)c * count;
        if (source == c)
            HADA_TRY(
                hada_fft_forward(stage->forward, 1, stage->raw.mem, (size_t)c * frame, stage->spectrum.mem, to, err));
        else
            HADA_TRY(give(stage, source, stage->spectrum.mem, (size_t)source * count * 8, to * 8, count * 8, err));
    }
    return HADA_OK;
}

/* The frame in stage->raw, its dark level off, and its spectrum. */
static hada_status take_frame(hada_hadamard *stage, const double *levels, hada_error *err)
{
    for (int c = 0; c < stage->channels; c++)
        if (stage->has_dark || (levels && levels[c] != 0.0))
            HADA_TRY(subtract(stage, c, levels ? levels[c] : 0.0, err));
    return transform(stage, err);
}

hada_status hada_hadamard_frame(hada_hadamard *stage, const hada_pixels *raw, const double *levels, hada_error *err)
{
    /* the spectrum of the previous frame is not needed any more */
    HADA_TRY(upload_frame(&stage->upload, raw, &stage->raw, &stage->spectrum, err));
    return take_frame(stage, levels, err);
}

hada_status hada_hadamard_frame_from(hada_hadamard *stage, cl_mem raw, size_t offset, const double *levels,
                                     hada_error *err)
{
    const hada_status status = hada_buffer_copy(stage->slot, raw, offset, stage->raw.mem, 0, stage->raw.bytes, err);
    return status ? status : take_frame(stage, levels, err);
}

/* Windows of `batch` whole images to the planes, each `distance` floats from the other. */
static hada_status crop(hada_hadamard *stage, int batch, cl_mem planes, size_t offset, size_t distance, hada_error *err)
{
    const hada_fft_real window = {.offset = offset,
                                  .distance = distance,
                                  .pitch = (size_t)stage->window_cols,
                                  .row0 = stage->geometry.window_row,
                                  .col0 = stage->geometry.window_col,
                                  .rows = stage->window_rows,
                                  .cols = stage->window_cols,
                                  .images = batch,
                                  .scale = 1.0f};
    const size_t count = (size_t)batch * (size_t)window.rows * (size_t)window.cols;
    const hada_range range = hada_range_of(count, CROP_GROUP, 1, 1);
    hada_slot_cost(stage->slot, 8.0 * (double)count, 0.0);
    return hada_launch_fft_plain_crop(stage->slot, HADA_PROGRAM_FFT_PLAIN_DEFAULT, &range, err, .in = stage->whole.mem,
                                      .rows = stage->layout.rows, .cols = stage->layout.cols, .out = planes,
                                      .real = window, .count = count);
}

/* Inverse transforms of `batch` members into the planes, by way of the whole grid where that is not pruned. */
static hada_status invert(hada_hadamard *stage, const hada_fft_filter *filter, int batch, size_t spectrum_offset,
                          cl_mem planes, size_t offset, hada_error *err)
{
    const size_t window = (size_t)stage->window_rows * (size_t)stage->window_cols;
    if (!stage->whole.mem)
        return hada_fft_inverse(stage->inverse, batch, stage->spectrum.mem, spectrum_offset, planes, offset, filter,
                                err);
    /* images that stand apart are done one by one */
    const int step = filter->stride, at_once = step == 1 ? batch : 1;
    hada_fft_filter here = *filter;
    for (int i = 0; i < batch; i += at_once) {
        here.filter_first = filter->filter_first + i * step;
        HADA_TRY(hada_fft_inverse(stage->inverse, at_once, stage->spectrum.mem, spectrum_offset, stage->whole.mem, 0,
                                  &here, err));
        HADA_TRY(crop(stage, at_once, planes, offset + (size_t)(i * step) * window, window, err));
    }
    return HADA_OK;
}

/* Planes of a channel that are not computed, of `depths` depths. */
static hada_status give_planes(hada_hadamard *stage, int channel, int source, int depths, cl_mem planes, size_t offset,
                               hada_error *err)
{
    const size_t bytes = (size_t)stage->window_rows * (size_t)stage->window_cols * 4,
                 channels = (size_t)stage->channels;
    for (size_t z = 0; z < (size_t)depths; z++)
        HADA_TRY(give(stage, source, planes, offset * 4 + (z * channels + (size_t)source) * bytes,
                      offset * 4 + (z * channels + (size_t)channel) * bytes, bytes, err));
    return HADA_OK;
}

/* `here` depths with the filters from `first_image` on. */
static hada_status run_batch(hada_hadamard *stage, hada_fft_filter *filter, int first_image, int here, cl_mem planes,
                             size_t offset, hada_error *err)
{
    const size_t window = (size_t)stage->window_rows * (size_t)stage->window_cols;
    const int *list = stage->part.planes;
    hada_status status = HADA_OK;
    filter->filter_first = first_image;
    filter->spectrum_count = stage->channels;
    filter->stride = 1;
    if (all_computed(stage, list))
        return invert(stage, filter, here * stage->channels, 0, planes, offset, err);
    filter->spectrum_count = 1;
    filter->stride = stage->channels;
    for (int c = 0; !status && c < stage->channels; c++) {
        const int source = source_of(list, c);
        filter->filter_first = first_image + c;
        status = source == c ? invert(stage, filter, here, (size_t)c * stage->layout.count, planes,
                                      offset + (size_t)c * window, err)
                             : give_planes(stage, c, source, here, planes, offset, err);
    }
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
        hada_fft_filter filter = {.product = bank->product,
                                  .filter = mem,
                                  .half = bank->half,
                                  .band_rows = stage->part.band_rows,
                                  .band_cols = stage->part.band_cols};
        status = run_batch(stage, &filter, (int)first_image, here, planes,
                           offset + (size_t)done * (size_t)stage->channels * window, err);
        done += here;
    }
    return status;
}
