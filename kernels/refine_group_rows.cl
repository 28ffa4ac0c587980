/* As refine_rows.cl, by work-groups: a group takes 2 width rows of one plane as `width` complex transforms. The inverse
 * is taken by the stages backwards, from natural to digit-reversed order, which is that of the forward transform's
 * input: what is done to pixels needs no order. For lengths whose stages all have butterflies. */
#include "inc_fft_groups.h"
#include "shared_fft.h"
#include "shared_refine.h"

/* Frequency k of two rows to scratch, as those of one complex transform, that of k at number n - k: a forward transform
 * of these is an inverse one. */
FFT_INLINE void put_together(__local float2 *scratch, int k, int n, int width, float2 x, float2 y)
{
    if (k == 0 || 2 * k == n) {
        scratch[k * width] = (float2)(x.x, y.x);
    } else {
        scratch[(n - k) * width] = (float2)(x.x - y.y, x.y + y.x);
        scratch[k * width] = (float2)(x.x + y.y, y.x - x.y);
    }
}

__kernel __attribute__((reqd_work_group_size(HADA_REFINE_FUSED_GROUP, 1, 1))) void
refine_group_rows(__global float *spectra, __global float *planes, hada_refine_rows rows, __global const int *table,
                  __local float2 *scratch)
{
    const int n = table[FFT_LENGTH], stages = table[FFT_STAGES], width = rows.width, cols = rows.cols;
    const int blocks = n / 2 / HADA_FFT_BLOCK + 1, groups = (rows.rows + 2 * width - 1) / (2 * width);
    const int plane = get_group_id(0) / groups, first = get_group_id(0) % groups * 2 * width;
    const int count = min(2 * width, rows.rows - first);
    const fft_side side = fft_side_of(width);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    __global float2 *values =
        (__global float2 *)spectra + ((size_t)plane * blocks * rows.rows + first) * HADA_FFT_BLOCK;
    __global float *pixels = planes + ((size_t)plane * rows.rows + first) * cols;

    for (int w = 0; w < (rows.inverse ? width : 0); ++w)
        FFT_SHARE (k, n / 2 + 1) {
            __global const float2 *q =
                values + (size_t)(k / HADA_FFT_BLOCK * rows.rows + w) * HADA_FFT_BLOCK + k % HADA_FFT_BLOCK;
            float2 x = (float2)0.0f, y = (float2)0.0f;
            if (w < count)
                x = q[0];
            if (width + w < count)
                y = q[HADA_FFT_BLOCK * width];
            put_together(scratch + w, k, n, width, x, y);
        }
    for (int s = (rows.inverse ? stages : 0) - 1; s >= 0; --s) {
        FFT_WAIT();
        fft_stage(scratch, n, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 1);
    }
    FFT_WAIT();
    for (int w = 0; w < width; ++w)
        FFT_SHARE (x, n) {
            const int c = x - rows.col0, is_pixel = (uint)c < (uint)cols;
            __local float2 *at = scratch + place[x] * width + w;
            __global float *u = pixels + (size_t)w * cols + c, *v = u + (size_t)width * cols;
            const int u_there = is_pixel && w < count, v_there = is_pixel && width + w < count;
            float2 value = (float2)0.0f;
            if (rows.inverse) {
                value = rows.scale * *at;
            } else {
                value.x = u_there ? *u : 0.0f;
                value.y = v_there ? *v : 0.0f;
            }
            if (rows.clip)
                value = max(value, 0.0f);
            /* of a row that is none, and beyond the window */
            if (!u_there)
                value.x = 0.0f;
            if (!v_there)
                value.y = 0.0f;
            if (rows.inverse && u_there)
                *u = value.x;
            if (rows.inverse && v_there)
                *v = value.y;
            *at = value;
        }
    for (int s = 0; s < (rows.forward ? stages : 0); ++s) {
        FFT_WAIT();
        fft_stage(scratch, n, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 0);
    }
    FFT_WAIT();
    for (int w = 0; w < (rows.forward ? min(width, count) : 0); ++w)
        FFT_SHARE (k, blocks * HADA_FFT_BLOCK) {
            __global float2 *to =
                values + (size_t)(k / HADA_FFT_BLOCK * rows.rows + w) * HADA_FFT_BLOCK + k % HADA_FFT_BLOCK;
            float2 z = (float2)0.0f, u = z;
            if (k <= n / 2) {
                z = 0.5f * scratch[k * width + w];
                u = 0.5f * scratch[(k ? n - k : 0) * width + w];
            }
            to[0] = (float2)(z.x + u.x, z.y - u.y);
            if (width + w < count)
                to[HADA_FFT_BLOCK * width] = (float2)(z.y + u.y, u.x - z.x);
        }
}
