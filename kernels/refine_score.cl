/* How badly a set explains what the channels have in common, within a band: partial[set][slice] is the sum, over the
 * frequencies of the whole spectrum with 2 |ky| < band_rows and 2 |kx| < band_cols, of
 *     (|mean rest|^2 + mean(prior sum |U|^2) / channels) / (1 + mean(sum doubt |U|^2)),     rest = B - sum H U,
 * means over channels, sums over the set's depths; prior and doubt are 0 where they are not given. With depths 0 it is
 * the energy of the frame's own mean. Dimensions: slices of frequencies, sets. Arrays as in refine_solve; doubt as the
 * OTFs, real. */
#include "inc_refine.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_score(__global const float *otf, ulong otf_offset, __global const int *list, int depths,
             __global const float *data, ulong data_offset, __global const float *now_u, __global const float *prior,
             int has_prior, __global const float *doubt, int has_doubt, uint channels, uint count, uint slice,
             uint rows, uint block, uint cols, uint band_rows, uint band_cols, __global float *partial)
{
    REFINE_LOCAL
    const uint set = get_global_id(1);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    __global const int *z = list + set * (uint)depths;
    const float share = 1.0f / (float)channels;
    refine_real sum = (refine_real)0.0f;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        const uint ky = i / block % rows; /* the same for all lanes: vectors need blocks of eight columns */
        if (2 * min(ky, rows - ky) >= band_rows || 2 * (i / (rows * block) * block + i % block) >= band_cols)
            continue;
        refine_real r_re = (refine_real)0.0f, r_im = r_re, cost = r_re, unsure = r_re;
        for (uint c = 0; c < channels; ++c) {
            refine_real b_re, b_im, power = (refine_real)0.0f;
            refine_get(data + 2 * (data_offset + (size_t)c * count), i, &b_re, &b_im);
            r_re += b_re;
            r_im += b_im;
            for (int s = 0; s < depths; ++s) {
                const size_t at = ((size_t)z[s] * channels + c) * count;
                refine_real h_re, h_im, u_re, u_im;
                refine_get(otf + 2 * (otf_offset + at), i, &h_re, &h_im);
                refine_get(now_u + 2 * (((size_t)set * (uint)depths + (uint)s) * channels + c) * count, i, &u_re,
                           &u_im);
                r_re = fma(-h_re, u_re, fma(h_im, u_im, r_re));
                r_im = fma(-h_re, u_im, fma(-h_im, u_re, r_im));
                const refine_real square = fma(u_re, u_re, u_im * u_im);
                power += square;
                if (has_doubt)
                    unsure = fma(refine_get_real(doubt + at, i), square, unsure);
            }
            if (has_prior)
                cost = fma(refine_get_real(prior + (size_t)c * count, i), power, cost);
        }
        const refine_real energy = (fma(r_re, r_re, r_im * r_im) + cost) * (share * share) / fma(unsure, share, 1.0f);
        sum += refine_count(refine_band(energy, i, rows, block, band_cols), i, rows, block, cols);
    }
    REFINE_PARTIAL(partial, ((size_t)set * get_num_groups(0) + get_group_id(0)), refine_sum(sum))
}
