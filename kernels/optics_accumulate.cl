/* The forward model in the frequency domain: sum over depths of transfer function times scene spectrum. */
#include "inc_vectors.h"

/* sum[c] from `offset` (in complex numbers) (+)= otf[c % otf_images] * scene[c] for images c of `count` complex numbers
 * each; `add` 0 starts the sum. A work-item takes four complex numbers of one image; items beyond the end do nothing.
 */
__kernel void optics_accumulate(__global float *sum, const ulong offset, __global const float *otf,
                                __global const float *scene, const int count, const int otf_images, const int add)
{
    const int item = get_global_id(0), c = get_global_id(1), first = 4 * item;
    if (first >= count)
        return;
    sum += 2 * (offset + (size_t)c * count);
    scene += 2 * (size_t)c * count;
    otf += 2 * (size_t)(c % otf_images) * count;
    if (first + 4 <= count) {
        const float8 h = vload8(item, otf), x = vload8(item, scene);
        float8 y = add ? vload8(item, sum) : (float8)(0.0f);
        y.even = fma(h.even, x.even, fma(-h.odd, x.odd, y.even));
        y.odd = fma(h.even, x.odd, fma(h.odd, x.even, y.odd));
        VECTORS_STORE8(__global, y, sum + 8 * (size_t)item);
        return;
    }
    for (int i = first; i < count; i++) {
        const float2 h = vload2(i, otf), x = vload2(i, scene);
        float2 y = add ? vload2(i, sum) : (float2)(0.0f);
        y.x = fma(h.x, x.x, fma(-h.y, x.y, y.x));
        y.y = fma(h.x, x.y, fma(h.y, x.x, y.y));
        vstore2(y, i, sum);
    }
}
