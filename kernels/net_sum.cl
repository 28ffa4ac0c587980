/* Sums of many floats, always in the same order. */

#include "shared_net.h"

/* out[i] = scale * the sum of run i of HADA_SUM_RUN floats. The last call of a sum has one run. */
__kernel void net_sum(__global const float *in, __global float *out, ulong in_offset, ulong out_offset, uint in_count,
                      float scale)
{
    const uint run = get_global_id(0), first = run * HADA_SUM_RUN;
    if (first >= in_count)
        return;
    const uint count = min(in_count - first, (uint)HADA_SUM_RUN);
    __global const float *from = in + in_offset + first;
    float8 lanes = 0.0f;
    uint i = 0;
    for (; i + 8 <= count; i += 8)
        lanes += vload8(0, from + i);
    const float4 a = lanes.lo + lanes.hi;
    float sum = (a.x + a.z) + (a.y + a.w);
    for (; i < count; i++)
        sum += from[i];
    out[out_offset + run] = scale * sum;
}
