#include "filter/upload.h"

#include <string.h>

#include "launch/filter_unpack.h"

enum { GROUP = 128, NUMBERS = 8 /* of a work-item */ };

hada_status hada_upload_make(hada_upload *upload, hada_slot *slot, size_t values, hada_error *err)
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

hada_status hada_upload_frame(hada_upload *upload, const hada_pixels *frame, hada_buffer *raw, hada_buffer *between,
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
