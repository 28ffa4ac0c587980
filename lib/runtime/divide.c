/* Parts of a device, as devices of their own. They are made once and stay: PoCL's threads look at the device of a
 * command after whoever waited for it was called, so that a part that is given back then is read after it is gone. */
#include <pthread.h>

#include "runtime/context.h"

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
