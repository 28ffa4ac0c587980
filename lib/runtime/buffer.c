#include "runtime/buffer.h"

#include "runtime/launch.h"

#include <sys/mman.h>

#define HUGE_PAGE ((size_t)2 << 20)

static hada_status too_large(const hada_context *context, size_t bytes, const char *what, hada_error *err)
{
    return hada_fail(
        err, HADA_ERROR_DEVICE_MEMORY,
        "%s: %.2f GiB are needed in one piece; %s takes at most %.2f GiB: use fewer depths at once, half filters, "
        "or another device",
        what, (double)bytes / 1073741824.0, context->info.name,
        (double)context->info.max_allocation_bytes / 1073741824.0);
}

/* The driver calls it when the last command that uses the buffer is done, also after a failure in between. */
static void CL_CALLBACK free_pages(cl_mem mem, void *pages)
{
    (void)mem;
    free(pages);
}

static hada_status allocate(cl_mem *mem, const hada_context *context, size_t bytes, const char *what, hada_error *err)
{
    cl_int code;
    cl_mem_flags flags = CL_MEM_READ_WRITE;
    void *pages = NULL;
    /* small buffers gain nothing from huge pages and would waste most of one */
    if (context->quirks.host_pages && bytes >= HUGE_PAGE) {
        size_t whole = hada_round_up(bytes, HUGE_PAGE);
        pages = aligned_alloc(HUGE_PAGE, whole);
        if (!pages)
            return hada_fail(err, HADA_ERROR_MEMORY, "no memory for %s (%.1f MiB)", what, (double)bytes / 1048576.0);
        madvise(pages, whole, MADV_HUGEPAGE); /* a hint: without huge pages it is only slower */
        flags |= CL_MEM_USE_HOST_PTR;
    }
    *mem = clCreateBuffer(context->cl, flags, bytes, pages, &code);
    const char *call = "clCreateBuffer";
    if (code == CL_SUCCESS && pages && (code = clSetMemObjectDestructorCallback(*mem, free_pages, pages))) {
        call = "clSetMemObjectDestructorCallback";
        clReleaseMemObject(*mem);
    }
    if (code == CL_SUCCESS)
        return HADA_OK;
    free(pages);
    const hada_status status = hada_fail_cl(err, code, call);
    hada_error_prefix(err, "%s (%.1f MiB): ", what, (double)bytes / 1048576.0);
    return status;
}

hada_status hada_buffer_create(hada_buffer *buffer, hada_context *context, size_t bytes, const char *what,
                               hada_error *err)
{
    cl_mem mem = NULL;
    *buffer = (hada_buffer){0};
    if (!bytes)
        bytes = 4;
    if (bytes > context->info.max_allocation_bytes)
        return too_large(context, bytes, what, err);
    if (!context->dry)
        HADA_TRY(allocate(&mem, context, bytes, what, err));
    *buffer = (hada_buffer){.context = context, .mem = mem, .bytes = bytes};
    pthread_mutex_lock(&context->lock);
    context->bytes += bytes;
    if (context->bytes > context->peak_bytes)
        context->peak_bytes = context->bytes;
    pthread_mutex_unlock(&context->lock);
    return HADA_OK;
}

hada_status hada_buffer_create_from(hada_buffer *buffer, hada_slot *slot, const void *data, size_t bytes,
                                    const char *what, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_buffer_create(buffer, slot->context, bytes, what, err));
    if (bytes)
        HADA_TRY_OR_DONE(hada_buffer_write(buffer, slot, 0, data, bytes, err));
done:
    if (status)
        hada_buffer_destroy(buffer);
    return status;
}

static hada_status check_range(const hada_buffer *buffer, size_t offset, size_t bytes, hada_error *err)
{
    if (offset > buffer->bytes || bytes > buffer->bytes - offset)
        return hada_fail(err, HADA_ERROR_SIZE, "a transfer of %zu bytes at %zu leaves a buffer of %zu bytes", bytes,
                         offset, buffer->bytes);
    return HADA_OK;
}

static int is_dry(const hada_slot *slot)
{
    return slot->context->dry != NULL;
}

hada_status hada_buffer_part(hada_buffer *part, const hada_buffer *whole, size_t offset, size_t bytes, const char *what,
                             hada_error *err)
{
    const cl_buffer_region region = {offset, bytes};
    cl_int code;
    *part = (hada_buffer){0};
    HADA_TRY(check_range(whole, offset, bytes, err));
    cl_mem mem = clCreateSubBuffer(whole->mem, CL_MEM_READ_WRITE, CL_BUFFER_CREATE_TYPE_REGION, &region, &code);
    if (code != CL_SUCCESS) {
        hada_status status = hada_fail_cl(err, code, "clCreateSubBuffer");
        hada_error_prefix(err, "%s (%.1f MiB): ", what, (double)bytes / 1048576.0);
        return status;
    }
    *part = (hada_buffer){.context = whole->context, .mem = mem, .bytes = bytes, .part = 1};
    return HADA_OK;
}

void hada_buffer_destroy(hada_buffer *buffer)
{
    if (!buffer || !buffer->context)
        return;
    if (buffer->mem) {
        hada_arguments_forget(buffer->context, buffer->mem);
        clReleaseMemObject(buffer->mem);
    }
    pthread_mutex_lock(&buffer->context->lock);
    buffer->context->bytes -= buffer->part ? 0 : buffer->bytes;
    pthread_mutex_unlock(&buffer->context->lock);
    *buffer = (hada_buffer){0};
}

void hada_buffers_destroy(hada_buffer *const *buffers, size_t count)
{
    for (size_t i = 0; i < count; i++)
        hada_buffer_destroy(buffers[i]);
}

/* What became of a transfer that was enqueued. */
static hada_status moved(hada_slot *slot, cl_int code, const char *call, const char *name, double bytes,
                         hada_error *err)
{
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, call);
    hada_slot_moved(slot, name, bytes);
    return HADA_OK;
}

/* Writes `from` or, where that is NULL, reads `into`. */
static hada_status enqueue(const hada_buffer *buffer, hada_slot *slot, cl_bool blocking, size_t offset, void *into,
                           const void *from, size_t bytes, hada_error *err)
{
    const cl_command_queue queue = slot->queue;
    if (is_dry(slot) || !bytes)
        return HADA_OK;
    HADA_TRY(check_range(buffer, offset, bytes, err));
    cl_event *event = hada_slot_event(slot);
    const cl_int code = from ? clEnqueueWriteBuffer(queue, buffer->mem, blocking, offset, bytes, from, 0, NULL, event)
                             : clEnqueueReadBuffer(queue, buffer->mem, blocking, offset, bytes, into, 0, NULL, event);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, from ? "clEnqueueWriteBuffer" : "clEnqueueReadBuffer");
    if (blocking)
        hada_slot_waited(slot);
    hada_slot_moved(slot, from ? "write" : "read", (double)bytes);
    return HADA_OK;
}

hada_status hada_buffer_write(hada_buffer *buffer, hada_slot *slot, size_t offset, const void *data, size_t bytes,
                              hada_error *err)
{
    return enqueue(buffer, slot, CL_TRUE, offset, NULL, data, bytes, err);
}

hada_status hada_buffer_write_later(hada_buffer *buffer, hada_slot *slot, size_t offset, const void *data, size_t bytes,
                                    hada_error *err)
{
    return enqueue(buffer, slot, CL_FALSE, offset, NULL, data, bytes, err);
}

hada_status hada_buffer_read(const hada_buffer *buffer, hada_slot *slot, size_t offset, void *data, size_t bytes,
                             hada_error *err)
{
    return enqueue(buffer, slot, CL_TRUE, offset, data, NULL, bytes, err);
}

hada_status hada_buffer_read_later(const hada_buffer *buffer, hada_slot *slot, size_t offset, void *data, size_t bytes,
                                   hada_error *err)
{
    return enqueue(buffer, slot, CL_FALSE, offset, data, NULL, bytes, err);
}

hada_status hada_buffer_read_event(const hada_buffer *buffer, hada_slot *slot, size_t offset, void *data, size_t bytes,
                                   cl_event *event, hada_error *err)
{
    HADA_TRY(check_range(buffer, offset, bytes, err));
    cl_int code = clEnqueueReadBuffer(slot->queue, buffer->mem, CL_FALSE, offset, bytes, data, 0, NULL, event);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueReadBuffer");
    code = clFlush(slot->queue);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clFlush");
}

hada_status hada_buffer_map(const hada_buffer *buffer, hada_slot *slot, void **data, hada_error *err)
{
    cl_int code;
    *data = clEnqueueMapBuffer(slot->queue, buffer->mem, CL_TRUE, CL_MAP_READ | CL_MAP_WRITE, 0, buffer->bytes, 0, NULL,
                               hada_slot_event(slot), &code);
    if (code != CL_SUCCESS) {
        *data = NULL;
        return hada_fail_cl(err, code, "clEnqueueMapBuffer");
    }
    hada_slot_waited(slot);
    hada_slot_moved(slot, "map", (double)buffer->bytes);
    return HADA_OK;
}

hada_status hada_buffer_unmap(const hada_buffer *buffer, hada_slot *slot, void *data, hada_error *err)
{
    const cl_int code = clEnqueueUnmapMemObject(slot->queue, buffer->mem, data, 0, NULL, hada_slot_event(slot));
    return moved(slot, code, "clEnqueueUnmapMemObject", "unmap", (double)buffer->bytes, err);
}

hada_status hada_buffer_clear(hada_buffer *buffer, hada_slot *slot, size_t offset, size_t bytes, hada_error *err)
{
    const cl_uchar zero = 0;
    const cl_uint zero4 = 0;
    if (is_dry(slot) || !bytes)
        return HADA_OK;
    HADA_TRY(check_range(buffer, offset, bytes, err));
    const int words = offset % 4 == 0 && bytes % 4 == 0;
    cl_int code = clEnqueueFillBuffer(slot->queue, buffer->mem, words ? (const void *)&zero4 : &zero, words ? 4 : 1,
                                      offset, bytes, 0, NULL, hada_slot_event(slot));
    return moved(slot, code, "clEnqueueFillBuffer", "fill", (double)bytes, err);
}

hada_status hada_buffer_copy(hada_slot *slot, cl_mem from, size_t from_offset, cl_mem to, size_t to_offset,
                             size_t bytes, hada_error *err)
{
    if (is_dry(slot))
        return HADA_OK;
    const cl_int code =
        clEnqueueCopyBuffer(slot->queue, from, to, from_offset, to_offset, bytes, 0, NULL, hada_slot_event(slot));
    return moved(slot, code, "clEnqueueCopyBuffer", "copy", 2.0 * (double)bytes, err);
}

hada_status hada_buffer_fill(hada_slot *slot, cl_mem mem, size_t offset, float value, size_t count, hada_error *err)
{
    if (is_dry(slot))
        return HADA_OK;
    const cl_int code = clEnqueueFillBuffer(slot->queue, mem, &value, sizeof value, offset, count * sizeof value, 0,
                                            NULL, hada_slot_event(slot));
    return moved(slot, code, "clEnqueueFillBuffer", "fill", (double)(count * sizeof value), err);
}
