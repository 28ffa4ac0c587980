/* The peak memory rate of a device: out = in. Each work-item copies `each` vectors, from `apart * its number` on and
 * `step` apart: a contiguous stretch on a CPU, interleaved with its neighbours on a GPU. */
#ifndef PEAK_WIDTH
#define PEAK_WIDTH 8
#endif
/* vectors lie at multiples of their size: vload says of floats alone, and compilers then split it */
#define PEAK_JOIN(width) float##width
#define PEAK_OF(width)   PEAK_JOIN(width)
typedef PEAK_OF(PEAK_WIDTH) peak_v;

__kernel void peak_copy(__global const float *in, __global float *out, ulong each, ulong apart, ulong step, ulong count)
{
    const size_t first = get_global_id(0) * apart;
    for (size_t k = 0; k < each; k++) {
        const size_t at = first + k * step;
        if (at < count)
            ((__global peak_v *)out)[at] = ((__global const peak_v *)in)[at];
    }
}
