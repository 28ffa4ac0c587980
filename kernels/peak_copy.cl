/* The ceiling of a device's memory: out = in, nothing else. Each work-item copies `each` vectors, from
 * `apart * its number` on and `step` apart: a stretch of its own on a CPU, turn about with its neighbours on a GPU. */
#ifndef PEAK_WIDTH
#define PEAK_WIDTH 8
#endif
#define PEAK_JOIN(name, width) name##width
#define PEAK_LOAD(width)       PEAK_JOIN(vload, width)
#define PEAK_STORE(width)      PEAK_JOIN(vstore, width)

__kernel void peak_copy(__global const float *in, __global float *out, ulong each, ulong apart, ulong step, ulong count)
{
    const size_t first = get_global_id(0) * apart;
    for (size_t k = 0; k < each; k++) {
        const size_t at = first + k * step;
        if (at < count)
            PEAK_STORE(PEAK_WIDTH)(PEAK_LOAD(PEAK_WIDTH)(at, in), at, out);
    }
}
