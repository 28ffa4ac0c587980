#include "image/stored.h"

#include <stdint.h>
#include <string.h>

/* Full scales of 8 and 16 bits, of cameras of 10, 12 and 14 bits, and numbers as they are. */
static const hada_stored known[] = {{1, 255.0f}, {2, 65535.0f}, {2, 1023.0f}, {2, 4095.0f}, {2, 16383.0f}, {2, 1.0f}};

/* Values between two looks at whether all came back: what cannot be stored is known soon. */
enum { CHUNK = 1024 };

static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* The loop is written once; each type gets its own compiled copy. Integers divide in float, where both numbers are
 * exact, as wherever they are read (image/pixels.c, io/tiff_sample.c); what is no number is stored as 0. */
#define PACK(type, most)                                                                                               \
    do {                                                                                                               \
        type *to = out;                                                                                                \
        for (size_t i = 0; i < count; i++) {                                                                           \
            const float scaled = values[i] * scale, within = scaled >= 0.0f ? scaled : 0.0f;                           \
            const int number = (int)((within < (most) ? within : (most)) + 0.5f);                                      \
            to[i] = (type)number;                                                                                      \
            lost |= bits_of((float)number / scale) ^ bits_of(values[i]);                                               \
        }                                                                                                              \
    } while (0)

/* Returns whether every value comes back. */
static int pack(const float *values, size_t count, void *out, const hada_stored *stored)
{
    const float scale = stored->scale;
    uint32_t lost = 0;
    if (stored->bytes == 1)
        PACK(uint8_t, 255.0f);
    else
        PACK(uint16_t, 65535.0f);
    return !lost;
}

static int pack_all(const float *values, size_t count, unsigned char *out, const hada_stored *stored)
{
    for (size_t first = 0; first < count; first += CHUNK) {
        const size_t some = count - first < CHUNK ? count - first : CHUNK;
        if (!pack(values + first, some, out + first * (size_t)stored->bytes, stored))
            return 0;
    }
    return 1;
}

void hada_stored_pack(const float *values, size_t count, void *out, hada_stored *stored)
{
    if ((stored->bytes == 1 || stored->bytes == 2) && pack_all(values, count, out, stored))
        return;
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (pack_all(values, count, out, &known[i])) {
            *stored = known[i];
            return;
        }
    memcpy(out, values, count * sizeof *values);
    *stored = (hada_stored){4, 1.0f};
}
