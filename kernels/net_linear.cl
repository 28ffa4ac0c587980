/* Fully connected layers on plain arrays: y[n][o] = bias[o] + sum_i w[o][i] x[n][i], and the gradients. Four images and
 * four outputs are computed at once, so that each value read is used four times. CPUs: vectors of eight, work-groups of
 * one; GPUs: LINEAR_WIDTH 1, and LINEAR_GROUP work-items sum the products of an output. */
#ifndef LINEAR_WIDTH
#define LINEAR_WIDTH 8
#endif
#ifndef LINEAR_GROUP
#define LINEAR_GROUP 1
#endif

#define WIDE_WIDTH LINEAR_WIDTH
#include "inc_wide.h"
#include "shared_net.h"

/* sum[o][n]: rows[o] times x[n], as far as this work-item of its group goes; `images` is known when it is compiled. */
WIDE_INLINE void linear_products(__global const float *const *rows, __global const float *const *x, int images, int in,
                                 int item, float sum[HADA_LINEAR_OUTPUTS][HADA_LINEAR_IMAGES])
{
    wide_real lanes[HADA_LINEAR_OUTPUTS][HADA_LINEAR_IMAGES];
#pragma unroll
    for (int o = 0; o < HADA_LINEAR_OUTPUTS; o++)
#pragma unroll
        for (int n = 0; n < images; n++)
            lanes[o][n] = 0.0f;
    for (int i = item * LINEAR_WIDTH; i + LINEAR_WIDTH <= in; i += LINEAR_GROUP * LINEAR_WIDTH) {
        wide_real v[HADA_LINEAR_IMAGES];
#pragma unroll
        for (int n = 0; n < images; n++)
            v[n] = wide_get(x[n] + i);
#pragma unroll
        for (int o = 0; o < HADA_LINEAR_OUTPUTS; o++) {
            const wide_real w = wide_get(rows[o] + i);
#pragma unroll
            for (int n = 0; n < images; n++)
                lanes[o][n] = fma(w, v[n], lanes[o][n]);
        }
    }
#pragma unroll
    for (int o = 0; o < HADA_LINEAR_OUTPUTS; o++)
#pragma unroll
        for (int n = 0; n < images; n++) {
            sum[o][n] = wide_sum(lanes[o][n]);
#if LINEAR_WIDTH > 1
            for (int i = in / LINEAR_WIDTH * LINEAR_WIDTH; i < in; i++)
                sum[o][n] = fma(rows[o][i], x[n][i], sum[o][n]);
#endif
        }
}

/* Dimension 0: outputs over HADA_LINEAR_OUTPUTS, times LINEAR_GROUP. Images: one after the other, so that weights stay
 * in the cache; in groups, dimension 1 counts HADA_LINEAR_IMAGES of them each. Outputs and images beyond the last one
 * repeat it. */
__kernel __attribute__((reqd_work_group_size(LINEAR_GROUP, 1, 1))) void
net_linear_forward(__global const float *w, __global const float *bias, __global const float *x, __global float *y,
                   hada_linear_layout at)
{
    const int images = at.images, in = at.in, out = at.out;
    const int item = get_local_id(0), to = get_group_id(0) * HADA_LINEAR_OUTPUTS;
    __global const float *rows[HADA_LINEAR_OUTPUTS], *image[HADA_LINEAR_IMAGES];
    float sum[HADA_LINEAR_OUTPUTS][HADA_LINEAR_IMAGES] = {{0.0f}};
    for (int o = 0; o < HADA_LINEAR_OUTPUTS; o++)
        rows[o] = w + at.w + (size_t)min(to + o, out - 1) * in;
#if LINEAR_GROUP > 1
    __local float tree[LINEAR_GROUP];
    const int first = get_global_id(1) * HADA_LINEAR_IMAGES;
#else
    for (int first = 0; first < images; first += HADA_LINEAR_IMAGES)
#endif
    {
        for (int n = 0; n < HADA_LINEAR_IMAGES; n++)
            image[n] = x + at.x + (size_t)min(first + n, images - 1) * in;
        if (images - first == 1)
            linear_products(rows, image, 1, in, item, sum);
        else
            linear_products(rows, image, HADA_LINEAR_IMAGES, in, item, sum);
#if LINEAR_GROUP > 1
        for (int k = 0; k < HADA_LINEAR_OUTPUTS * HADA_LINEAR_IMAGES; k++) {
            tree[item] = sum[k / HADA_LINEAR_IMAGES][k % HADA_LINEAR_IMAGES];
            for (int step = LINEAR_GROUP / 2; step > 0; step /= 2) {
                barrier(CLK_LOCAL_MEM_FENCE);
                if (item < step)
                    tree[item] += tree[item + step];
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            sum[k / HADA_LINEAR_IMAGES][k % HADA_LINEAR_IMAGES] = tree[0];
            barrier(CLK_LOCAL_MEM_FENCE);
        }
#endif
        for (int o = 0; o < (item ? 0 : min(HADA_LINEAR_OUTPUTS, out - to)); o++)
            for (int n = 0; n < min(HADA_LINEAR_IMAGES, images - first); n++)
                y[at.y + (size_t)(first + n) * out + to + o] =
                    sum[o][n] + (at.has_bias ? bias[at.bias + to + o] : 0.0f);
    }
}

/* Inputs that a work-item takes. */
#if LINEAR_WIDTH > 1
#define LINEAR_COLUMNS HADA_LINEAR_COLUMNS
#else
#define LINEAR_COLUMNS 1
#endif

/* dx[n][i] = sum_o w[o][i] dy[n][o]. Dimension 0: inputs over LINEAR_COLUMNS; images as above, side by side in
 * dimension 1 in groups. Sums are in private memory, so that a long piece of a row of weights is read at once. */
__kernel void net_linear_data(__global const float *w, __global const float *dy, __global float *dx,
                              hada_linear_layout at)
{
    const int images = at.images, in = at.in, out = at.out;
    const ulong w_offset = at.w, dy_offset = at.y;
    const int i = get_global_id(0) * LINEAR_COLUMNS, columns = min(LINEAR_COLUMNS, in - i);
    const int whole = columns / LINEAR_WIDTH;
    if (i >= in)
        return;
    for (int first = get_global_id(1) * HADA_LINEAR_IMAGES; first < images;
         first += get_global_size(1) * HADA_LINEAR_IMAGES) {
        __global const float *column = w + w_offset + i, *from[HADA_LINEAR_IMAGES];
        __global float *to = dx + at.x + (size_t)first * in + i;
        wide_real sum[LINEAR_COLUMNS / LINEAR_WIDTH][HADA_LINEAR_IMAGES];
        const int here = min(HADA_LINEAR_IMAGES, images - first);
        for (int n = 0; n < HADA_LINEAR_IMAGES; n++)
            from[n] = dy + dy_offset + (size_t)min(first + n, images - 1) * out;
        for (int k = 0; k < whole; k++)
            for (int n = 0; n < HADA_LINEAR_IMAGES; n++)
                sum[k][n] = 0.0f;
        int o = 0;
        for (; o + 2 <= out; o += 2, column += 2 * (size_t)in)
            for (int k = 0; k < whole; k++) {
                const wide_real a = wide_get(column + k * LINEAR_WIDTH);
                const wide_real b = wide_get(column + in + k * LINEAR_WIDTH);
#pragma unroll
                for (int n = 0; n < HADA_LINEAR_IMAGES; n++)
                    sum[k][n] = fma((wide_real)from[n][o + 1], b, fma((wide_real)from[n][o], a, sum[k][n]));
            }
        for (int k = 0; o < out && k < whole; k++)
            for (int n = 0; n < HADA_LINEAR_IMAGES; n++)
                sum[k][n] = fma((wide_real)from[n][o], wide_get(column + k * LINEAR_WIDTH), sum[k][n]);
        for (int n = 0; n < here; n++)
            for (int k = 0; k < whole; k++)
                wide_put(sum[k][n], to + (size_t)n * in + k * LINEAR_WIDTH);
        for (int n = 0; n < here; n++)
            for (int k = whole * LINEAR_WIDTH; k < columns; k++) {
                float rest = 0.0f;
                for (o = 0; o < out; o++)
                    rest = fma(from[n][o], w[w_offset + (size_t)o * in + i + k], rest);
                to[(size_t)n * in + k] = rest;
            }
    }
}

/* dw[o][i] = sum_n dy[n][o] x[n][i]. Dimensions: inputs over `run`, a multiple of LINEAR_WIDTH, and outputs. */
__kernel void net_linear_weights(__global const float *x, __global const float *dy, __global float *dw,
                                 hada_linear_layout at, int run, int accumulate)
{
    const int images = at.images, in = at.in, out = at.out;
    const ulong x_offset = at.x, dy_offset = at.y;
    const int o = get_global_id(1), end = min((int)(get_global_id(0) + 1) * run, in);
    __global float *to = dw + at.w + (size_t)o * in;
    int i = get_global_id(0) * run;
    for (; i + LINEAR_WIDTH <= end; i += LINEAR_WIDTH) {
        wide_real sum = accumulate ? wide_get(to + i) : 0.0f;
        for (int n = 0; n < images; n++)
            sum = fma((wide_real)dy[dy_offset + (size_t)n * out + o], wide_get(x + x_offset + (size_t)n * in + i), sum);
        wide_put(sum, to + i);
    }
#if LINEAR_WIDTH > 1
    for (; i < end; i++) {
        float sum = accumulate ? to[i] : 0.0f;
        for (int n = 0; n < images; n++)
            sum = fma(dy[dy_offset + (size_t)n * out + o], x[x_offset + (size_t)n * in + i], sum);
        to[i] = sum;
    }
#endif
}

/* dbias[o] = sum_n dy[n][o]. */
__kernel void net_linear_bias(__global const float *dy, __global float *dbias, hada_linear_layout at, int accumulate)
{
    const int images = at.images, out = at.out;
    const int o = get_global_id(0);
    if (o >= out)
        return;
    float sum = accumulate ? dbias[at.bias + o] : 0.0f;
    for (int n = 0; n < images; n++)
        sum += dy[at.y + (size_t)n * out + o];
    dbias[at.bias + o] = sum;
}
