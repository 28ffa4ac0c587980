/* As refine_rows.cl, by work-groups: a group takes 2 width rows of one plane as `width` complex transforms. The inverse
 * is taken by the stages backwards, from natural to digit-reversed order, which is that of the forward transform's
 * input: what is done to pixels needs no order. For lengths whose stages all have butterflies.
 *
 * Where a sensor crops (REFINE_CROPPED, a program of its own), the groups from now.first_group on take rows of the
 * frame instead, as refine_frame_rows.cl has them: half spectra in `split`, e' in `duals`, sums of e'^2 in
 * partial[plane][group]. */
#include "shared_refine.h"
#define REFINE_WIDTH 1
#define REFINE_GROUP HADA_REFINE_FUSED_GROUP
#include "inc_fft_groups.h"
#include "inc_refine.h"
#include "shared_fft.h"

#ifndef REFINE_CROPPED
#define REFINE_CROPPED 0
#endif

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

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_group_rows(__global float *spectra, __global float *planes, __global float *split, __global float *duals,
                  __global const float *frame, __global float *partial, hada_refine_data_step now,
                  hada_refine_rows rows, hada_refine_rows frame_rows, __global const int *table,
                  __local float2 *scratch)
{
#if REFINE_CROPPED
    REFINE_LOCAL
    const int on_frame = get_group_id(0) >= now.first_group;
#else
    const int on_frame = 0;
#endif
    const int group = get_group_id(0) - (on_frame ? now.first_group : 0);
    const int height = on_frame ? frame_rows.rows : rows.rows, cols = on_frame ? frame_rows.cols : rows.cols;
    const int col0 = on_frame ? frame_rows.col0 : rows.col0, clip = !on_frame && rows.clip;
    const int inverse = rows.inverse; /* the frame's is the same */
    const int forward = on_frame ? frame_rows.forward : rows.forward;
    const int n = table[FFT_LENGTH], stages = table[FFT_STAGES], width = rows.width;
    const int blocks = n / 2 / HADA_FFT_BLOCK + 1, groups = (height + 2 * width - 1) / (2 * width);
    const int plane = group / groups, first = group % groups * 2 * width;
    const int count = min(2 * width, height - first);
    const fft_side side = fft_side_of(width);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    __global float2 *values = (on_frame ? (__global float2 *)split + now.at : (__global float2 *)spectra) +
                              (size_t)(plane * blocks * height + first) * HADA_FFT_BLOCK; /* blocks: an int has room */

    for (int w = 0; w < (inverse ? width : 0); ++w)
        FFT_SHARE (k, n / 2 + 1) {
            __global const float2 *q =
                values + (size_t)(k / HADA_FFT_BLOCK * height + w) * HADA_FFT_BLOCK + k % HADA_FFT_BLOCK;
            float2 x = (float2)0.0f, y = (float2)0.0f;
            if (w < count)
                x = q[0];
            if (width + w < count)
                y = q[HADA_FFT_BLOCK * width];
            put_together(scratch + w, k, n, width, x, y);
        }
    for (int s = (inverse ? stages : 0) - 1; s >= 0; --s) {
        FFT_WAIT();
        fft_stage(scratch, n, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 1);
    }
    FFT_WAIT();
    /* made here, not above: registers are scarce in the stages */
    __global float *pixels = (on_frame ? duals : planes) + ((size_t)plane * height + first) * cols;
#if REFINE_CROPPED
    __global const float *seen =
        frame + now.frame_offset + ((size_t)(plane % (int)now.channels) * height + first) * cols;
    float sum = 0.0f;
#endif
    for (int w = 0; w < width; ++w)
        FFT_SHARE (x, n) {
            const int c = x - col0, is_pixel = (uint)c < (uint)cols;
            __local float2 *at = scratch + place[x] * width + w;
            __global float *u = pixels + (size_t)w * cols + c, *v = u + (size_t)width * cols;
            const int u_there = is_pixel && w < count, v_there = is_pixel && width + w < count;
            float2 value = (float2)0.0f;
            if (inverse) {
                value = rows.scale * *at;
            } else {
                value.x = u_there ? *u : 0.0f;
                value.y = v_there ? *v : 0.0f;
            }
#if REFINE_CROPPED
            if (on_frame && inverse) {
                __global const float *b = seen + (size_t)w * cols + c;
                value.x = (value.x - (u_there ? *b : 0.0f)) * now.scale;
                value.y = (value.y - (v_there ? b[(size_t)width * cols] : 0.0f)) * now.scale;
                sum = fma(u_there ? value.x : 0.0f, value.x, sum);
                sum = fma(v_there ? value.y : 0.0f, value.y, sum);
            }
#endif
            if (clip)
                value = max(value, 0.0f);
            /* of a row that is none, and beyond the window */
            if (!u_there)
                value.x = 0.0f;
            if (!v_there)
                value.y = 0.0f;
            if (inverse && u_there)
                *u = value.x;
            if (inverse && v_there)
                *v = value.y;
            *at = value;
        }
#if REFINE_CROPPED
    REFINE_TREE(sum)
    if (on_frame && inverse && get_local_id(0) == 0)
        partial[now.sums + get_group_id(0) - now.first_group] = refine_tree[0];
#endif
    for (int s = 0; s < (forward ? stages : 0); ++s) {
        FFT_WAIT();
        fft_stage(scratch, n, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 0);
    }
    FFT_WAIT();
    for (int w = 0; w < (forward ? min(width, count) : 0); ++w)
        FFT_SHARE (k, blocks * HADA_FFT_BLOCK) {
            __global float2 *to =
                values + (size_t)(k / HADA_FFT_BLOCK * height + w) * HADA_FFT_BLOCK + k % HADA_FFT_BLOCK;
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
