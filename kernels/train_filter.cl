/* The gradient of Hadamard filters: adds scale m conj(B) G, or with TRAIN_SPLIT scale m (Re(B) Re(G), Im(B) Im(G)), for
 * spectra B of a frame and G of the gradient of a plane (docs/training.md). m, from `weights`, says how often a value of
 * the half spectrum stands in the whole one; where it is 0 (padding, which holds anything) nothing is added. */

#ifndef TRAIN_SPLIT
#define TRAIN_SPLIT 0
#endif

inline float16 train_add(float16 b, float16 g, float8 m, float16 sum)
{
    const int8 there = m > 0.0f;
#if TRAIN_SPLIT
    const float8 re = b.even * g.even, im = b.odd * g.odd;
#else
    const float8 re = fma(b.even, g.even, b.odd * g.odd), im = fma(b.even, g.odd, -(b.odd * g.even));
#endif
    sum.even = select(sum.even, fma(m, re, sum.even), there);
    sum.odd = select(sum.odd, fma(m, im, sum.odd), there);
    return sum;
}

/* Dimension 0: groups of eight of the `count` frequencies, dimension 1: channels. `offset`: complex numbers before B. */
__kernel void train_filter(__global const float *b, ulong offset, __global const float *g,
                           __global const float *weights, __global float *gradient, ulong count, float scale)
{
    const size_t first = 8 * get_global_id(0), at = get_global_id(1) * count + first;
    if (first >= count)
        return;
    __global const float *raw = b + 2 * (offset + at), *plane = g + 2 * at;
    __global float *to = gradient + 2 * at;
    if (first + 8 <= count) {
        const float8 m = scale * vload8(0, weights + first);
        vstore16(train_add(vload16(0, raw), vload16(0, plane), m, vload16(0, to)), 0, to);
        return;
    }
    /* the last frequencies may not fill a group, and the next channel follows */
    float lanes[4][16] = {{0.0f}};
    const size_t left = count - first;
    for (size_t i = 0; i < 2 * left; i++) {
        lanes[0][i] = raw[i];
        lanes[1][i] = plane[i];
        lanes[2][i] = to[i];
        lanes[3][i / 2] = scale * weights[first + i / 2];
    }
    vstore16(train_add(vload16(0, lanes[0]), vload16(0, lanes[1]), vload8(0, lanes[3]), vload16(0, lanes[2])), 0,
             lanes[2]);
    for (size_t i = 0; i < 2 * left; i++)
        to[i] = lanes[2][i];
}
