/* Results: made to measure, kept from frame to frame. */
#include "engine/result.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

static int same_size(const hada_image *image, int channels, int rows, int cols)
{
    return image->data && image->channels == channels && image->rows == rows && image->cols == cols;
}

static hada_status fit_image(hada_image *image, int channels, int rows, int cols, hada_error *err)
{
    if (same_size(image, channels, rows, cols))
        return HADA_OK;
    hada_image_destroy(image);
    return hada_image_create(image, channels, rows, cols, err);
}

hada_status hada_result_fit(hada_result *result, const hada_model_info *info, int depths, hada_error *err)
{
    const int channels = info->channels, rows = info->window_rows, cols = info->window_cols;
    hada_status status = HADA_OK;
    if (result->depths != depths) {
        hada_result_destroy(result);
        HADA_TRY(hada_alloc((void **)&result->distances_mm, (size_t)depths, sizeof(double), "the result", err));
        HADA_TRY(hada_alloc((void **)&result->planes, (size_t)depths, sizeof *result->planes, "the result", err));
        HADA_TRY(hada_alloc((void **)&result->report.occupied, (size_t)depths, 1, "the result", err));
        result->depths = depths;
    }
    for (int z = 0; z < depths; z++)
        HADA_TRY(fit_image(&result->planes[z], channels, rows, cols, err));
    HADA_TRY(fit_image(&result->all_in_focus, channels, rows, cols, err));
    HADA_TRY(fit_image(&result->distance_map, 1, rows, cols, err));
done:
    if (status)
        hada_result_destroy(result);
    return status;
}

static void copy_image(hada_image *to, const hada_image *from)
{
    memcpy(to->data, from->data, hada_image_count(from) * sizeof *from->data);
}

hada_status hada_result_copy(hada_result *to, const hada_result *from, const hada_model_info *info, hada_error *err)
{
    hada_status status = hada_result_fit(to, info, from->depths, err);
    if (status)
        return status;
    unsigned char *occupied = to->report.occupied;
    memcpy(occupied, from->report.occupied, (size_t)from->depths);
    to->report = from->report;
    to->report.occupied = occupied;
    memcpy(to->distances_mm, from->distances_mm, (size_t)from->depths * sizeof *to->distances_mm);
    for (int z = 0; z < from->depths; z++)
        copy_image(&to->planes[z], &from->planes[z]);
    copy_image(&to->all_in_focus, &from->all_in_focus);
    copy_image(&to->distance_map, &from->distance_map);
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
    for (int z = 0; result->planes && z < result->depths; z++)
        hada_image_destroy(&result->planes[z]);
    hada_image_destroy(&result->all_in_focus);
    hada_image_destroy(&result->distance_map);
    free(result->planes);
    free(result->distances_mm);
    free(result->report.occupied);
    *result = (hada_result){0};
}
