/* Listing devices and describing them. */
#include <pthread.h>
#include <strings.h>

#include "runtime/context.h"

/* Parts of a device, as devices of their own. They are made once and stay: PoCL's threads look at the device of a
 * command after whoever waited for it was called, so that a part that is given back then is read after it is gone. */

/* Whether the device can be divided in a way. */
static int can(cl_device_id device, cl_device_partition_property way)
{
    cl_device_partition_property ways[16];
    size_t bytes = 0;
    if (clGetDeviceInfo(device, CL_DEVICE_PARTITION_PROPERTIES, sizeof ways, ways, &bytes) != CL_SUCCESS)
        return 0;
    for (size_t i = 0; i < bytes / sizeof *ways; i++)
        if (ways[i] == way)
            return 1;
    return 0;
}

/* The list of properties for clCreateSubDevices; freed with free(). */
static hada_status describe_parts(cl_device_id device, const hada_device_info *info, unsigned parts,
                                  cl_device_partition_property **out, hada_error *err)
{
    const unsigned each = info->compute_units / parts, rest = info->compute_units % parts;
    const int counts = can(device, CL_DEVICE_PARTITION_BY_COUNTS);
    HADA_TRY(HADA_NEW(*out, parts + 3, "the parts of a device", err));
    cl_device_partition_property *list = *out;
    if (!rest && can(device, CL_DEVICE_PARTITION_EQUALLY)) {
        list[0] = CL_DEVICE_PARTITION_EQUALLY;
        list[1] = each;
        return HADA_OK;
    }
    list[0] = CL_DEVICE_PARTITION_BY_COUNTS;
    for (unsigned i = 0; i < parts; i++)
        list[1 + i] = each + (i < rest);
    list[1 + parts] = CL_DEVICE_PARTITION_BY_COUNTS_LIST_END;
    if (counts)
        return HADA_OK;
    free(list);
    *out = NULL;
    return hada_fail(err, HADA_ERROR_DEVICE_CHOICE, "%s cannot be divided into %u parts: its driver offers no way to",
                     info->name, parts);
}

/* A device in so many parts. */
typedef struct division {
    struct division *next;
    cl_device_id whole;
    cl_uint parts;
    cl_device_id part[];
} division;

static struct {
    pthread_mutex_t lock;
    division *first;
} known = {.lock = PTHREAD_MUTEX_INITIALIZER};

static division *find_division(cl_device_id whole, cl_uint parts)
{
    division *it = known.first;
    while (it && (it->whole != whole || it->parts != parts))
        it = it->next;
    return it;
}

static hada_status make_division(cl_device_id whole, const hada_device_info *info, cl_uint parts, division **out,
                                 hada_error *err)
{
    cl_device_partition_property *list = NULL;
    division *made = NULL;
    cl_uint count = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(describe_parts(whole, info, parts, &list, err));
    HADA_TRY_OR_DONE(
        hada_allocated(made = hada_alloc(1, sizeof *made + parts * sizeof *made->part, "the parts of a device", err)));
    *made = (division){.next = known.first, .whole = whole, .parts = parts};
    const cl_int code = clCreateSubDevices(whole, list, parts, made->part, &count);
    if (code != CL_SUCCESS)
        HADA_TRY_OR_DONE(hada_fail_cl(err, code, "clCreateSubDevices"));
    if (count < parts)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_DEVICE, "%s gave %u parts instead of %u", info->name, count, parts));
    *out = known.first = made;
    made = NULL;
done:
    for (cl_uint i = 0; made && i < count && i < parts; i++)
        clReleaseDevice(made->part[i]);
    HADA_FREE(made, list);
    return status;
}

hada_status hada_device_divide(cl_device_id device, const hada_device_info *info, int part, int parts,
                               cl_device_id *out, hada_error *err)
{
    hada_status status = HADA_OK;
    if (parts < 1 || part < 1 || part > parts)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "part %d of %d of a device: parts are counted from 1", part, parts);
    /* some drivers crash when asked for an unsupported partition: check first */
    if ((unsigned)parts > info->max_sub_devices || (unsigned)parts > info->compute_units)
        return hada_fail(err, HADA_ERROR_DEVICE_CHOICE,
                         "%s cannot be divided into %d parts: it has %u compute unit(s) and takes at most %u parts",
                         info->name, parts, info->compute_units, info->max_sub_devices);
    pthread_mutex_lock(&known.lock);
    division *all = find_division(device, (cl_uint)parts);
    if (!all)
        status = make_division(device, info, (cl_uint)parts, &all, err);
    if (all)
        *out = all->part[part - 1];
    pthread_mutex_unlock(&known.lock);
    return status;
}

hada_status hada_device_part(char *words, int *part, int *parts, hada_error *err)
{
    char *colon = strrchr(words, ':'), end;
    int first, all;
    if (!colon || sscanf(colon, ":%d/%d%c", &first, &all, &end) != 2)
        return HADA_OK;
    if (*parts)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "'%s' names a part of a device, and the options name one as well",
                         words);
    *colon = '\0';
    *part = first;
    *parts = all;
    if (first < 1 || all < 1 || first > all)
        return hada_fail(err, HADA_ERROR_DEVICE_CHOICE,
                         "':%d/%d' is no part of a device: give the part, from 1 on, and the number of parts", first,
                         all);
    return HADA_OK;
}

static hada_status no_device(hada_error *err)
{
    return hada_fail(err, HADA_ERROR_NO_DEVICE,
                     "no OpenCL device was found; install a driver for your GPU or FPGA, or run on the CPU with PoCL "
                     "(Debian and Ubuntu: apt-get install pocl-opencl-icd). If one is installed, check OCL_ICD_VENDORS "
                     "and that POCL_CACHE_DIR, when set, can be written");
}

hada_status hada_platform_devices(hada_platform_device **out, size_t *count, hada_error *err)
{
    cl_uint platforms = 0;
    *out = NULL;
    *count = 0;
    /* the ICD loader answers CL_PLATFORM_NOT_FOUND_KHR when no driver is installed */
    if (clGetPlatformIDs(0, NULL, &platforms) != CL_SUCCESS || !platforms)
        return no_device(err);
    cl_platform_id *ids;
    hada_status status = HADA_OK;
    HADA_TRY(HADA_NEW(ids, platforms, "the list of platforms", err));
    hada_platform_device *devices = NULL;
    size_t n = 0;
    if (clGetPlatformIDs(platforms, ids, NULL) != CL_SUCCESS)
        platforms = 0;
    for (cl_uint p = 0; p < platforms; p++) {
        cl_uint here = 0;
        /* Mesa's Clover is listed without devices when it has no GPU: skip it */
        if (clGetDeviceIDs(ids[p], CL_DEVICE_TYPE_ALL, 0, NULL, &here) != CL_SUCCESS || !here)
            continue;
        cl_device_id *found = NULL;
        HADA_TRY_OR_DONE(HADA_GROW(devices, n, here, "the list of devices", err));
        HADA_TRY_OR_DONE(HADA_NEW(found, here, "the list of devices", err));
        if (clGetDeviceIDs(ids[p], CL_DEVICE_TYPE_ALL, here, found, NULL) == CL_SUCCESS)
            for (cl_uint d = 0; d < here; d++)
                devices[n++] = (hada_platform_device){ids[p], found[d]};
        free(found);
    }
    if (!n)
        HADA_TRY_OR_DONE(no_device(err));
    *out = devices;
    *count = n;
    devices = NULL;
done:
    HADA_FREE(ids, devices);
    return status;
}

/* A device that is asked, and what became of it. A question that it does not know is none of our concern; one that it
 * had no memory to answer is, for what it says decides how results are rounded. */
typedef struct asked {
    cl_device_id device;
    cl_int failed;
} asked;

static cl_int ask(asked *of, cl_device_info what, size_t size, void *answer)
{
    const cl_int code = clGetDeviceInfo(of->device, what, size, answer, NULL);
    if (hada_cl_is_memory(code))
        of->failed = code;
    return code;
}

static void text(asked *of, cl_device_info what, char *out, size_t size)
{
    char buffer[1024] = "";
    ask(of, what, sizeof buffer - 1, buffer);
    const char *start = buffer + strspn(buffer, " ");
    snprintf(out, size, "%s", start);
}

/* 0 if the device does not know the query. */
static cl_ulong number(asked *of, cl_device_info what, size_t size)
{
    union {
        cl_uint u;
        cl_ulong ul;
        size_t s;
    } value = {.ul = 0};
    if (ask(of, what, sizeof value, &value) != CL_SUCCESS)
        return 0;
    return size == sizeof(cl_uint) ? value.u : value.ul;
}

/* Numbers without which nothing can be planned. */
static hada_status check_answers(const hada_device_info *info, hada_error *err)
{
    if (info->compute_units && info->memory_bytes && info->max_allocation_bytes && info->max_work_group)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_DEVICE,
                     "device %d (%s) does not say how many units (%u), how much memory (%llu bytes, %llu in one piece) "
                     "and what work-groups (%zu) it has: its driver is at fault; update it or take it out of "
                     "/etc/OpenCL/vendors",
                     info->index, info->name, info->compute_units, (unsigned long long)info->memory_bytes,
                     (unsigned long long)info->max_allocation_bytes, info->max_work_group);
}

hada_status hada_device_describe(cl_platform_id platform, cl_device_id device, int index, hada_device_info *info,
                                 hada_error *err)
{
    asked of = {.device = device};
    *info = (hada_device_info){.index = index};
    cl_device_type type = 0;
    cl_int code = ask(&of, CL_DEVICE_TYPE, sizeof type, &type);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clGetDeviceInfo");
    info->kind = type & CL_DEVICE_TYPE_GPU           ? HADA_DEVICE_GPU
                 : type & CL_DEVICE_TYPE_ACCELERATOR ? HADA_DEVICE_ACCELERATOR
                 : type & CL_DEVICE_TYPE_CPU         ? HADA_DEVICE_CPU
                                                     : HADA_DEVICE_OTHER;
    text(&of, CL_DEVICE_NAME, info->name, sizeof info->name);
    text(&of, CL_DEVICE_VENDOR, info->vendor, sizeof info->vendor);
    text(&of, CL_DRIVER_VERSION, info->driver, sizeof info->driver);
    text(&of, CL_DEVICE_VERSION, info->version, sizeof info->version);
    clGetPlatformInfo(platform, CL_PLATFORM_NAME, sizeof info->platform - 1, info->platform, NULL);
    info->compute_units = (unsigned)number(&of, CL_DEVICE_MAX_COMPUTE_UNITS, sizeof(cl_uint));
    info->clock_mhz = (unsigned)number(&of, CL_DEVICE_MAX_CLOCK_FREQUENCY, sizeof(cl_uint));
    info->memory_bytes = number(&of, CL_DEVICE_GLOBAL_MEM_SIZE, sizeof(cl_ulong));
    info->max_allocation_bytes = number(&of, CL_DEVICE_MAX_MEM_ALLOC_SIZE, sizeof(cl_ulong));
    info->local_memory_bytes = number(&of, CL_DEVICE_LOCAL_MEM_SIZE, sizeof(cl_ulong));
    info->max_work_group = (size_t)number(&of, CL_DEVICE_MAX_WORK_GROUP_SIZE, sizeof(size_t));
    info->alignment_bytes = (unsigned)number(&of, CL_DEVICE_MEM_BASE_ADDR_ALIGN, sizeof(cl_uint)) / 8;
    info->has_compiler = number(&of, CL_DEVICE_COMPILER_AVAILABLE, sizeof(cl_uint)) != 0;
    info->has_local_memory = number(&of, CL_DEVICE_LOCAL_MEM_TYPE, sizeof(cl_uint)) == CL_LOCAL;
    info->unified_memory = number(&of, CL_DEVICE_HOST_UNIFIED_MEMORY, sizeof(cl_uint)) != 0;
    /* NVIDIA's driver offers one part and no way to make it */
    cl_device_partition_property ways[16] = {0};
    if (ask(&of, CL_DEVICE_PARTITION_PROPERTIES, sizeof ways, ways) == CL_SUCCESS && ways[0])
        info->max_sub_devices = (unsigned)number(&of, CL_DEVICE_PARTITION_MAX_SUB_DEVICES, sizeof(cl_uint));
    info->has_double = number(&of, CL_DEVICE_DOUBLE_FP_CONFIG, sizeof(cl_ulong)) != 0;
    char extensions[8192] = "";
    ask(&of, CL_DEVICE_EXTENSIONS, sizeof extensions - 1, extensions);
    if (of.failed)
        return hada_fail_cl(err, of.failed, "clGetDeviceInfo");
    info->has_half_arithmetic = strstr(extensions, "cl_khr_fp16") != NULL;
    hada_quirks quirks;
    hada_quirks_find(info, &quirks);
    return check_answers(info, err);
}

struct hada_device_list {
    size_t count;
    hada_device_info infos[];
};

hada_status hada_device_list_create(hada_device_list **out, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_platform_device *devices = NULL;
    hada_device_list *list = NULL;
    size_t count;
    HADA_NEED(out, err);
    *out = NULL;
    HADA_TRY_OR_DONE(hada_platform_devices(&devices, &count, err));
    HADA_TRY_OR_DONE(
        hada_allocated(list = hada_alloc(1, sizeof *list + count * sizeof *list->infos, "the list of devices", err)));
    list->count = count;
    for (size_t i = 0; i < count; i++)
        HADA_TRY_OR_DONE(hada_device_describe(devices[i].platform, devices[i].device, (int)i, &list->infos[i], err));
    *out = list;
    list = NULL;
done:
    HADA_FREE(devices, list);
    return status;
}

size_t hada_device_list_count(const hada_device_list *list)
{
    return list ? list->count : 0;
}

const hada_device_info *hada_device_list_get(const hada_device_list *list, size_t index)
{
    return list ? (index < list->count ? &list->infos[index] : NULL) : NULL;
}

void hada_device_list_destroy(hada_device_list **list)
{
    free(hada_taken(list));
}

/* Which device the user's words mean. */

static int first_of_kind(const hada_device_info *infos, size_t count, hada_device_kind kind, size_t *out)
{
    for (size_t i = 0; i < count; i++)
        if (infos[i].kind == kind) {
            *out = i;
            return 1;
        }
    return 0;
}

static hada_status unknown_device(const hada_device_info *infos, size_t count, const char *words, hada_error *err)
{
    char list[700] = "";
    size_t used = 0;
    for (size_t i = 0; i < count && used < sizeof list; i++) {
        int n = snprintf(list + used, sizeof list - used, "%s%zu (%s, %s)", i ? "; " : "", i,
                         hada_enum_name(HADA_ENUM_DEVICE_KIND, (int)infos[i].kind), infos[i].name);
        used += n > 0 ? (size_t)n : 0;
    }
    return hada_fail(err, HADA_ERROR_DEVICE_CHOICE,
                     "no device matches '%s'; give an index, cpu, gpu, accelerator, or a part of a name. There are: %s",
                     words, list);
}

hada_status hada_device_choose(const hada_device_info *infos, size_t count, const char *words, int have_binaries,
                               size_t *out, hada_error *err)
{
    if (!words || !*words) {
        if (first_of_kind(infos, count, HADA_DEVICE_GPU, out) ||
            (have_binaries && first_of_kind(infos, count, HADA_DEVICE_ACCELERATOR, out)) ||
            first_of_kind(infos, count, HADA_DEVICE_CPU, out))
            return HADA_OK;
        *out = 0;
        return HADA_OK;
    }
    char *end;
    long index = strtol(words, &end, 10);
    if (!*end) {
        if (index < 0 || (size_t)index >= count)
            return unknown_device(infos, count, words, err);
        *out = (size_t)index;
        return HADA_OK;
    }
    for (int kind = HADA_DEVICE_CPU; kind <= HADA_DEVICE_OTHER; kind++)
        if (!strcasecmp(words, hada_enum_name(HADA_ENUM_DEVICE_KIND, kind)))
            return first_of_kind(infos, count, (hada_device_kind)kind, out) ? HADA_OK
                                                                            : unknown_device(infos, count, words, err);
    for (size_t i = 0; i < count; i++)
        if (strcasestr(infos[i].name, words) || strcasestr(infos[i].platform, words) ||
            strcasestr(infos[i].vendor, words)) {
            *out = i;
            return HADA_OK;
        }
    return unknown_device(infos, count, words, err);
}

/* What is done differently on which device, and why: data, in one place. Rows add up; a row applies when its word is in
 * the name of the device's platform or vendor and its kind fits. */

typedef struct quirk_row {
    const char *platform; /* NULL: any */
    int kind;             /* hada_device_kind, 0: any */
    hada_quirks set;
    const char *reason;
} quirk_row;

static const quirk_row rows[] = {
    {NULL,
     HADA_DEVICE_CPU,
     {.host_pages = 1},
     "buffers in huge-page host memory: large transforms run up to 1.6 times faster"},
    {"Portable Computing Language",
     0,
     {.own_disk_cache = 1},
     "PoCL caches what it compiles itself, and compiles all again for a binary: our disk cache stays off"},
    {"NVIDIA",
     HADA_DEVICE_GPU,
     {.own_disk_cache = 1, .no_parts = 1},
     "the driver caches programs itself and its binary is PTX: our disk cache stays off; it has crashed at the release of "
     "parts of buffers: working memory is not shared between steps"},
    {"Oclgrind",
     0,
     {.avoid_clfft = 1, .own_disk_cache = 1},
     "clFFT shows formal races under Oclgrind and its binaries are not kept: own transforms, no cache"},
    {"rusticl", 0, {.avoid_clfft = 1}, "own transforms: clFFT is not tested on Mesa"},
    {"Clover", 0, {.avoid_clfft = 1}, "own transforms: clFFT is not tested on Mesa"},
    {NULL,
     HADA_DEVICE_ACCELERATOR,
     {.avoid_clfft = 1, .stated_local = 1},
     "clFFT writes source at run time, which an FPGA cannot compile: own transforms; compilers for FPGAs lay local memory "
     "out: at most 64 KiB of it is used"},
};

static int applies(const quirk_row *row, const hada_device_info *info)
{
    return (!row->platform || strstr(info->platform, row->platform) || strstr(info->vendor, row->platform)) &&
           (!row->kind || row->kind == (int)info->kind);
}

void hada_quirks_find(hada_device_info *info, hada_quirks *quirks)
{
    size_t used = 0;
    *quirks = (hada_quirks){0};
    info->quirks[0] = '\0';
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const quirk_row *row = &rows[i];
        if (!applies(row, info))
            continue;
        quirks->own_disk_cache |= row->set.own_disk_cache;
        quirks->avoid_clfft |= row->set.avoid_clfft;
        quirks->host_pages |= row->set.host_pages;
        quirks->stated_local |= row->set.stated_local;
        quirks->no_parts |= row->set.no_parts;
        int n = snprintf(info->quirks + used, sizeof info->quirks - used, "%s%s", used ? "; " : "", row->reason);
        used += n > 0 && (size_t)n < sizeof info->quirks - used ? (size_t)n : 0;
    }
}
