#include "core/finite.h"
#include "core/base.h"

size_t hada_not_finite(const float *values, size_t count, float *largest)
{
    size_t broken = 0;
    uint32_t most = 0; /* patterns of positive floats rise with them, and compilers make vectors of this loop */
    for (size_t i = 0; i < count;) {
        const size_t end = count - i < 65536 ? count : i + 65536;
        uint32_t found = 0; /* of a width that makes as many lanes as the patterns' */
        for (; i < end; i++) {
            uint32_t bits;
            memcpy(&bits, &values[i], sizeof bits);
            bits &= 0x7fffffffu;
            const uint32_t finite = bits < 0x7f800000u;
            found += !finite;
            bits = finite ? bits : 0;
            most = bits > most ? bits : most;
        }
        broken += found;
    }
    memcpy(largest, &most, sizeof *largest);
    return broken;
}
