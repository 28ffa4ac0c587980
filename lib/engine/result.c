/* Results: made to measure, kept from frame to frame. */
#include "engine/frame.h"

#include "core/callers.h"

static int on_device(const hada_cl_arrays *device)
{
    return device->stack || device->all_in_focus || device->distance_map;
}

/* Empties a result; arrays of the caller's stay in use, and without any nothing is left to free. */
void hada_result_clear(hada_result *result)
{
    hada_result_memory *memory = result->memory;
    if (memory) {
        const hada_result_arrays *arrays = &memory->arrays;
        HADA_FREE(memory->stack, memory->occupied);
        hada_image_destroy(&memory->all_in_focus);
        hada_image_destroy(&memory->distance_map);
        hada_image_destroy(&memory->confidence);
        *memory = (hada_result_memory){.arrays = memory->arrays, .device = memory->device};
        if (!arrays->stack && !arrays->all_in_focus && !arrays->distance_map && !on_device(&memory->device)) {
            free(memory);
            memory = NULL;
        }
    }
    free((double *)result->distances_mm);
    free(result->planes);
    memset(result, 0, sizeof *result);
    result->memory = memory;
}

static hada_status make_memory(hada_result *result, hada_error *err)
{
    return result->memory ? HADA_OK : HADA_NEW(result->memory, 1, "the result", err);
}

/* Whether two pieces of memory share a byte. */
static int share(const void *a, size_t a_bytes, const void *b, size_t b_bytes)
{
    const uintptr_t x = (uintptr_t)a, y = (uintptr_t)b;
    return a && b && (x < y ? y - x < a_bytes : x - y < b_bytes);
}

int hada_result_overlaps(const hada_result *result, const void *data, size_t bytes)
{
    const hada_image *all = &result->all_in_focus, *map = &result->distance_map;
    const hada_result_arrays none = {0}, *arrays = result->memory ? &result->memory->arrays : &none;
    return share(data, bytes, arrays->stack, arrays->stack_count * sizeof(float)) ||
           share(data, bytes, arrays->all_in_focus, arrays->all_in_focus_count * sizeof(float)) ||
           share(data, bytes, arrays->distance_map, arrays->distance_map_count * sizeof(float)) ||
           share(data, bytes, all->data, hada_image_count(all) * sizeof(float)) ||
           share(data, bytes, map->data, hada_image_count(map) * sizeof(float)) ||
           (result->depths && share(data, bytes, result->planes[0].data,
                                    (size_t)result->depths * hada_image_count(&result->planes[0]) * sizeof(float)));
}

hada_status hada_result_use(hada_result *result, const hada_result_arrays *arrays, hada_error *err)
{
    hada_result_arrays own;
    HADA_NEED(result, err);
    HADA_TRY(HADA_OPTIONS_TAKE(&own, arrays, hada_result_arrays, err));
    const size_t stack = own.stack_count * sizeof(float), all = own.all_in_focus_count * sizeof(float),
                 map = own.distance_map_count * sizeof(float);
    if (share(own.stack, stack, own.all_in_focus, all) || share(own.stack, stack, own.distance_map, map) ||
        share(own.all_in_focus, all, own.distance_map, map))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "two of stack, all_in_focus and distance_map share memory: give each an array of its own");
    hada_result_clear(result);
    HADA_TRY(make_memory(result, err));
    result->memory->arrays = own;
    return HADA_OK;
}

hada_status hada_result_use_cl(hada_result *result, const hada_cl_arrays *arrays, hada_error *err)
{
    hada_cl_arrays own;
    HADA_NEED(result, err);
    HADA_TRY(HADA_OPTIONS_TAKE(&own, arrays, hada_cl_arrays, err));
    hada_result_clear(result);
    HADA_TRY(make_memory(result, err));
    result->memory->device = own;
    return HADA_OK;
}

int hada_result_on_device(const hada_result *result)
{
    return result->memory && on_device(&result->memory->device);
}

static hada_status check_array(const float *values, size_t count, size_t needed, const char *what, hada_error *err)
{
    return !values || count == needed
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_SIZE, "the caller's array for the %s holds %zu values; it must be %zu", what,
                           count, needed);
}

/* The caller's array, or an image of the result's own. */
static hada_status fit_image(hada_image *image, hada_image *own, float *callers, int channels, int rows, int cols,
                             hada_error *err)
{
    if (!callers)
        HADA_TRY(hada_image_create(own, channels, rows, cols, err));
    *image = (hada_image){channels, rows, cols, callers ? callers : own->data};
    return HADA_OK;
}

static int fits(const hada_result *result, const hada_model_info *info, int depths)
{
    return result->depths == depths && result->planes->channels == info->channels &&
           result->planes->rows == info->window_rows && result->planes->cols == info->window_cols;
}

hada_status hada_result_fit(hada_result *result, const hada_model_info *info, int depths, hada_error *err)
{
    const int channels = info->channels, rows = info->window_rows, cols = info->window_cols;
    const size_t map = (size_t)rows * (size_t)cols, plane = (size_t)channels * map;
    hada_status status = HADA_OK;
    if (fits(result, info, depths))
        return HADA_OK;
    hada_result_clear(result);
    HADA_TRY_OR_DONE(make_memory(result, err));
    hada_result_memory *memory = result->memory;
    const hada_result_arrays *arrays = &memory->arrays;
    HADA_TRY_OR_DONE(check_array(arrays->stack, arrays->stack_count, (size_t)depths * plane, "stack", err));
    HADA_TRY_OR_DONE(check_array(arrays->all_in_focus, arrays->all_in_focus_count, plane, "all-in-focus image", err));
    HADA_TRY_OR_DONE(check_array(arrays->distance_map, arrays->distance_map_count, map, "distance map", err));
    HADA_TRY_OR_DONE(HADA_NEW(result->distances_mm, (size_t)depths, "the result", err));
    HADA_TRY_OR_DONE(HADA_NEW(result->planes, (size_t)depths, "the result", err));
    HADA_TRY_OR_DONE(hada_allocated(memory->occupied = hada_alloc((size_t)depths, 1, "the result", err)));
    if (!arrays->stack)
        HADA_TRY_OR_DONE(HADA_NEW(memory->stack, (size_t)depths * plane, "the stack", err));
    for (int z = 0; z < depths; z++)
        result->planes[z] =
            (hada_image){channels, rows, cols, (arrays->stack ? arrays->stack : memory->stack) + (size_t)z * plane};
    HADA_TRY_OR_DONE(
        fit_image(&result->all_in_focus, &memory->all_in_focus, arrays->all_in_focus, channels, rows, cols, err));
    HADA_TRY_OR_DONE(fit_image(&result->distance_map, &memory->distance_map, arrays->distance_map, 1, rows, cols, err));
    result->depths = depths;
    hada_result_renew(result);
done:
    if (status)
        hada_result_clear(result);
    return status;
}

hada_status hada_result_make_confidence(hada_result *result, hada_error *err)
{
    hada_result_memory *memory = result->memory;
    const hada_image *map = &result->distance_map;
    if (!memory->confidence.data)
        HADA_TRY(hada_image_create(&memory->confidence, 1, map->rows, map->cols, err));
    memory->has_confidence = 1;
    return HADA_OK;
}

const hada_image *hada_result_confidence(const hada_result *result)
{
    if (!result)
        return NULL;
    const hada_result_memory *memory = result ? result->memory : NULL;
    return memory && memory->has_confidence ? &memory->confidence : NULL;
}

hada_report *hada_result_renew(hada_result *result)
{
    hada_result_memory *memory = result->memory;
    memory->skipped = (hada_skip_report){0};
    memory->has_confidence = 0;
    memory->report = (hada_report){.occupied = memory->occupied,
                                   .skipped = &memory->skipped,
                                   .residual_linear = NAN,
                                   .residual = NAN,
                                   .scene = HADA_SCENE_PLANES};
    result->report = &memory->report;
    return &memory->report;
}

static void copy_image(hada_image *to, const hada_image *from)
{
    memcpy(to->data, from->data, hada_image_count(from) * sizeof *from->data);
}

hada_status hada_result_copy(hada_result *to, const hada_result *from, const hada_model_info *info, hada_error *err)
{
    HADA_TRY(hada_result_fit(to, info, from->depths, err));
    hada_result_memory *memory = to->memory;
    memcpy(memory->occupied, from->memory->occupied, (size_t)from->depths);
    memory->skipped = from->memory->skipped;
    memory->report = from->memory->report;
    memory->report.occupied = memory->occupied;
    memory->report.skipped = &memory->skipped;
    memcpy((double *)to->distances_mm, from->distances_mm, (size_t)from->depths * sizeof *to->distances_mm);
    for (int z = 0; z < from->depths; z++)
        copy_image(&to->planes[z], &from->planes[z]);
    copy_image(&to->all_in_focus, &from->all_in_focus);
    copy_image(&to->distance_map, &from->distance_map);
    if (from->memory->has_confidence) {
        HADA_TRY(hada_result_make_confidence(to, err));
        copy_image(&memory->confidence, &from->memory->confidence);
    }
    return HADA_OK;
}

static void raise(hada_image *image, float gamma)
{
    const size_t count = hada_image_count(image);
    for (size_t i = 0; i < count; i++)
        image->data[i] = powf(fmaxf(image->data[i], 0.0f), gamma);
}

void hada_result_apply_gamma(hada_result *result, double gamma)
{
    if (gamma == 1.0)
        return;
    for (int z = 0; z < result->depths; z++)
        raise(&result->planes[z], (float)gamma);
    raise(&result->all_in_focus, (float)gamma);
}

void hada_result_destroy(hada_result *result)
{
    if (!result)
        return;
    hada_result_clear(result);
    free(result->memory);
    result->memory = NULL;
}
