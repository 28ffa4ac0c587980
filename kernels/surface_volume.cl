/* Steps of an accelerated proximal gradient for the planes, or the texture, that explain a frame
 * (lib/surface/volume.h).
 *
 * Spectra: complex [plane][channel][count]; planes of the window: float [plane][channel][area]; OTFs are stored
 * conjugate, as an inverse transform multiplies by them. */
#include "inc_refine.h"
#include "shared_volume.h"

/* Each OTF to its conjugate, in place. Dimensions: slices of all complex numbers. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void volume_conjugate(__global float *otf,
                                                                                         ulong offset, ulong count)
{
    const ulong from = (ulong)get_group_id(0) * HADA_VOLUME_SLICE;
    const ulong to = min(count, from + (ulong)HADA_VOLUME_SLICE);
    for (ulong i = from + get_local_id(0); i < to; i += REFINE_GROUP)
        otf[2 * (offset + i) + 1] = -otf[2 * (offset + i) + 1];
}

/* The residual's weight of each channel at every frequency: 1 / (mean over planes of |H|^2 + floor |H(0)|^2), |H(0)|^2
 * a mean likewise. The planes come in batches: all but the last (`all` is 0) leave sums over |H|^2 in `weight`, and
 * that of |H(0)|^2 in still[channel] as well. all: the number of planes. Dimensions: slices of frequencies, channels.
 */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_weights(__global const float *otf, ulong offset, __global float *weight, __global float *still,
               hada_volume_batch batch, uint all, float floor)
{
    const uint count = batch.spectrum.count, channel = get_global_id(1), planes = batch.planes;
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(count, from + (uint)HADA_VOLUME_SLICE);
    const size_t step = 2 * (size_t)batch.channels * count;
    __global const float *h = otf + 2 * (offset + (size_t)channel * count);
    __global float *w = weight + (size_t)channel * count;
    float least = 0.0f;
    if (all || !(get_group_id(0) || get_local_id(0))) {
        least = batch.add ? still[channel] : 0.0f;
        for (uint p = 0; p < planes; ++p)
            least = fma(h[p * step], h[p * step], least);
        if (!all)
            still[channel] = least;
    }
    least *= floor;
    for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP) {
        float sum = batch.add ? w[i] : 0.0f;
        for (uint p = 0; p < planes; ++p) {
            const float re = h[p * step + 2 * i], im = h[p * step + 2 * i + 1];
            sum = fma(re, re, fma(im, im, sum));
        }
        w[i] = all ? (float)all / (sum + least) : sum;
    }
}

/* sum[channel] = (or +=) sum over the planes of the batch of H U. Dimensions: slices of frequencies, channels. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_explain(__global const float *otf, ulong offset, __global const float *u, __global float *sum,
               hada_volume_batch batch)
{
    const uint count = batch.spectrum.count, channels = batch.channels, planes = batch.planes;
    const uint channel = get_global_id(1);
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(count, from + (uint)HADA_VOLUME_SLICE);
    const size_t step = 2 * (size_t)channels * count;
    __global const float *h = otf + 2 * (offset + ((size_t)batch.first * channels + channel) * count);
    __global const float *x = u + 2 * (size_t)channel * count;
    __global float *s = sum + 2 * (size_t)channel * count;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real s_re = (refine_real)0.0f, s_im = s_re;
        if (batch.add)
            refine_get(s, i, &s_re, &s_im);
        for (uint p = 0; p < planes; ++p) {
            refine_real h_re, h_im, x_re, x_im;
            refine_get(h + p * step, i, &h_re, &h_im);
            refine_get(x + p * step, i, &x_re, &x_im);
            s_re = fma(h_re, x_re, fma(h_im, x_im, s_re));
            s_im = fma(h_re, x_im, fma(-h_im, x_re, s_im));
        }
        refine_put(s, i, s_re, s_im);
    }
}

/* sum = sum - frame, and as partial[first + ...], [channel][slice], its energy over the whole spectrum; with weights,
 * times these after that. Dimensions as before. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_residual(__global float *sum, __global const float *frame, ulong frame_offset, __global const float *weight,
                int has_weight, hada_spectrum_shape spectrum, __global float *partial, uint first)
{
    REFINE_LOCAL
    const uint count = spectrum.count, channel = get_global_id(1);
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(count, from + (uint)HADA_VOLUME_SLICE);
    __global const float *b = frame + 2 * (frame_offset + (size_t)channel * count);
    __global const float *w = weight + (has_weight ? (size_t)channel * count : 0);
    __global float *s = sum + 2 * (size_t)channel * count;
    refine_real energy = (refine_real)0.0f;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real s_re, s_im, b_re, b_im;
        refine_get(s, i, &s_re, &s_im);
        refine_get(b, i, &b_re, &b_im);
        s_re -= b_re;
        s_im -= b_im;
        const refine_real p = has_weight ? refine_get_real(w, i) : (refine_real)1.0f;
        refine_put(s, i, s_re * p, s_im * p);
        energy += refine_count(fma(s_re, s_re, s_im * s_im), i, spectrum.rows, spectrum.block, spectrum.cols);
    }
    REFINE_PARTIAL(partial, (first + channel * get_num_groups(0) + get_group_id(0)), refine_sum(energy))
}

/* Spectra times their weights, in place. Dimensions: slices of frequencies, channels. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_weigh(__global float *sum, __global const float *weight, uint count)
{
    const uint channel = get_global_id(1);
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(count, from + (uint)HADA_VOLUME_SLICE);
    __global float *s = sum + 2 * (size_t)channel * count;
    __global const float *w = weight + (size_t)channel * count;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real re, im;
        const refine_real p = refine_get_real(w, i);
        refine_get(s, i, &re, &im);
        refine_put(s, i, re * p, im * p);
    }
}

/* What the weights of a frame's values leave of it, in place. given: `weights` are those of hada_refine_data, and the
 * frame is a residual of which saturated values that are reached keep nothing; mask takes what each value's weight is
 * then. Else the weights are those of such a mask. Dimensions: slices of values. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_mask(__global float *restrict frame, __global const float *restrict weights, __global float *restrict mask,
            int given, uint values)
{
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(values, from + (uint)HADA_VOLUME_SLICE);
    for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP) {
        const float residual = frame[i],
                    weight = given && weights[i] < 0.0f && residual >= 0.0f ? 0.0f : fabs(weights[i]);
        if (given)
            mask[i] = weight;
        frame[i] = residual * weight;
    }
}

/* A gradient step from y, in the gradient's place: g = allowed (y - length g). Dimensions: slices of values. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_descend(__global float *restrict g, __global const float *restrict y, __global const float *restrict allowed,
               int has_allowed, uint values, float length)
{
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(values, from + (uint)HADA_VOLUME_SLICE);
    for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP)
        g[i] = (has_allowed ? allowed[i] : 1.0f) * fma(-length, g[i], y[i]);
}

/* Momentum: y = v + momentum (v - u), u = v, where v = allowed max(0, the proximal point). Dimensions: slices of
 * values. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_advance(__global const float *restrict point, __global float *restrict u, __global float *restrict y,
               __global const float *restrict allowed, int has_allowed, uint values, float momentum)
{
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(values, from + (uint)HADA_VOLUME_SLICE);
    for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP) {
        const float v = (has_allowed ? allowed[i] : 1.0f) * max(point[i], 0.0f);
        y[i] = fma(momentum, v - u[i], v);
        u[i] = v;
    }
}

/* The share of a plane in a pixel at this depth, counted in planes: linear between two planes. */
REFINE_INLINE float volume_share(float depth, float plane)
{
    return max(0.0f, 1.0f - fabs(depth - plane));
}

/* The planes of the batch that a texture [channel][area] makes. Dimensions: slices of pixels, channels, planes. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_splat(__global const float *restrict depth, __global const float *restrict texture,
             __global float *restrict planes, hada_volume_splat splat)
{
    const uint area = splat.area, channel = get_global_id(1), place = get_global_id(2);
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(area, from + (uint)HADA_VOLUME_SLICE);
    const float plane = (float)(splat.first + place);
    __global const float *restrict t = texture + (size_t)channel * area;
    __global float *restrict x = planes + ((size_t)place * splat.channels + channel) * area;
    for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP)
        x[i] = volume_share(depth[i], plane) * t[i];
}

/* Its adjoint: texture = (or +=) sum over the planes of the batch of their shares. Dimensions: slices of pixels,
 * channels. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
volume_gather(__global const float *restrict depth, __global const float *restrict planes,
              __global float *restrict texture, hada_volume_splat splat)
{
    const uint area = splat.area, channel = get_global_id(1);
    const uint from = get_group_id(0) * HADA_VOLUME_SLICE, to = min(area, from + (uint)HADA_VOLUME_SLICE);
    __global float *restrict t = texture + (size_t)channel * area;
    if (!splat.add)
        for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP)
            t[i] = 0.0f;
    for (uint p = 0; p < splat.planes; ++p) {
        const float plane = (float)(splat.first + p);
        __global const float *restrict x = planes + ((size_t)p * splat.channels + channel) * area;
        for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP)
            t[i] = fma(volume_share(depth[i], plane), x[i], t[i]);
    }
}
