/* Put before a program by LD_PRELOAD: makes a device say that it is another one, and refuse what that one would refuse.
 *
 *   CL_PRETEND=WORD[,WORD]...
 *     gpu          a GPU: memory of its own, vectors of one float, 48 KiB of local memory, groups of 1024
 *     fpga         an accelerator that cannot compile, with memory of its own, 32 KiB of it local
 *     apart        memory of its own
 *     nvidia       NVIDIA's, for what the library does differently there
 *     wave64       waves of 64 work-items, groups of 256
 *     local=N      so many bytes of local memory
 *     memory=N     so many bytes of memory, a quarter of them in one piece
 *     units=N      so many compute units
 *     align=N      parts of buffers begin at multiples of so many bytes
 *     plain        no sub-groups, no fp64, no fp16: not said, not compiled
 *     queues=N     so many queues at a time, none of them out of order
 *     late         transfers that nobody waits for begin when somebody does, as late as the standard allows
 *     slow=N       a compiler that takes so many milliseconds longer */
#define _GNU_SOURCE
#define CL_TARGET_OPENCL_VERSION 120
#define CL_USE_DEPRECATED_OPENCL_1_2_APIS
#include <CL/cl.h>
#include <CL/cl_ext.h>
#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct pretence {
    cl_device_type type; /* 0: the truth, here and below */
    int no_compiler, plain, apart, late, nvidia;
    cl_ulong local, memory, largest;
    size_t group, wave;
    cl_uint units, align, queues, slow_ms;
} pretence;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static cl_ulong held;       /* bytes of buffers; guarded by the lock */
static cl_uint queue_count; /* guarded by the lock */

static void read_word(pretence *p, const char *word)
{
    const char *equals = strchr(word, '=');
    const cl_ulong number = equals ? strtoull(equals + 1, NULL, 10) : 0;
    if (!strcmp(word, "gpu")) {
        p->type = CL_DEVICE_TYPE_GPU;
        p->local = p->local ? p->local : 48u << 10;
        p->group = p->group ? p->group : 1024;
    } else if (!strcmp(word, "fpga")) {
        p->type = CL_DEVICE_TYPE_ACCELERATOR;
        p->local = p->local ? p->local : 32u << 10;
        p->no_compiler = 1;
    } else if (!strcmp(word, "wave64")) {
        p->wave = 64;
        p->group = 256;
    } else if (!strcmp(word, "plain")) {
        p->plain = 1;
    } else if (!strcmp(word, "apart")) {
        p->apart = 1;
    } else if (!strcmp(word, "nvidia")) {
        p->nvidia = 1;
    } else if (!strcmp(word, "late")) {
        p->late = 1;
    } else if (!strncmp(word, "local=", 6)) {
        p->local = number;
    } else if (!strncmp(word, "memory=", 7)) {
        p->memory = number;
        p->largest = number / 4;
    } else if (!strncmp(word, "units=", 6)) {
        p->units = (cl_uint)number;
    } else if (!strncmp(word, "align=", 6)) {
        p->align = (cl_uint)number;
    } else if (!strncmp(word, "queues=", 7)) {
        p->queues = (cl_uint)number;
    } else if (!strncmp(word, "slow=", 5)) {
        p->slow_ms = (cl_uint)number;
    } else {
        fprintf(stderr, "CL_PRETEND: there is no '%s'\n", word);
        exit(99);
    }
}

static pretence now;

__attribute__((constructor)) static void begin(void)
{
    char words[256], *rest = NULL;
    const char *all = getenv("CL_PRETEND");
    snprintf(words, sizeof words, "%s", all ? all : "");
    for (const char *word = strtok_r(words, ",", &rest); word; word = strtok_r(NULL, ",", &rest))
        read_word(&now, word);
}

/* The true function; POSIX lets dlsym() give one. */
#define TRUE_FUNCTION(name)                                                                                            \
    static __typeof__(&name) real;                                                                                     \
    if (!real)                                                                                                         \
    *(void **)(void *)&real = dlsym(RTLD_NEXT, #name)

/* Blanks the names of extensions that begin with `name`. */
static void blank(char *text, const char *name)
{
    for (char *at = strstr(text, name); at; at = strstr(at, name))
        for (; *at && *at != ' '; at++)
            *at = ' ';
}

static void lower(cl_ulong *value, cl_ulong to)
{
    *value = to && *value > to ? to : *value;
}

static void disguise(cl_device_info which, void *value)
{
    const int gpu = now.type == CL_DEVICE_TYPE_GPU;
    switch (which) {
    case CL_DEVICE_TYPE: *(cl_device_type *)value = now.type ? now.type : *(cl_device_type *)value; break;
    case CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT: *(cl_uint *)value = gpu ? 1 : *(cl_uint *)value; break;
    case CL_DEVICE_HOST_UNIFIED_MEMORY: *(cl_bool *)value = now.type || now.apart ? CL_FALSE : *(cl_bool *)value; break;
    case CL_DEVICE_MAX_COMPUTE_UNITS: *(cl_uint *)value = now.units ? now.units : *(cl_uint *)value; break;
    case CL_DEVICE_LOCAL_MEM_TYPE:
        *(cl_device_local_mem_type *)value = now.type ? CL_LOCAL : *(cl_device_local_mem_type *)value;
        break;
    case CL_DEVICE_PARTITION_MAX_SUB_DEVICES: *(cl_uint *)value = now.type ? 0 : *(cl_uint *)value; break;
    case CL_DEVICE_LOCAL_MEM_SIZE: lower(value, now.local); break;
    case CL_DEVICE_GLOBAL_MEM_SIZE: lower(value, now.memory); break;
    case CL_DEVICE_MAX_MEM_ALLOC_SIZE: lower(value, now.largest); break;
    case CL_DEVICE_MAX_WORK_GROUP_SIZE:
        *(size_t *)value = now.group && *(size_t *)value > now.group ? now.group : *(size_t *)value;
        break;
    case CL_DEVICE_MEM_BASE_ADDR_ALIGN: *(cl_uint *)value = now.align ? 8 * now.align : *(cl_uint *)value; break;
    case CL_DEVICE_COMPILER_AVAILABLE: *(cl_bool *)value = now.no_compiler ? CL_FALSE : *(cl_bool *)value; break;
    case CL_DEVICE_QUEUE_PROPERTIES:
        if (now.queues)
            *(cl_command_queue_properties *)value &=
                ~(cl_command_queue_properties)CL_QUEUE_OUT_OF_ORDER_EXEC_MODE_ENABLE;
        break;
    case CL_DEVICE_DOUBLE_FP_CONFIG: *(cl_ulong *)value = now.plain ? 0 : *(cl_ulong *)value; break;
    case CL_DEVICE_EXTENSIONS:
        if (now.plain) {
            blank(value, "cl_khr_fp64");
            blank(value, "cl_khr_fp16");
            blank(value, "cl_khr_subgroup");
            blank(value, "cl_intel_subgroup");
        }
        break;
    default: break;
    }
}

cl_int clGetDeviceInfo(cl_device_id device, cl_device_info which, size_t size, void *value, size_t *needed)
{
    TRUE_FUNCTION(clGetDeviceInfo);
    const cl_int code = real(device, which, size, value, needed);
    if (code == CL_SUCCESS && value)
        disguise(which, value);
    if (code == CL_SUCCESS && value && which == CL_DEVICE_VENDOR && now.nvidia)
        snprintf(value, size, "NVIDIA");
    return code;
}

cl_int clGetKernelWorkGroupInfo(cl_kernel kernel, cl_device_id device, cl_kernel_work_group_info which, size_t size,
                                void *value, size_t *needed)
{
    TRUE_FUNCTION(clGetKernelWorkGroupInfo);
    const cl_int code = real(kernel, device, which, size, value, needed);
    if (code == CL_SUCCESS && value && which == CL_KERNEL_PREFERRED_WORK_GROUP_SIZE_MULTIPLE && now.wave)
        *(size_t *)value = now.wave;
    if (code == CL_SUCCESS && value && which == CL_KERNEL_WORK_GROUP_SIZE && now.group && *(size_t *)value > now.group)
        *(size_t *)value = now.group;
    return code;
}

/* What a compiler that knows neither doubles nor sub-groups stumbles over. */
static const char without[] = "#undef cl_khr_fp64\n#undef cl_khr_fp16\n#undef cl_khr_subgroups\n"
                              "#define double there_is_no_double\n#define double2 there_is_no_double\n"
                              "#define double4 there_is_no_double\n#define double8 there_is_no_double\n"
                              "#define get_sub_group_id there_are_no_sub_groups\n"
                              "#define get_sub_group_local_id there_are_no_sub_groups\n"
                              "#define sub_group_barrier there_are_no_sub_groups\n"
                              "#define sub_group_broadcast there_are_no_sub_groups\n"
                              "#define sub_group_reduce_add there_are_no_sub_groups\n"
                              "#define sub_group_shuffle there_are_no_sub_groups\n"
                              "#define sub_group_shuffle_xor there_are_no_sub_groups\n#line 1\n";

cl_program clCreateProgramWithSource(cl_context context, cl_uint count, const char **texts, const size_t *lengths,
                                     cl_int *code)
{
    TRUE_FUNCTION(clCreateProgramWithSource);
    if (!now.plain)
        return real(context, count, texts, lengths, code);
    const char **more = malloc((count + 1) * sizeof *more);
    size_t *sizes = malloc((count + 1) * sizeof *sizes);
    more[0] = without;
    sizes[0] = sizeof without - 1;
    for (cl_uint i = 0; i < count; i++) {
        more[i + 1] = texts[i];
        sizes[i + 1] = lengths && lengths[i] ? lengths[i] : strlen(texts[i]);
    }
    cl_program program = real(context, count + 1, more, sizes, code);
    free(more);
    free(sizes);
    return program;
}

cl_int clBuildProgram(cl_program program, cl_uint count, const cl_device_id *devices, const char *options,
                      void(CL_CALLBACK *notify)(cl_program, void *), void *user)
{
    TRUE_FUNCTION(clBuildProgram);
    const struct timespec wait = {now.slow_ms / 1000, (long)(now.slow_ms % 1000) * 1000000};
    char text[16] = "", all[2048];
    size_t bytes = 0;
    clGetProgramInfo(program, CL_PROGRAM_SOURCE, 0, NULL, &bytes);
    if (now.no_compiler && bytes > sizeof text)
        return CL_COMPILER_NOT_AVAILABLE;
    if (now.slow_ms)
        nanosleep(&wait, NULL);
    snprintf(all, sizeof all, "%s%s", options ? options : "", now.plain ? " -cl-single-precision-constant" : "");
    return real(program, count, devices, all, notify, user);
}

cl_int clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions, const size_t *offset,
                              const size_t *global, const size_t *local, cl_uint waits, const cl_event *wait,
                              cl_event *event)
{
    TRUE_FUNCTION(clEnqueueNDRangeKernel);
    cl_device_id device = NULL;
    cl_ulong bytes = 0;
    size_t items = 1;
    clGetCommandQueueInfo(queue, CL_QUEUE_DEVICE, sizeof device, &device, NULL);
    for (cl_uint i = 0; local && i < dimensions; i++)
        items *= local[i];
    if (now.group && items > now.group)
        return CL_INVALID_WORK_GROUP_SIZE;
    clGetKernelWorkGroupInfo(kernel, device, CL_KERNEL_LOCAL_MEM_SIZE, sizeof bytes, &bytes, NULL);
    if (now.local && bytes > now.local)
        return CL_OUT_OF_RESOURCES;
    return real(queue, kernel, dimensions, offset, global, local, waits, wait, event);
}

cl_mem clCreateBuffer(cl_context context, cl_mem_flags flags, size_t size, void *host, cl_int *code)
{
    TRUE_FUNCTION(clCreateBuffer);
    cl_int failed = now.largest && size > now.largest ? CL_INVALID_BUFFER_SIZE : CL_SUCCESS;
    pthread_mutex_lock(&lock);
    if (!failed && now.memory && held + size > now.memory)
        failed = CL_MEM_OBJECT_ALLOCATION_FAILURE;
    held += failed ? 0 : size;
    pthread_mutex_unlock(&lock);
    if (code)
        *code = failed;
    return failed ? NULL : real(context, flags, size, host, code);
}

cl_int clReleaseMemObject(cl_mem buffer)
{
    TRUE_FUNCTION(clReleaseMemObject);
    cl_uint references = 0;
    cl_mem whole = NULL;
    size_t size = 0;
    clGetMemObjectInfo(buffer, CL_MEM_REFERENCE_COUNT, sizeof references, &references, NULL);
    clGetMemObjectInfo(buffer, CL_MEM_ASSOCIATED_MEMOBJECT, sizeof whole, &whole, NULL);
    clGetMemObjectInfo(buffer, CL_MEM_SIZE, sizeof size, &size, NULL);
    if (references == 1 && !whole) {
        pthread_mutex_lock(&lock);
        held -= size < held ? size : held;
        pthread_mutex_unlock(&lock);
    }
    return real(buffer);
}

cl_mem clCreateSubBuffer(cl_mem buffer, cl_mem_flags flags, cl_buffer_create_type type, const void *region,
                         cl_int *code)
{
    TRUE_FUNCTION(clCreateSubBuffer);
    if (now.align && ((const cl_buffer_region *)region)->origin % now.align) {
        *code = CL_MISALIGNED_SUB_BUFFER_OFFSET;
        return NULL;
    }
    return real(buffer, flags, type, region, code);
}

cl_command_queue clCreateCommandQueue(cl_context context, cl_device_id device, cl_command_queue_properties properties,
                                      cl_int *code)
{
    TRUE_FUNCTION(clCreateCommandQueue);
    cl_int failed = CL_SUCCESS;
    pthread_mutex_lock(&lock);
    if (now.queues && properties & CL_QUEUE_OUT_OF_ORDER_EXEC_MODE_ENABLE)
        failed = CL_INVALID_QUEUE_PROPERTIES;
    else if (now.queues && queue_count == now.queues)
        failed = CL_OUT_OF_RESOURCES;
    queue_count += !failed;
    pthread_mutex_unlock(&lock);
    if (code)
        *code = failed;
    return failed ? NULL : real(context, device, properties, code);
}

/* Late transfers: the first of a queue waits for an event of ours, and what follows in the queue for it. */
static struct {
    cl_command_queue queue;
    cl_event open;
} gates[64];

/* The event that this queue's commands wait for, from now on, which is to be released; NULL: there is no more room. */
static cl_event close_gate(cl_command_queue queue)
{
    const size_t most = sizeof gates / sizeof *gates;
    size_t i = 0;
    pthread_mutex_lock(&lock);
    while (i < most && gates[i].queue != queue)
        i++;
    if (i == most)
        for (i = 0; i < most && gates[i].queue;)
            i++;
    if (i < most && !gates[i].queue) {
        cl_context context = NULL;
        clGetCommandQueueInfo(queue, CL_QUEUE_CONTEXT, sizeof context, &context, NULL);
        gates[i].open = clCreateUserEvent(context, NULL);
        gates[i].queue = queue;
    }
    cl_event open = i < most ? gates[i].open : NULL;
    if (open)
        clRetainEvent(open);
    pthread_mutex_unlock(&lock);
    return open;
}

/* All queues go on: somebody waits for one, or for an event, which may be any queue's. */
static void open_gates(void)
{
    pthread_mutex_lock(&lock);
    for (size_t i = 0; i < sizeof gates / sizeof *gates; i++)
        if (gates[i].queue) {
            gates[i].queue = NULL;
            clSetUserEventStatus(gates[i].open, CL_COMPLETE);
            clReleaseEvent(gates[i].open);
        }
    pthread_mutex_unlock(&lock);
}

cl_int clReleaseCommandQueue(cl_command_queue queue)
{
    TRUE_FUNCTION(clReleaseCommandQueue);
    open_gates();
    cl_uint references = 0;
    clGetCommandQueueInfo(queue, CL_QUEUE_REFERENCE_COUNT, sizeof references, &references, NULL);
    pthread_mutex_lock(&lock);
    queue_count -= references == 1 && queue_count;
    pthread_mutex_unlock(&lock);
    return real(queue);
}

/* What a transfer has to wait for, which is to be released; NULL: nothing of ours. */
static cl_event gate_of(cl_command_queue queue, cl_bool blocking, cl_uint waits)
{
    if (blocking)
        open_gates();
    return now.late && !blocking && !waits ? close_gate(queue) : NULL;
}

cl_int clEnqueueWriteBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset, size_t size,
                            const void *data, cl_uint waits, const cl_event *wait, cl_event *event)
{
    TRUE_FUNCTION(clEnqueueWriteBuffer);
    cl_event gate = gate_of(queue, blocking, waits);
    const cl_int code = real(queue, buffer, blocking, offset, size, data, gate ? 1 : waits, gate ? &gate : wait, event);
    if (gate)
        clReleaseEvent(gate);
    return code;
}

cl_int clEnqueueReadBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset, size_t size,
                           void *data, cl_uint waits, const cl_event *wait, cl_event *event)
{
    TRUE_FUNCTION(clEnqueueReadBuffer);
    cl_event gate = gate_of(queue, blocking, waits);
    const cl_int code = real(queue, buffer, blocking, offset, size, data, gate ? 1 : waits, gate ? &gate : wait, event);
    if (gate)
        clReleaseEvent(gate);
    return code;
}

void *clEnqueueMapBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, cl_map_flags flags, size_t offset,
                         size_t size, cl_uint waits, const cl_event *wait, cl_event *event, cl_int *code)
{
    TRUE_FUNCTION(clEnqueueMapBuffer);
    open_gates();
    return real(queue, buffer, blocking, flags, offset, size, waits, wait, event, code);
}

cl_int clFinish(cl_command_queue queue)
{
    TRUE_FUNCTION(clFinish);
    open_gates();
    return real(queue);
}

cl_int clWaitForEvents(cl_uint count, const cl_event *events)
{
    TRUE_FUNCTION(clWaitForEvents);
    open_gates();
    return real(count, events);
}
