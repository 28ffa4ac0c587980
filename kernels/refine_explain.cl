/* What the planes of a set do not explain: rest[set][channel] = B - sum over its depths of H U, at every frequency, and
 * as partial[set][channel][slice] the sum over the whole spectrum of |rest|^2. Arguments as in refine_solve. */
#include "inc_refine.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_explain(__global const float *otf, ulong otf_offset, __global const int *list, int depths,
               __global const float *data, ulong data_offset, __global const float *now_u,
               __global float *rest, int has_rest, uint count, uint slice, uint rows, uint block, uint cols,
               __global float *partial)
{
    REFINE_LOCAL
    const uint channel = get_global_id(1), channels = get_global_size(1), set = get_global_id(2);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    const size_t plane = (size_t)set * channels + channel;
    __global const float *h = otf + 2 * (otf_offset + (size_t)channel * count);
    __global const float *b = data + 2 * (data_offset + (size_t)channel * count);
    __global const float *u = now_u + 2 * ((size_t)set * (size_t)depths * channels + channel) * count;
    __global const int *z = list + set * (uint)depths;
    refine_real sum = (refine_real)0.0f;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real r_re, r_im;
        refine_get(b, i, &r_re, &r_im);
        for (int s = 0; s < depths; ++s) {
            refine_real h_re, h_im, u_re, u_im;
            refine_get(h + 2 * (size_t)z[s] * channels * count, i, &h_re, &h_im);
            refine_get(u + 2 * (size_t)s * channels * count, i, &u_re, &u_im);
            r_re = fma(-h_re, u_re, fma(h_im, u_im, r_re));
            r_im = fma(-h_re, u_im, fma(-h_im, u_re, r_im));
        }
        sum += refine_count(fma(r_re, r_re, r_im * r_im), i, rows, block, cols);
        if (has_rest)
            refine_put(rest + 2 * plane * count, i, r_re, r_im);
    }
    REFINE_PARTIAL(partial, (plane * get_num_groups(0) + get_group_id(0)), refine_sum(sum))
}
