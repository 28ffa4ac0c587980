/* Put before a program by LD_PRELOAD: counts its OpenCL calls.
 *
 *   CL_SHIM_COUNTS=FILE   when the program ends: a line for each kind of call, "KIND<tab>WHAT<tab>CALLS<tab>AMOUNT".
 *                         launch: WHAT is the kernel, AMOUNT the work-items; write, read, map: WHAT is "blocking" or
 *                         "async", AMOUNT the bytes; fill, copy: bytes; wait: WHAT is the call; argument */
#define _GNU_SOURCE
#define CL_TARGET_OPENCL_VERSION 120
#define CL_USE_DEPRECATED_OPENCL_1_2_APIS
#include <CL/cl.h>
#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS = 512, NAME = 64 };

typedef struct row {
    const char *kind;
    char what[NAME];
    unsigned long calls;
    double amount;
} row;

static row rows[ROWS];
static int count;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static void add(const char *kind, const char *what, double amount)
{
    int i = 0;
    pthread_mutex_lock(&lock);
    while (i < count && (strcmp(rows[i].kind, kind) || strcmp(rows[i].what, what)))
        i++;
    if (i == count && count < ROWS) {
        rows[count].kind = kind;
        snprintf(rows[count++].what, NAME, "%s", what);
    }
    if (i < ROWS) {
        rows[i].calls++;
        rows[i].amount += amount;
    }
    pthread_mutex_unlock(&lock);
}

__attribute__((destructor)) static void write_counts(void)
{
    const char *path = getenv("CL_SHIM_COUNTS");
    FILE *file = path && count ? fopen(path, "w") : NULL;
    if (!file)
        return;
    for (int i = 0; i < count; i++)
        fprintf(file, "%s\t%s\t%lu\t%.0f\n", rows[i].kind, rows[i].what, rows[i].calls, rows[i].amount);
    fclose(file);
}

/* The true function; POSIX lets dlsym() give one. */
#define TRUE_FUNCTION(name)                                                                                            \
    static __typeof__(&name) real;                                                                                     \
    if (!real)                                                                                                         \
    *(void **)(void *)&real = dlsym(RTLD_NEXT, #name)

static const char *manner(cl_bool blocking)
{
    return blocking ? "blocking" : "async";
}

cl_int clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions, const size_t *offset,
                              const size_t *global, const size_t *local, cl_uint waits, const cl_event *wait,
                              cl_event *event)
{
    TRUE_FUNCTION(clEnqueueNDRangeKernel);
    char name[NAME] = "";
    double items = 1.0;
    clGetKernelInfo(kernel, CL_KERNEL_FUNCTION_NAME, sizeof name, name, NULL);
    for (cl_uint i = 0; i < dimensions; i++)
        items *= (double)global[i];
    add("launch", name, items);
    return real(queue, kernel, dimensions, offset, global, local, waits, wait, event);
}

cl_int clSetKernelArg(cl_kernel kernel, cl_uint index, size_t size, const void *value)
{
    TRUE_FUNCTION(clSetKernelArg);
    add("argument", "", 0);
    return real(kernel, index, size, value);
}

cl_int clFinish(cl_command_queue queue)
{
    TRUE_FUNCTION(clFinish);
    add("wait", "clFinish", 0);
    return real(queue);
}

cl_int clWaitForEvents(cl_uint events, const cl_event *list)
{
    TRUE_FUNCTION(clWaitForEvents);
    add("wait", "clWaitForEvents", 0);
    return real(events, list);
}

cl_int clEnqueueReadBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset, size_t size,
                           void *to, cl_uint waits, const cl_event *wait, cl_event *event)
{
    TRUE_FUNCTION(clEnqueueReadBuffer);
    add("read", manner(blocking), (double)size);
    return real(queue, buffer, blocking, offset, size, to, waits, wait, event);
}

cl_int clEnqueueWriteBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset, size_t size,
                            const void *from, cl_uint waits, const cl_event *wait, cl_event *event)
{
    TRUE_FUNCTION(clEnqueueWriteBuffer);
    add("write", manner(blocking), (double)size);
    return real(queue, buffer, blocking, offset, size, from, waits, wait, event);
}

cl_int clEnqueueCopyBuffer(cl_command_queue queue, cl_mem from, cl_mem to, size_t from_offset, size_t to_offset,
                           size_t size, cl_uint waits, const cl_event *wait, cl_event *event)
{
    TRUE_FUNCTION(clEnqueueCopyBuffer);
    add("copy", "", (double)size);
    return real(queue, from, to, from_offset, to_offset, size, waits, wait, event);
}

cl_int clEnqueueFillBuffer(cl_command_queue queue, cl_mem buffer, const void *pattern, size_t pattern_size,
                           size_t offset, size_t size, cl_uint waits, const cl_event *wait, cl_event *event)
{
    TRUE_FUNCTION(clEnqueueFillBuffer);
    add("fill", "", (double)size);
    return real(queue, buffer, pattern, pattern_size, offset, size, waits, wait, event);
}

void *clEnqueueMapBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, cl_map_flags flags, size_t offset,
                         size_t size, cl_uint waits, const cl_event *wait, cl_event *event, cl_int *code)
{
    TRUE_FUNCTION(clEnqueueMapBuffer);
    add("map", manner(blocking), (double)size);
    return real(queue, buffer, blocking, flags, offset, size, waits, wait, event, code);
}
