#include "core/base.h"

#include <stdarg.h>

const char *hada_status_name(hada_status status)
{
    switch (status) {
    case HADA_OK: return "HADA_OK";
    case HADA_ERROR_ARGUMENT: return "HADA_ERROR_ARGUMENT";
    case HADA_ERROR_SIZE: return "HADA_ERROR_SIZE";
    case HADA_ERROR_STATE: return "HADA_ERROR_STATE";
    case HADA_ERROR_UNSUPPORTED: return "HADA_ERROR_UNSUPPORTED";
    case HADA_ERROR_CANCELLED: return "HADA_ERROR_CANCELLED";
    case HADA_ERROR_MEMORY: return "HADA_ERROR_MEMORY";
    case HADA_ERROR_DEVICE_MEMORY: return "HADA_ERROR_DEVICE_MEMORY";
    case HADA_ERROR_FILE_OPEN: return "HADA_ERROR_FILE_OPEN";
    case HADA_ERROR_FILE_READ: return "HADA_ERROR_FILE_READ";
    case HADA_ERROR_FILE_FORMAT: return "HADA_ERROR_FILE_FORMAT";
    case HADA_ERROR_FILE_WRITE: return "HADA_ERROR_FILE_WRITE";
    case HADA_ERROR_NOT_FINITE: return "HADA_ERROR_NOT_FINITE";
    case HADA_ERROR_DATASET: return "HADA_ERROR_DATASET";
    case HADA_ERROR_MODEL: return "HADA_ERROR_MODEL";
    case HADA_ERROR_NO_DEVICE: return "HADA_ERROR_NO_DEVICE";
    case HADA_ERROR_DEVICE_CHOICE: return "HADA_ERROR_DEVICE_CHOICE";
    case HADA_ERROR_DEVICE: return "HADA_ERROR_DEVICE";
    case HADA_ERROR_BUILD: return "HADA_ERROR_BUILD";
    case HADA_ERROR_SELF_TEST: return "HADA_ERROR_SELF_TEST";
    case HADA_ERROR_NUMERIC: return "HADA_ERROR_NUMERIC";
    }
    return "unknown status";
}

void hada_error_set(hada_error *err, hada_status status, const char *format, ...)
{
    if (!err)
        return;
    va_list arguments;
    err->status = status;
    err->cl_code = 0;
    err->detail[0] = '\0';
    va_start(arguments, format);
    vsnprintf(err->message, sizeof err->message, format, arguments);
    va_end(arguments);
}

int hada_cl_is_memory(int code)
{
    /* CL_MEM_OBJECT_ALLOCATION_FAILURE, CL_OUT_OF_RESOURCES, CL_OUT_OF_HOST_MEMORY, CL_INVALID_BUFFER_SIZE */
    return code == -4 || code == -5 || code == -6 || code == -61;
}

void hada_error_set_cl(hada_error *err, int code, const char *call)
{
    const int memory = hada_cl_is_memory(code);
    hada_error_set(
        err, memory ? HADA_ERROR_DEVICE_MEMORY : HADA_ERROR_DEVICE, "%s failed with %s (%d)%s%s", call,
        hada_cl_code_name(code), code,
        memory ? "; the device is short of memory: use fewer depths, a smaller window, half filters or another device"
               : "",
        /* what NVIDIA's driver says after a kernel that read or wrote where it must not */
        code == -5 ? "; with memory to spare a kernel has failed on the device: please report it with the output of "
                     "'hadalens devices'"
                   : "");
    if (err)
        err->cl_code = code;
}

hada_status hada_error_of_file(hada_status status, hada_error *err)
{
    if (status != HADA_ERROR_ARGUMENT && status != HADA_ERROR_UNSUPPORTED)
        return status;
    if (err)
        err->status = HADA_ERROR_FILE_FORMAT;
    return HADA_ERROR_FILE_FORMAT;
}

void hada_error_prefix(hada_error *err, const char *format, ...)
{
    if (!err)
        return;
    char old[sizeof err->message];
    char prefix[512];
    va_list arguments;
    memcpy(old, err->message, sizeof old);
    va_start(arguments, format);
    vsnprintf(prefix, sizeof prefix, format, arguments);
    va_end(arguments);
    snprintf(err->message, sizeof err->message, "%s%.*s", prefix, (int)(sizeof old - sizeof prefix), old);
}

const char *hada_cl_code_name(int code)
{
    static const struct {
        int code;
        const char *name;
    } names[] = {
        {0, "CL_SUCCESS"},
        {-1, "CL_DEVICE_NOT_FOUND"},
        {-2, "CL_DEVICE_NOT_AVAILABLE"},
        {-3, "CL_COMPILER_NOT_AVAILABLE"},
        {-4, "CL_MEM_OBJECT_ALLOCATION_FAILURE"},
        {-5, "CL_OUT_OF_RESOURCES"},
        {-6, "CL_OUT_OF_HOST_MEMORY"},
        {-7, "CL_PROFILING_INFO_NOT_AVAILABLE"},
        {-8, "CL_MEM_COPY_OVERLAP"},
        {-11, "CL_BUILD_PROGRAM_FAILURE"},
        {-12, "CL_MAP_FAILURE"},
        {-13, "CL_MISALIGNED_SUB_BUFFER_OFFSET"},
        {-14, "CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST"},
        {-18, "CL_DEVICE_PARTITION_FAILED"},
        {-30, "CL_INVALID_VALUE"},
        {-31, "CL_INVALID_DEVICE_TYPE"},
        {-32, "CL_INVALID_PLATFORM"},
        {-33, "CL_INVALID_DEVICE"},
        {-34, "CL_INVALID_CONTEXT"},
        {-36, "CL_INVALID_COMMAND_QUEUE"},
        {-38, "CL_INVALID_MEM_OBJECT"},
        {-42, "CL_INVALID_BINARY"},
        {-43, "CL_INVALID_BUILD_OPTIONS"},
        {-44, "CL_INVALID_PROGRAM"},
        {-45, "CL_INVALID_PROGRAM_EXECUTABLE"},
        {-46, "CL_INVALID_KERNEL_NAME"},
        {-48, "CL_INVALID_KERNEL"},
        {-49, "CL_INVALID_ARG_INDEX"},
        {-50, "CL_INVALID_ARG_VALUE"},
        {-51, "CL_INVALID_ARG_SIZE"},
        {-52, "CL_INVALID_KERNEL_ARGS"},
        {-53, "CL_INVALID_WORK_DIMENSION"},
        {-54, "CL_INVALID_WORK_GROUP_SIZE"},
        {-55, "CL_INVALID_WORK_ITEM_SIZE"},
        {-57, "CL_INVALID_EVENT_WAIT_LIST"},
        {-61, "CL_INVALID_BUFFER_SIZE"},
        {-63, "CL_INVALID_GLOBAL_WORK_SIZE"},
        {-1001, "CL_PLATFORM_NOT_FOUND_KHR"},
    };
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (names[i].code == code)
            return names[i].name;
    return "an OpenCL error";
}

void hada_memory_destroy(void *address_of_pointer)
{
    void *made = NULL;
    if (!address_of_pointer)
        return;
    memcpy(&made, address_of_pointer, sizeof made);
    free(made);
    made = NULL;
    memcpy(address_of_pointer, &made, sizeof made);
}

const char *hada_version(void)
{
    return HADALENS_VERSION;
}

/* Host memory. */

size_t hada_size_product(size_t count, size_t size)
{
    return size && count > SIZE_MAX / size ? SIZE_MAX : count * size;
}

static void *no_memory(size_t bytes, const char *what, hada_error *err)
{
    hada_fail(err, HADA_ERROR_MEMORY, "no memory for %s (%.1f MiB); close other programs or work on smaller frames",
              what, (double)bytes / (1024.0 * 1024.0));
    return NULL;
}

void *hada_alloc(size_t count, size_t size, const char *what, hada_error *err)
{
    const size_t bytes = hada_size_product(count, size);
    void *out = bytes > SIZE_MAX / 2 ? NULL : calloc(bytes ? bytes : 1, 1);
    return out ? out : no_memory(bytes, what, err);
}

void *hada_alloc_raw(size_t count, size_t size, const char *what, hada_error *err)
{
    const size_t bytes = hada_size_product(count, size);
    void *out = NULL;
    if (bytes <= SIZE_MAX / 2) {
        const size_t whole = (bytes + 63) / 64 * 64;
        out = aligned_alloc(64, whole ? whole : 64);
    }
    return out ? out : no_memory(bytes, what, err);
}

/* The power of two that has room for so many. */
static size_t room_of(size_t count)
{
    size_t room = 1;
    while (room < count && room <= SIZE_MAX / 2)
        room *= 2;
    return room;
}

hada_status hada_grow(void *place, size_t held, size_t more, size_t size, const char *what, hada_error *err)
{
    const size_t room = room_of(more > SIZE_MAX - held ? SIZE_MAX : held + more), bytes = hada_size_product(room, size);
    void *array;
    memcpy(&array, place, sizeof array);
    if (array && room == room_of(held))
        return HADA_OK;
    array = bytes > SIZE_MAX / 2 ? NULL : realloc(array, bytes ? bytes : 1);
    if (!array)
        return hada_allocated(no_memory(bytes, what, err));
    memcpy(place, &array, sizeof array);
    return HADA_OK;
}

double hada_product(const float *a, const float *b, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (double)a[i] * b[i];
    return sum;
}

int hada_ascending(const void *a, const void *b)
{
    const double one = *(const double *)a, other = *(const double *)b;
    return (one > other) - (one < other);
}

double hada_median(double *values, size_t count)
{
    if (!count)
        return NAN;
    qsort(values, count, sizeof *values, hada_ascending);
    return 0.5 * (values[(count - 1) / 2] + values[count / 2]);
}

char *hada_string_copy(const char *text)
{
    size_t bytes = strlen(text) + 1;
    char *copy = malloc(bytes);
    if (copy)
        memcpy(copy, text, bytes);
    return copy;
}

void hada_free_each(void *const *pointers, size_t count)
{
    for (size_t i = 0; i < count; i++)
        free(pointers[i]);
}
