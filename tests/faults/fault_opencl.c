/* Wrappers of the OpenCL calls. A failing call returns the code that drivers return there when they run short. */
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>

#include "fault.h"

static cl_int fails(const char *name, cl_int code)
{
    return fault_here(FAULT_OPENCL, name) ? code : CL_SUCCESS;
}

/* The code of a device that was lost, or of the call's turn to fail. */
static cl_int kind_fails(fault_kind kind, cl_command_queue queue, const char *name, cl_int failure)
{
    cl_context context = NULL;
    clGetCommandQueueInfo(queue, CL_QUEUE_CONTEXT, sizeof context, &context, NULL);
    const cl_int lost = fault_lost(context);
    return lost ? lost : fault_here(kind, name) ? failure : CL_SUCCESS;
}

static cl_int queue_fails(cl_command_queue queue, const char *name, cl_int failure)
{
    return kind_fails(FAULT_OPENCL, queue, name, failure);
}

/* Every wrapper has two prototypes: the true function, and the one that the library reaches. */
#define CREATES(type, name, failure, parameters, ...)                                                                  \
    type __real_##name parameters;                                                                                     \
    type __wrap_##name parameters;                                                                                     \
    type __wrap_##name parameters                                                                                      \
    {                                                                                                                  \
        if (fails(#name, failure)) {                                                                                   \
            *code = failure;                                                                                           \
            return NULL;                                                                                               \
        }                                                                                                              \
        type object = __real_##name(__VA_ARGS__);                                                                      \
        fault_object(object ? 1 : 0);                                                                                  \
        return object;                                                                                                 \
    }

#define CALLS(name, failure, parameters, ...)                                                                          \
    cl_int __real_##name parameters;                                                                                   \
    cl_int __wrap_##name parameters;                                                                                   \
    cl_int __wrap_##name parameters                                                                                    \
    {                                                                                                                  \
        const cl_int failed = fails(#name, failure);                                                                   \
        return failed ? failed : __real_##name(__VA_ARGS__);                                                           \
    }

#define COMMANDS(name, parameters, ...)                                                                                \
    cl_int __real_##name parameters;                                                                                   \
    cl_int __wrap_##name parameters;                                                                                   \
    cl_int __wrap_##name parameters                                                                                    \
    {                                                                                                                  \
        const cl_int failed = queue_fails(queue, #name, CL_OUT_OF_RESOURCES);                                          \
        return failed ? failed : __real_##name(__VA_ARGS__);                                                           \
    }

#define RELEASES(name, type)                                                                                           \
    cl_int __real_##name(type object);                                                                                 \
    cl_int __wrap_##name(type object);                                                                                 \
    cl_int __wrap_##name(type object)                                                                                  \
    {                                                                                                                  \
        fault_object(-1);                                                                                              \
        return __real_##name(object);                                                                                  \
    }

CREATES(cl_context, clCreateContext, CL_OUT_OF_HOST_MEMORY,
        (const cl_context_properties *properties, cl_uint count, const cl_device_id *devices,
         void(CL_CALLBACK *notify)(const char *, const void *, size_t, void *), void *user, cl_int *code),
        properties, count, devices, notify, user, code)
CREATES(cl_command_queue, clCreateCommandQueue, CL_OUT_OF_RESOURCES,
        (cl_context context, cl_device_id device, cl_command_queue_properties properties, cl_int *code), context,
        device, properties, code)
CREATES(cl_program, clCreateProgramWithSource, CL_OUT_OF_HOST_MEMORY,
        (cl_context context, cl_uint count, const char **texts, const size_t *lengths, cl_int *code), context, count,
        texts, lengths, code)
CREATES(cl_program, clCreateProgramWithBinary, CL_INVALID_BINARY,
        (cl_context context, cl_uint count, const cl_device_id *devices, const size_t *lengths,
         const unsigned char **binaries, cl_int *each, cl_int *code),
        context, count, devices, lengths, binaries, each, code)
CREATES(cl_kernel, clCreateKernel, CL_OUT_OF_HOST_MEMORY, (cl_program program, const char *name, cl_int *code), program,
        name, code)

CALLS(clBuildProgram, CL_BUILD_PROGRAM_FAILURE,
      (cl_program program, cl_uint count, const cl_device_id *devices, const char *options,
       void(CL_CALLBACK *notify)(cl_program, void *), void *user),
      program, count, devices, options, notify, user)
CALLS(clSetKernelArg, CL_OUT_OF_RESOURCES, (cl_kernel kernel, cl_uint index, size_t size, const void *value), kernel,
      index, size, value)
COMMANDS(clEnqueueNDRangeKernel,
         (cl_command_queue queue, cl_kernel kernel, cl_uint dimensions, const size_t *offset, const size_t *global,
          const size_t *local, cl_uint waits, const cl_event *wait, cl_event *event),
         queue, kernel, dimensions, offset, global, local, waits, wait, event)
COMMANDS(clEnqueueReadBuffer,
         (cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset, size_t size, void *to, cl_uint waits,
          const cl_event *wait, cl_event *event),
         queue, buffer, blocking, offset, size, to, waits, wait, event)
COMMANDS(clEnqueueWriteBuffer,
         (cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset, size_t size, const void *from,
          cl_uint waits, const cl_event *wait, cl_event *event),
         queue, buffer, blocking, offset, size, from, waits, wait, event)
COMMANDS(clEnqueueFillBuffer,
         (cl_command_queue queue, cl_mem buffer, const void *pattern, size_t pattern_size, size_t offset, size_t size,
          cl_uint waits, const cl_event *wait, cl_event *event),
         queue, buffer, pattern, pattern_size, offset, size, waits, wait, event)
COMMANDS(clEnqueueCopyBuffer,
         (cl_command_queue queue, cl_mem from, cl_mem to, size_t from_offset, size_t to_offset, size_t size,
          cl_uint waits, const cl_event *wait, cl_event *event),
         queue, from, to, from_offset, to_offset, size, waits, wait, event)
COMMANDS(clEnqueueCopyBufferRect,
         (cl_command_queue queue, cl_mem from, cl_mem to, const size_t *from_origin, const size_t *to_origin,
          const size_t *region, size_t from_row, size_t from_slice, size_t to_row, size_t to_slice, cl_uint waits,
          const cl_event *wait, cl_event *event),
         queue, from, to, from_origin, to_origin, region, from_row, from_slice, to_row, to_slice, waits, wait, event)
COMMANDS(clEnqueueMarkerWithWaitList, (cl_command_queue queue, cl_uint waits, const cl_event *wait, cl_event *event),
         queue, waits, wait, event)
/* What is mapped is an object until it is unmapped. */
void *__real_clEnqueueMapBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, cl_map_flags flags,
                                size_t offset, size_t size, cl_uint waits, const cl_event *wait, cl_event *event,
                                cl_int *code);
void *__wrap_clEnqueueMapBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, cl_map_flags flags,
                                size_t offset, size_t size, cl_uint waits, const cl_event *wait, cl_event *event,
                                cl_int *code);
void *__wrap_clEnqueueMapBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, cl_map_flags flags,
                                size_t offset, size_t size, cl_uint waits, const cl_event *wait, cl_event *event,
                                cl_int *code)
{
    *code = kind_fails(FAULT_MAP, queue, "clEnqueueMapBuffer", CL_MAP_FAILURE);
    if (*code != CL_SUCCESS)
        return NULL;
    void *mapped = __real_clEnqueueMapBuffer(queue, buffer, blocking, flags, offset, size, waits, wait, event, code);
    fault_object(mapped ? 1 : 0);
    return mapped;
}

/* Done, and then the driver reports a failure. */
cl_int __real_clEnqueueUnmapMemObject(cl_command_queue queue, cl_mem buffer, void *mapped, cl_uint waits,
                                      const cl_event *wait, cl_event *event);
cl_int __wrap_clEnqueueUnmapMemObject(cl_command_queue queue, cl_mem buffer, void *mapped, cl_uint waits,
                                      const cl_event *wait, cl_event *event);
cl_int __wrap_clEnqueueUnmapMemObject(cl_command_queue queue, cl_mem buffer, void *mapped, cl_uint waits,
                                      const cl_event *wait, cl_event *event)
{
    const cl_int code = __real_clEnqueueUnmapMemObject(queue, buffer, mapped, waits, wait, event);
    const cl_int failed = kind_fails(FAULT_MAP, queue, "clEnqueueUnmapMemObject", CL_OUT_OF_RESOURCES);
    fault_object(-1);
    return failed ? failed : code;
}

CALLS(clGetProgramInfo, CL_OUT_OF_HOST_MEMORY,
      (cl_program program, cl_program_info what, size_t size, void *value, size_t *got), program, what, size, value,
      got)

CALLS(clGetContextInfo, CL_OUT_OF_HOST_MEMORY,
      (cl_context context, cl_context_info what, size_t size, void *value, size_t *got), context, what, size, value,
      got)
CALLS(clGetMemObjectInfo, CL_OUT_OF_HOST_MEMORY,
      (cl_mem buffer, cl_mem_info what, size_t size, void *value, size_t *got), buffer, what, size, value, got)
CALLS(clGetPlatformInfo, CL_OUT_OF_HOST_MEMORY,
      (cl_platform_id platform, cl_platform_info what, size_t size, void *value, size_t *got), platform, what, size,
      value, got)
CALLS(clGetProgramBuildInfo, CL_OUT_OF_HOST_MEMORY,
      (cl_program program, cl_device_id device, cl_program_build_info what, size_t size, void *value, size_t *got),
      program, device, what, size, value, got)
CALLS(clGetEventProfilingInfo, CL_PROFILING_INFO_NOT_AVAILABLE,
      (cl_event event, cl_profiling_info what, size_t size, void *value, size_t *got), event, what, size, value, got)
CALLS(clWaitForEvents, CL_OUT_OF_RESOURCES, (cl_uint count, const cl_event *events), count, events)
CALLS(clSetMemObjectDestructorCallback, CL_OUT_OF_HOST_MEMORY,
      (cl_mem buffer, void(CL_CALLBACK *call)(cl_mem, void *), void *user), buffer, call, user)
RELEASES(clReleaseContext, cl_context)
RELEASES(clReleaseCommandQueue, cl_command_queue)
RELEASES(clReleaseMemObject, cl_mem)
RELEASES(clReleaseProgram, cl_program)
RELEASES(clReleaseKernel, cl_kernel)
RELEASES(clReleaseDevice, cl_device_id)

/* A device that is out of use, or short of memory, gives no buffers. */
cl_mem __real_clCreateBuffer(cl_context context, cl_mem_flags flags, size_t size, void *host, cl_int *code);
cl_mem __wrap_clCreateBuffer(cl_context context, cl_mem_flags flags, size_t size, void *host, cl_int *code);
cl_mem __wrap_clCreateBuffer(cl_context context, cl_mem_flags flags, size_t size, void *host, cl_int *code)
{
    const cl_int lost = fault_lost(context);
    *code = lost ? lost : fails("clCreateBuffer", CL_MEM_OBJECT_ALLOCATION_FAILURE);
    if (*code != CL_SUCCESS)
        return NULL;
    cl_mem buffer = __real_clCreateBuffer(context, flags, size, host, code);
    fault_object(buffer ? 1 : 0);
    return buffer;
}

CREATES(cl_mem, clCreateSubBuffer, CL_MEM_OBJECT_ALLOCATION_FAILURE,
        (cl_mem buffer, cl_mem_flags flags, cl_buffer_create_type type, const void *region, cl_int *code), buffer,
        flags, type, region, code)

/* Parts of devices are objects, whole devices are not: those are never released. */
cl_int __real_clCreateSubDevices(cl_device_id device, const cl_device_partition_property *list, cl_uint room,
                                 cl_device_id *parts, cl_uint *count);
cl_int __wrap_clCreateSubDevices(cl_device_id device, const cl_device_partition_property *list, cl_uint room,
                                 cl_device_id *parts, cl_uint *count);
cl_int __wrap_clCreateSubDevices(cl_device_id device, const cl_device_partition_property *list, cl_uint room,
                                 cl_device_id *parts, cl_uint *count)
{
    if (fails("clCreateSubDevices", CL_OUT_OF_HOST_MEMORY))
        return CL_OUT_OF_HOST_MEMORY;
    const cl_int code = __real_clCreateSubDevices(device, list, room, parts, count);
    for (cl_uint i = 0; code == CL_SUCCESS && i < *count && i < room; i++)
        fault_object(1);
    return code;
}

/* The work is done, and then the driver reports a failure. */
cl_int __real_clFinish(cl_command_queue queue);
cl_int __wrap_clFinish(cl_command_queue queue);
cl_int __wrap_clFinish(cl_command_queue queue)
{
    const cl_int code = __real_clFinish(queue), failed = queue_fails(queue, "clFinish", CL_OUT_OF_RESOURCES);
    return failed ? failed : code;
}

cl_int __real_clGetPlatformIDs(cl_uint room, cl_platform_id *platforms, cl_uint *count);
cl_int __wrap_clGetPlatformIDs(cl_uint room, cl_platform_id *platforms, cl_uint *count);
cl_int __wrap_clGetPlatformIDs(cl_uint room, cl_platform_id *platforms, cl_uint *count)
{
    const cl_int failed = fault_pretend.no_platform ? -1001 : fails("clGetPlatformIDs", CL_OUT_OF_HOST_MEMORY);
    return failed ? failed : __real_clGetPlatformIDs(room, platforms, count);
}

cl_int __real_clGetDeviceIDs(cl_platform_id platform, cl_device_type type, cl_uint room, cl_device_id *devices,
                             cl_uint *count);
cl_int __wrap_clGetDeviceIDs(cl_platform_id platform, cl_device_type type, cl_uint room, cl_device_id *devices,
                             cl_uint *count);
cl_int __wrap_clGetDeviceIDs(cl_platform_id platform, cl_device_type type, cl_uint room, cl_device_id *devices,
                             cl_uint *count)
{
    const cl_int failed =
        fault_pretend.no_device ? CL_DEVICE_NOT_FOUND : fails("clGetDeviceIDs", CL_OUT_OF_HOST_MEMORY);
    return failed ? failed : __real_clGetDeviceIDs(platform, type, room, devices, count);
}

cl_int __real_clGetDeviceInfo(cl_device_id device, cl_device_info what, size_t size, void *value, size_t *got);
cl_int __wrap_clGetDeviceInfo(cl_device_id device, cl_device_info what, size_t size, void *value, size_t *got);
cl_int __wrap_clGetDeviceInfo(cl_device_id device, cl_device_info what, size_t size, void *value, size_t *got)
{
    if (fails("clGetDeviceInfo", CL_OUT_OF_HOST_MEMORY))
        return CL_OUT_OF_HOST_MEMORY;
    const cl_int code = __real_clGetDeviceInfo(device, what, size, value, got);
    if (what == CL_DEVICE_COMPILER_AVAILABLE && fault_pretend.no_compiler)
        memset(value, 0, sizeof(cl_bool));
    if (what == CL_DEVICE_MAX_MEM_ALLOC_SIZE && fault_pretend.max_allocation_bytes)
        memcpy(value, &fault_pretend.max_allocation_bytes, sizeof(cl_ulong));
    return code;
}
