/* Known answers: does this device add integers across a work-group, keep float vectors apart, and convert half? */
#include "shared_local.h"

/* out[g] = sum of the group's integers, by a tree in local memory with a barrier at every step. */
__kernel void selftest_sum(__global const int *in, __global int *out, __local STATED_SIZE int *part)
{
    const int i = get_local_id(0), n = get_local_size(0);
    part[i] = in[get_global_id(0)];
    for (int step = 1; step < n; step *= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        const int other = i % (2 * step) == 0 && i + step < n ? part[i + step] : 0;
        barrier(CLK_LOCAL_MEM_FENCE);
        part[i] += other;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (i == 0)
        out[get_group_id(0)] = part[0];
}

/* A complex product in vector lanes, as the filters use it: exact for small integers. */
__kernel void selftest_product(__global const float *a, __global const float *b, __global float *out)
{
    const size_t i = get_global_id(0);
    const float8 x = vload8(i, a), y = vload8(i, b);
    float8 z;
    z.even = x.even * y.even - x.odd * y.odd;
    z.odd = x.even * y.odd + x.odd * y.even;
    vstore8(z, i, out);
}

/* Half as storage: out = in, through half. */
__kernel void selftest_half(__global const float *in, __global half *middle, __global float *out)
{
    const size_t i = get_global_id(0);
    vstore_half_rte(in[i], i, middle);
    out[i] = vload_half(i, middle) + (float)get_local_size(0) * 0.0f;
}
