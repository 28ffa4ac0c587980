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

/* Whether all values are from 0 to `most`: patterns of floats without sign rise with them, and all others are larger.
 */
static int within(const float *values, size_t count, float most)
{
    const uint32_t last = bits_of(most);
    uint32_t beyond = 0;
    for (size_t i = 0; i < count; i++)
        beyond |= bits_of(values[i]) > last;
    return !beyond;
}

/* The loop is written once; each type gets its own compiled copy. Integers divide in float, where both numbers are
 * exact, as wherever they are read (image/pixels.c, io/tiff_sample.c). Without branches: a frame on its way waits. */
#define PACK(to, most)                                                                                                 \
    for (size_t i = 0; i < count; i++) {                                                                               \
        const int number = (int)(values[i] * scale + 0.5f);                                                            \
        lost |= bits_of((float)number / scale) ^ bits_of(values[i]);                                                   \
        (to)[i] = number & (most);                                                                                     \
    }

/* Returns whether every value comes back. */
static int pack(const float *values, size_t count, void *out, const hada_stored *stored)
{
    const float scale = stored->scale;
    const int most = stored->bytes == 1 ? UINT8_MAX : UINT16_MAX;
    uint8_t *bytes = out;
    uint16_t *words = out;
    uint32_t lost = 0;
    if (!within(values, count, (float)most / scale))
        return 0;
    if (stored->bytes == 1)
        PACK(bytes, UINT8_MAX)
    else
        PACK(words, UINT16_MAX)
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
