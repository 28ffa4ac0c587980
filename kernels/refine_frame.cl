/* The data step where a sensor crops: a (the split variable plus its dual, within the frame) becomes the dual
 *     e = scale (a - b),   scale = 1 / (1 + mu),
 * in place; b is the frame (use_frame 0: b is taken as 0, for plain energies). partial[plane][slice]: sum of e^2.
 * Dimensions: slices of pixels, planes; plane p belongs to channel p % channels of the frame. */
#include "inc_refine.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_frame(__global float *a, __global const float *frame, ulong frame_offset, int use_frame, uint channels,
             uint pixels, uint slice, float scale, __global float *partial,
             uint partial_first)
{
    REFINE_LOCAL
    const uint plane = get_global_id(1);
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    __global float *e = a + (size_t)plane * pixels;
    __global const float *b = frame + (use_frame ? frame_offset + (size_t)(plane % channels) * pixels : 0);
    float sum = 0.0f;
#if REFINE_WIDTH == 8
    float8 sums = (float8)0.0f;
    const uint whole = from + (to - from) / 8 * 8;
    for (uint i = from; i < whole; i += 8) {
        float8 v = vload8(0, e + i);
        if (use_frame)
            v -= vload8(0, b + i);
        v *= scale;
        vstore8(v, 0, e + i);
        sums = fma(v, v, sums);
    }
    sum = refine_sum(sums);
    for (uint i = whole; i < to; ++i) {
#else
    for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP) {
#endif
        const float v = (use_frame ? e[i] - b[i] : e[i]) * scale;
        e[i] = v;
        sum = fma(v, v, sum);
    }
    REFINE_PARTIAL(partial, (partial_first + (size_t)plane * get_num_groups(0) + get_group_id(0)), sum)
}
