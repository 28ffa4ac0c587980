#include "filter/upload.h"

#include "launch/filter_unpack.h"

enum { GROUP = 128, NUMBERS = 8 /* of a work-item */ };

hada_status hada_upload_make(hada_upload *upload, hada_slot *slot, size_t values, hada_error *err)
{
    cl_int code;
    *upload = (hada_upload){.slot = slot, .values = values};
    if (slot->context->info.unified_memory)
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

hada_status hada_upload_unpack(const hada_upload *upload, hada_bytes between, cl_mem raw, hada_error *err)
{
    const hada_stored *stored = &upload->stored;
    const double values = (double)upload->values;
    const hada_range range = hada_range_of(hada_divide_up(upload->values, NUMBERS), GROUP, 1, 1);
    hada_slot_cost(upload->slot, (4.0 + stored->bytes) * values, 5.0 * values);
    return hada_launch_filter_unpack(upload->slot, HADA_PROGRAM_FILTER_UNPACK_DEFAULT, &range, err, .stored = between,
                                     .bytes = stored->bytes, .scale = stored->scale, .inverse = 1.0f / stored->scale,
                                     .raw = raw, .count = upload->values);
}

hada_status hada_upload_frame(hada_upload *upload, const float *frame, hada_buffer *raw, hada_buffer *between,
                              hada_error *err)
{
    if (upload->waits && upload->waits == upload->slot->calls.waits + 1)
        HADA_TRY(hada_slot_finish(upload->slot, err));
    hada_stored_pack(frame, upload->values, upload->staged, &upload->stored);
    const int whole = upload->stored.bytes == (int)sizeof(float);
    HADA_TRY(hada_buffer_write_later(whole ? raw : between, upload->slot, 0, upload->staged,
                                     upload->values * (size_t)upload->stored.bytes, err));
    upload->waits = upload->slot->calls.waits + 1;
    if (!whole)
        HADA_TRY(hada_upload_unpack(upload, between->octets, raw->mem, err));
    return HADA_OK;
}
