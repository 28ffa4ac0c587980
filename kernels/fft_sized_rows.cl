/* Transforms of FFT_POINTS points along rows: a group takes some pairs of rows of one image, FFT_ITEMS work-items a
 * pair, as one complex transform each. Memory is read and written by four points in a row, 128 bits an access. As
 * fft_group_rows.cl otherwise. */
#include "inc_fft_sized.h"
#include "shared_fft.h"

/* The row of FFT_ROW_SIZES of this length. */
#define FFT_ROW_ITEMS(n, r0, r1, r2, r3, i, w) (n == FFT_POINTS ? i : 0) +
#define FFT_ROW_WIDTH(n, r0, r1, r2, r3, i, w) (n == FFT_POINTS ? w : 0) +
enum {
    R1 = FFT_ROW_SIZES(FFT_RADIX1) 0,
    R2 = FFT_ROW_SIZES(FFT_RADIX2) 0,
    R3 = FFT_ROW_SIZES(FFT_RADIX3) 0,
    ITEMS = FFT_ROW_SIZES(FFT_ROW_ITEMS) 0,
    WIDTH = FFT_ROW_SIZES(FFT_ROW_WIDTH) 0,
    QUADS = FFT_POINTS / 16, /* butterflies of radix 4, four at a time */
    QUAD_ROUNDS = (QUADS + ITEMS - 1) / ITEMS,
    PAIR_ROUNDS = (FFT_POINTS / 4 + ITEMS - 1) / ITEMS, /* of frequencies below half the length, two at a time */
    PITCH = FFT_ROW_PLACES(FFT_POINTS)
};
#define FFT_ITEMS(radix) ITEMS
#define HELD(radix)      (FFT_ROUNDS(radix) * (radix))
#define ITEM             ((int)get_local_id(0) % ITEMS)

typedef char rounds_r1_fit[FFT_ROUNDS(R1) <= FFT_MOST_ROUNDS ? 1 : -1];
typedef char rounds_r2_fit[FFT_ROUNDS(R2) <= FFT_MOST_ROUNDS ? 1 : -1];

/* The place of a point in scratch. */
FFT_INLINE int place_of(int point)
{
    return point + point / FFT_ROW_BANK * 2;
}

/* That of base + step, step a constant. */
FFT_INLINE int place_after(int base, int step)
{
    return step % FFT_ROW_BANK ? place_of(base + step) : place_of(base) + place_of(step);
}

/* A butterfly's inputs from scratch, times their twiddle factors. */
FFT_INLINE void get_round(__local const float2 *scratch, int radix, int span, int round,
                          __global const float4 *twiddles, float *re, float *im)
{
    const int b = ITEM + round * ITEMS;
    twiddles += (uint)(b % span);
#define GET(k)                                                                                                         \
    if (k < radix) {                                                                                                   \
        const float2 v = scratch[place_after(b, k * FFT_BUTTERFLIES(radix))];                                          \
        re[k] = v.x;                                                                                                   \
        im[k] = v.y;                                                                                                   \
        if (k && span > 1) {                                                                                           \
            const float4 pair = twiddles[(k - 1) / 2 * span];                                                          \
            const float2 w = k % 2 ? pair.lo : pair.hi;                                                                \
            fft_times_twiddle(&re[k], &im[k], w.x, w.y);                                                               \
        }                                                                                                              \
    }
    if (FFT_IS_THERE(radix, round, b)) {
        FFT_EACH_POINT(GET)
        fft_butterfly(radix, re, im);
    }
}

FFT_INLINE void get_odd(__local const float2 *scratch, int span, __global const float4 *twiddles, float *re, float *im)
{
    const int b = ITEM;
    twiddles += (uint)(b % span);
    if (!FFT_IS_THERE(FFT_ODD_RADIX, 0, b))
        return;
#pragma unroll
    for (int k = 0; k < FFT_ODD_RADIX; ++k) {
        const float2 v = scratch[place_after(b, k * FFT_BUTTERFLIES(FFT_ODD_RADIX))];
        re[k] = v.x;
        im[k] = v.y;
        if (k && span > 1) {
            const float4 pair = twiddles[(k - 1) / 2 * span];
            const float2 w = k % 2 ? pair.lo : pair.hi;
            fft_times_twiddle(&re[k], &im[k], w.x, w.y);
        }
    }
    fft_odd_fold(re, im);
}

/* A butterfly's outputs to scratch; of the first stage, those of an even radix are in a row. */
FFT_INLINE void put_round(__local float2 *scratch, int radix, int span, int round, const float *re, const float *im)
{
    const int b = ITEM + round * ITEMS, base = FFT_FIRST_OUTPUT(radix, span, b);
#define PUT(k)                                                                                                         \
    if (k < radix) {                                                                                                   \
        if (span > 1 || radix % 2)                                                                                     \
            scratch[place_after(base, k * span)] = (float2)(re[k], im[k]);                                             \
        else if (k % 2 == 0)                                                                                           \
            *(__local float4 *)(scratch + (FFT_ROW_BANK % radix ? place_of(base + k) : place_of(base) + k)) =          \
                (float4)(re[k], im[k], re[k + 1], im[k + 1]);                                                          \
    }
    if (FFT_IS_THERE(radix, round, b)) {
        FFT_EACH_POINT(PUT)
    }
}

FFT_INLINE void put_odd(__local float2 *scratch, int span, const float *re, const float *im)
{
    const int b = ITEM, base = FFT_FIRST_OUTPUT(FFT_ODD_RADIX, span, b);
    if (!FFT_IS_THERE(FFT_ODD_RADIX, 0, b))
        return;
#pragma unroll
    for (int m = 0; m <= FFT_ODD_PAIRS; ++m) {
        const float2 x = fft_odd_part(re, im, m), y = fft_odd_part(im, re, m);
        scratch[place_after(base, m * span)] = (float2)(x.x, y.y);
        if (m)
            scratch[place_after(base, (FFT_ODD_RADIX - m) * span)] = (float2)(x.y, y.x);
    }
}

/* A stage, from scratch and back to it. */
FFT_INLINE void stage(__local float2 *scratch, int radix, int span, __global const float4 *twiddles, float *re,
                      float *im)
{
    barrier(CLK_LOCAL_MEM_FENCE);
    if (radix == FFT_ODD_RADIX) {
        get_odd(scratch, span, twiddles, re, im);
    } else {
#define GET_ROUND(i)                                                                                                   \
    if (i < FFT_ROUNDS(radix))                                                                                         \
        get_round(scratch, radix, span, i, twiddles, re + i * radix, im + i * radix);
        FFT_EACH_ROUND(GET_ROUND)
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (radix == FFT_ODD_RADIX) {
        put_odd(scratch, span, re, im);
    } else {
#define PUT_ROUND(i)                                                                                                   \
    if (i < FFT_ROUNDS(radix))                                                                                         \
        put_round(scratch, radix, span, i, re + i * radix, im + i * radix);
        FFT_EACH_ROUND(PUT_ROUND)
    }
}

/* Whether four points that lie in a row of the transform do so, aligned, in memory, all there or none. */
FFT_INLINE int is_aligned(const hada_fft_real *real)
{
    return ((real->offset | real->distance | real->pitch | (ulong)real->col0 | (ulong)real->cols) & 3) == 0;
}

/* Four points from column c on; zero where there are none. */
FFT_INLINE float4 load_four(__global const float *row, int c, int cols, int aligned)
{
    float4 v = (float4)0.0f;
    if (aligned) {
        if ((uint)c < (uint)cols)
            v = *(__global const float4 *)(row + c);
    } else {
        if ((uint)c < (uint)cols)
            v.x = row[c];
        if ((uint)(c + 1) < (uint)cols)
            v.y = row[c + 1];
        if ((uint)(c + 2) < (uint)cols)
            v.z = row[c + 2];
        if ((uint)(c + 3) < (uint)cols)
            v.w = row[c + 3];
    }
    return v;
}

FFT_INLINE void store_four(__global float *row, int c, int cols, int aligned, float4 v)
{
    if (aligned) {
        if ((uint)c < (uint)cols)
            *(__global float4 *)(row + c) = v;
    } else {
        if ((uint)c < (uint)cols)
            row[c] = v.x;
        if ((uint)(c + 1) < (uint)cols)
            row[c + 1] = v.y;
        if ((uint)(c + 2) < (uint)cols)
            row[c + 2] = v.z;
        if ((uint)(c + 3) < (uint)cols)
            row[c + 3] = v.w;
    }
}

/* Four butterflies side by side: values [input][butterfly]. */
FFT_RADIX4(four_butterflies, float4)

/* Points of a row for the first stage. */
FFT_INLINE void load_row(__global const float *row, int cols, int col0, int aligned, float4 *v)
{
#pragma unroll
    for (int round = 0; round < QUAD_ROUNDS; ++round) {
        const int q = ITEM + round * ITEMS;
#pragma unroll
        for (int k = 0; k < 4; ++k)
            v[4 * round + k] = load_four(row, 4 * q + k * (FFT_POINTS / 4) - col0, q < QUADS ? cols : 0, aligned);
    }
}

/* The first stage forward, from memory to scratch: row x as real and row y as imaginary parts. */
FFT_INLINE void first_stage(__global const float *x, __global const float *y, int cols_x, int cols_y, int col0,
                            int aligned, __local float2 *scratch)
{
    float4 re_all[4 * QUAD_ROUNDS], im_all[4 * QUAD_ROUNDS];
    if (aligned) {
        load_row(x, cols_x, col0, 1, re_all);
        load_row(y, cols_y, col0, 1, im_all);
    } else {
        load_row(x, cols_x, col0, 0, re_all);
        load_row(y, cols_y, col0, 0, im_all);
    }
#pragma unroll
    for (int round = 0; round < QUAD_ROUNDS; ++round) {
        const int q = ITEM + round * ITEMS;
        float4 *re = re_all + 4 * round, *im = im_all + 4 * round;
        if ((round + 1) * ITEMS <= QUADS || q < QUADS) {
            four_butterflies(re, im);
            __local float4 *to = (__local float4 *)(scratch + place_of(16 * q));
            to[0] = (float4)(re[0].x, im[0].x, re[1].x, im[1].x);
            to[1] = (float4)(re[2].x, im[2].x, re[3].x, im[3].x);
            to[2] = (float4)(re[0].y, im[0].y, re[1].y, im[1].y);
            to[3] = (float4)(re[2].y, im[2].y, re[3].y, im[3].y);
            to[4] = (float4)(re[0].z, im[0].z, re[1].z, im[1].z);
            to[5] = (float4)(re[2].z, im[2].z, re[3].z, im[3].z);
            to[6] = (float4)(re[0].w, im[0].w, re[1].w, im[1].w);
            to[7] = (float4)(re[2].w, im[2].w, re[3].w, im[3].w);
        }
    }
}

/* The last stage of an inverse, from scratch to memory. */
FFT_INLINE void last_stage(__local const float2 *scratch, __global const float4 *twiddles, __global float *x,
                           __global float *y, int cols_x, int cols_y, int col0, float scale, int aligned)
{
#pragma unroll
    for (int round = 0; round < QUAD_ROUNDS; ++round) {
        const int q = ITEM + round * ITEMS;
        if ((round + 1) * ITEMS <= QUADS || q < QUADS) {
            float4 re[4], im[4];
#pragma unroll
            for (int k = 0; k < 4; ++k) {
                __local const float4 *p = (__local const float4 *)(scratch + place_after(4 * q, k * (FFT_POINTS / 4)));
                const float4 a = p[0], b = p[1];
                re[k] = (float4)(a.x, a.z, b.x, b.z);
                im[k] = (float4)(a.y, a.w, b.y, b.w);
                if (k) {
                    __global const float4 *w = twiddles + (k - 1) / 2 * (FFT_POINTS / 4) + 4 * q;
                    const float4 w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3], t = re[k];
                    const float4 c = k % 2 ? (float4)(w0.x, w1.x, w2.x, w3.x) : (float4)(w0.z, w1.z, w2.z, w3.z);
                    const float4 d = k % 2 ? (float4)(w0.y, w1.y, w2.y, w3.y) : (float4)(w0.w, w1.w, w2.w, w3.w);
                    re[k] = fma(t, c, -(im[k] * d));
                    im[k] = fma(t, d, im[k] * c);
                }
            }
            four_butterflies(re, im);
#pragma unroll
            for (int k = 0; k < 4; ++k) { /* parts changed over */
                const int c = 4 * q + k * (FFT_POINTS / 4) - col0;
                store_four(x, c, cols_x, aligned, im[k] * scale);
                store_four(y, c, cols_y, aligned, re[k] * scale);
            }
        }
    }
}

/* The spectra of the two rows at the frequencies k and k + 1, k even. */
FFT_INLINE void take_apart(__local const float2 *scratch, int k, __global float *x, __global float *y, int y_there)
{
    const float4 z = *(__local const float4 *)(scratch + place_of(k));
    const float2 u = scratch[place_of(k ? FFT_POINTS - k : 0)], v = scratch[place_of(FFT_POINTS - 1 - k)];
    *(__global float4 *)x = 0.5f * (float4)(z.x + u.x, z.y - u.y, z.z + v.x, z.w - v.y);
    if (y_there)
        *(__global float4 *)y = 0.5f * (float4)(z.y + u.y, u.x - z.x, z.w + v.y, v.x - z.z);
}

/* Arguments as those of fft_group_rows_forward. */
__kernel __attribute__((reqd_work_group_size(ITEMS * WIDTH, 1, 1))) void
fft_sized_rows_forward(__global const float *in, hada_fft_real real, __global float *out, hada_fft_spectra spectra,
                       __global const float4 *twiddles)
{
    __local float2 scratches[WIDTH * PITCH] __attribute__((aligned(16))); /* read and written by fours */
    const int groups = (real.rows + 2 * WIDTH - 1) / (2 * WIDTH), image = (int)get_group_id(0) / groups;
    const int row = ((int)get_group_id(0) % groups * WIDTH + (int)get_local_id(0) / ITEMS) * 2;
    const int x_there = row < real.rows, y_there = row + 1 < real.rows;
    __local float2 *scratch = scratches + (int)get_local_id(0) / ITEMS * PITCH;
    __global const float *x = in + real.offset + (ulong)image * real.distance + (ulong)row * real.pitch;
    const int cols_x = x_there ? real.cols : 0, cols_y = y_there ? real.cols : 0;
    first_stage(x, x + real.pitch, cols_x, cols_y, real.col0, is_aligned(&real), scratch);
    float re1[HELD(R1)], im1[HELD(R1)], re2[HELD(R2)], im2[HELD(R2)];
    stage(scratch, R1, 4, twiddles, re1, im1);
    twiddles += FFT_TWIDDLE_PAIRS(R1, 4);
    stage(scratch, R2, 4 * R1, twiddles, re2, im2);
#if FFT_ROW_SIZES(FFT_RADIX3) 0 > 1
    float re3[HELD(R3)], im3[HELD(R3)];
    twiddles += FFT_TWIDDLE_PAIRS(R2, 4 * R1);
    stage(scratch, R3, 4 * R1 * R2, twiddles, re3, im3);
#endif
    barrier(CLK_LOCAL_MEM_FENCE);
    const int blocks = spectra.band / HADA_FFT_BLOCK + 1, t = ITEM;
    const ulong block = (ulong)spectra.rows * 16;
    out += 2 * (spectra.offset + (ulong)image * spectra.distance + (ulong)(real.row0 + row) * 8);
#pragma unroll
    for (int round = 0; round <= PAIR_ROUNDS; ++round) {
        const int k = round < PAIR_ROUNDS ? 2 * (t + round * ITEMS) : FFT_POINTS / 2 + 2 * t;
        const int last = round < PAIR_ROUNDS ? FFT_POINTS / 2 : FFT_POINTS / 2 + HADA_FFT_BLOCK;
        __global float *q = out + (ulong)(k / 8) * block + 2 * (k % 8);
        if (x_there && k < min(last, 8 * blocks))
            take_apart(scratch, k, q, q + 16, y_there);
    }
}

/* Two rows' spectra at the frequencies k and k + 1 to scratch, as those of one complex transform, parts changed over;
 * k even and below half the length. */
FFT_INLINE void put_together(__local float2 *scratch, int k, float4 x, float4 y)
{
    *(__local float4 *)(scratch + place_of(k)) =
        k ? (float4)(x.y + y.x, x.x - y.y, x.w + y.z, x.z - y.w) : (float4)(y.x, x.x, x.w + y.z, x.z - y.w);
    if (k)
        scratch[place_of(FFT_POINTS - k)] = (float2)(y.x - x.y, x.x + y.y);
    scratch[place_of(FFT_POINTS - 1 - k)] = (float2)(y.z - x.w, x.z + y.w);
}

/* Arguments as those of fft_group_rows_inverse. */
__kernel __attribute__((reqd_work_group_size(ITEMS * WIDTH, 1, 1))) void
fft_sized_rows_inverse(__global const float *in, hada_fft_spectra spectra, __global float *out, hada_fft_real real,
                       __global const float4 *twiddles)
{
    __local float2 scratches[WIDTH * PITCH] __attribute__((aligned(16))); /* read and written by fours */
    const int groups = (real.rows + 2 * WIDTH - 1) / (2 * WIDTH), image = (int)get_group_id(0) / groups;
    const int row = ((int)get_group_id(0) % groups * WIDTH + (int)get_local_id(0) / ITEMS) * 2;
    const int x_there = row < real.rows, y_there = row + 1 < real.rows, t = ITEM;
    __local float2 *scratch = scratches + (int)get_local_id(0) / ITEMS * PITCH;
    const ulong block = (ulong)spectra.rows * 16;
    in += 2 * (spectra.offset + (ulong)image * spectra.distance + (ulong)row * 8);
#pragma unroll
    for (int round = 0; round < PAIR_ROUNDS; ++round) {
        const int pair = t + round * ITEMS, k = 2 * pair;
        if ((round + 1) * ITEMS <= FFT_POINTS / 4 || pair < FFT_POINTS / 4) {
            float4 x = (float4)0.0f, y = (float4)0.0f;
            __global const float *p = in + (ulong)(k / 8) * block + 2 * (k % 8);
            if (x_there && k <= spectra.band)
                x = *(__global const float4 *)p;
            if (y_there && k <= spectra.band)
                y = *(__global const float4 *)(p + 16);
            if (k + 1 > spectra.band)
                x.hi = y.hi = (float2)0.0f;
            put_together(scratch, k, x, y);
        }
    }
    if (t == 0) { /* the frequency of half the length is real */
        __global const float *p = in + (ulong)(FFT_POINTS / 16) * block;
        const int there = FFT_POINTS / 2 <= spectra.band;
        scratch[place_of(FFT_POINTS / 2)] = (float2)(there && y_there ? p[16] : 0.0f, there && x_there ? p[0] : 0.0f);
    }
    float re1[HELD(R1)], im1[HELD(R1)], re2[HELD(R2)], im2[HELD(R2)];
#if FFT_ROW_SIZES(FFT_RADIX3) 0 > 1
    float re3[HELD(R3)], im3[HELD(R3)];
    stage(scratch, R3, 1, twiddles, re3, im3);
    stage(scratch, R2, R3, twiddles, re2, im2);
    twiddles += FFT_TWIDDLE_PAIRS(R2, R3);
#else
    stage(scratch, R2, 1, twiddles, re2, im2);
#endif
    stage(scratch, R1, FFT_POINTS / 4 / R1, twiddles, re1, im1);
    twiddles += FFT_TWIDDLE_PAIRS(R1, FFT_POINTS / 4 / R1);
    barrier(CLK_LOCAL_MEM_FENCE);
    __global float *x = out + real.offset + (ulong)image * real.distance + (ulong)row * real.pitch;
    const int cols_x = x_there ? real.cols : 0, cols_y = y_there ? real.cols : 0;
    last_stage(scratch, twiddles, x, x + real.pitch, cols_x, cols_y, real.col0, real.scale, is_aligned(&real));
}
