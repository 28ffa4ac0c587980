#include "engine/repair.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

/* The square of a spectrum's largest value, `points` times the brightest pixel, stays a factor 4 below the largest
 * float, 2^128; the square of the least pixel, 2^-80, leaves 2^46 above the smallest normal one for filters and noise.
 */
static const double most_light = 0x1p63, least_light = 0x1p-40;

hada_status hada_frame_check_range(float largest, double points, hada_error *err)
{
    if ((largest > 0.0f && largest < least_light) || largest * points > most_light)
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "the frame's brightest pixel, %.2g, is too %s for single precision (%.2g to %.2g at this size); "
            "multiply frames, and those that the model is fitted with, by a number that brings white to "
            "about 1",
            (double)largest, largest < 1.0f ? "small" : "large", least_light, most_light / points);
    return HADA_OK;
}

static int by_value(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The median of the finite values, NaN where there is none. The array is sorted. */
static float median(float *values, size_t count)
{
    if (!count)
        return NAN;
    qsort(values, count, sizeof *values, by_value);
    return count % 2 ? values[count / 2] : 0.5f * (values[count / 2 - 1] + values[count / 2]);
}

static float neighbours_median(const float *plane, int rows, int cols, int row, int col)
{
    enum { REACH = 7 };
    float found[(2 * REACH + 1) * (2 * REACH + 1)];
    for (int reach = 1; reach <= REACH; reach++) {
        size_t n = 0;
        for (int r = row - reach; r <= row + reach; r++)
            for (int c = col - reach; c <= col + reach; c++)
                if (r >= 0 && r < rows && c >= 0 && c < cols && isfinite(plane[(size_t)r * (size_t)cols + (size_t)c]))
                    found[n++] = plane[(size_t)r * (size_t)cols + (size_t)c];
        if (n)
            return median(found, n);
    }
    return NAN;
}

static hada_status plane_median(const float *plane, size_t count, float *out, hada_error *err)
{
    float *finite = NULL;
    size_t n = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(finite = hada_alloc_raw(count, sizeof *finite, "repairing a frame", err)));
    for (size_t i = 0; i < count; i++)
        if (isfinite(plane[i]))
            finite[n++] = plane[i];
    *out = n ? median(finite, n) : 0.0f;
done:
    free(finite);
    return status;
}

static hada_status repair_plane(const float *before, float *after, int rows, int cols, hada_error *err)
{
    const size_t pixels = (size_t)rows * (size_t)cols;
    float whole = NAN; /* the plane's median, found when first needed */
    for (size_t i = 0; i < pixels; i++) {
        if (isfinite(before[i]))
            continue;
        const float value = neighbours_median(before, rows, cols, (int)(i / (size_t)cols), (int)(i % (size_t)cols));
        if (isnan(value) && isnan(whole))
            HADA_TRY(plane_median(before, pixels, &whole, err));
        after[i] = isnan(value) ? whole : value;
    }
    return HADA_OK;
}

hada_status hada_frame_repair(hada_image *frame, size_t *repaired, hada_error *err)
{
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    hada_image before = {0};
    hada_status status = HADA_OK;
    *repaired = hada_image_count_not_finite(frame);
    if (!*repaired)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(&before, frame->channels, frame->rows, frame->cols, err));
    memcpy(before.data, frame->data, hada_image_count(frame) * sizeof(float));
    for (size_t at = 0; at < pixels * (size_t)frame->channels; at += pixels)
        HADA_TRY_OR_DONE(repair_plane(before.data + at, frame->data + at, frame->rows, frame->cols, err));
done:
    hada_image_destroy(&before);
    return status;
}
