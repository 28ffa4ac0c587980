#include "engine/repair.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

hada_status hada_frame_check_range(const hada_image *frame, double points, hada_error *err)
{
    const size_t count = hada_image_count(frame);
    uint32_t most = 0; /* patterns of positive floats rise with them, and compilers make vectors of this loop */
    for (size_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, &frame->data[i], sizeof bits);
        bits &= 0x7fffffffu;
        bits = bits < 0x7f800000u ? bits : 0;
        most = bits > most ? bits : most;
    }
    float largest;
    memcpy(&largest, &most, sizeof largest);
    if ((largest > 0.0f && largest < 0x1p-40f) || largest * points > 0x1p63)
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "the frame's brightest pixel, %.2g, is too %s for single precision (%.2g to %.2g at this size); "
            "multiply frames, and those that the model is fitted with, by a number that brings white to "
            "about 1",
            (double)largest, largest < 1.0f ? "small" : "large", 0x1p-40, 0x1p63 / points);
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
    void *memory;
    hada_status status = hada_alloc_raw(&memory, count, sizeof(float), "repairing a frame", err);
    if (status)
        return status;
    float *finite = memory;
    size_t n = 0;
    for (size_t i = 0; i < count; i++)
        if (isfinite(plane[i]))
            finite[n++] = plane[i];
    *out = n ? median(finite, n) : 0.0f;
    free(memory);
    return HADA_OK;
}

hada_status hada_frame_repair(hada_image *frame, size_t *repaired, hada_error *err)
{
    size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    *repaired = hada_image_count_not_finite(frame);
    if (!*repaired)
        return HADA_OK;
    hada_image before = {0};
    hada_status status = hada_image_create(&before, frame->channels, frame->rows, frame->cols, err);
    if (status)
        return status;
    memcpy(before.data, frame->data, hada_image_count(frame) * sizeof(float));
    for (int channel = 0; !status && channel < frame->channels; channel++) {
        const float *plane = before.data + (size_t)channel * pixels;
        float whole = NAN; /* the plane's median, found when first needed */
        for (size_t i = 0; !status && i < pixels; i++) {
            if (isfinite(plane[i]))
                continue;
            float value = neighbours_median(plane, frame->rows, frame->cols, (int)(i / (size_t)frame->cols),
                                            (int)(i % (size_t)frame->cols));
            if (isnan(value)) {
                if (isnan(whole))
                    status = plane_median(plane, pixels, &whole, err);
                value = whole;
            }
            frame->data[(size_t)channel * pixels + i] = value;
        }
    }
    hada_image_destroy(&before);
    return status;
}
