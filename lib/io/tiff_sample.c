#include "io/tiff_sample.h"

#include <string.h>

#include "io/safetensors.h"

/* The loop is written once; each type gets its own compiled copy. 8 and 16 bits divide in float, which is correctly
 * rounded, since both numbers are exact there; 32 bits divide in double. */
#define ROW(type, work, divisor)                                                                                       \
    do {                                                                                                               \
        const type *from = (const type *)row + first;                                                                  \
        const work by = (work)(divisor);                                                                               \
        for (size_t i = 0; i < count; i++)                                                                             \
            out[i] = (float)((work)from[i * stride] / by);                                                             \
    } while (0)

/* Numbers of fewer than 8, or of 9 to 15 bits stand packed, highest bit first. */
static void packed(const hada_tiff_page *page, const unsigned char *row, size_t first, size_t stride, size_t count,
                   float by, float *out)
{
    size_t bits = (size_t)page->bits;
    for (size_t i = 0; i < count; i++) {
        size_t at = (first + i * stride) * bits;
        unsigned value = 0;
        for (size_t b = 0; b < bits; b++, at++)
            value = value << 1 | (row[at >> 3] >> (7 - (at & 7)) & 1u);
        out[i] = (float)value / by;
    }
}

static void floats(const hada_tiff_page *page, const void *row, size_t first, size_t stride, size_t count, float *out)
{
    if (page->bits == 32) {
        const float *from = (const float *)row + first;
        if (stride == 1)
            memcpy(out, from, count * sizeof *out);
        for (size_t i = 0; stride != 1 && i < count; i++)
            out[i] = from[i * stride];
    } else if (page->bits == 64) {
        const double *from = (const double *)row + first;
        for (size_t i = 0; i < count; i++)
            out[i] = (float)from[i * stride];
    } else {
        const uint16_t *from = (const uint16_t *)row + first;
        for (size_t i = 0; i < count; i++)
            out[i] = hada_float_from_half(from[i * stride]);
    }
}

void hada_tiff_samples(const hada_tiff_page *page, const void *row, size_t first, size_t stride, size_t count,
                       float *out)
{
    double scale = page->palette ? 1 : page->scale;
    if (page->is_float)
        floats(page, row, first, stride, count, out);
    else if (page->bits == 8 && page->is_signed)
        ROW(int8_t, float, scale);
    else if (page->bits == 8)
        ROW(uint8_t, float, scale);
    else if (page->bits == 16 && page->is_signed)
        ROW(int16_t, float, scale);
    else if (page->bits == 16)
        ROW(uint16_t, float, scale);
    else if (page->bits == 32 && page->is_signed)
        ROW(int32_t, double, scale);
    else if (page->bits == 32)
        ROW(uint32_t, double, scale);
    else
        packed(page, row, first, stride, count, (float)scale, out);
    if (page->inverted)
        for (size_t i = 0; i < count; i++)
            out[i] = 1.0f - out[i];
}
