/* Structural similarity (Wang et al. 2004) of planar images, and its gradient. Windows of 11 x 11 stand wholly inside;
 * their Gaussian is separable. With local means m of x and y, s of x^2, y^2 and xy,
 *     S = a1 a2 / (b1 b2), a1 = 2 mx my + c1, a2 = 2 (sxy - mx my) + c2,
 *     b1 = mx^2 + my^2 + c1, b2 = (sxx - mx^2) + (syy - my^2) + c2,
 * and the gradient of the sum of S is G'(dS/dmx) + 2 x G'(dS/dsxx) + y G'(dS/dsxy), G' being the transposed filter.
 *
 * Four passes: down the columns, along the rows with S and its derivatives, and both back. Vectors of eight columns.
 * Dimensions: work-items that share a row, rows, planes. Offsets in floats. */

#include "inc_vectors.h"
#include "shared_net.h"

#define SSIM_BLOCK 16 /* the most channels in a block */

__constant float ssim_weight[HADA_SSIM_SIZE] = {0.001028380f, 0.007598758f, 0.036000772f, 0.109360690f,
                                                0.213005538f, 0.266011725f, 0.213005538f, 0.109360690f,
                                                0.036000772f, 0.007598758f, 0.001028380f};

/* Of each column's eleven values from row r on: the means of x, y, x^2, y^2, xy, at means[plane][5][row][pitch]. x and
 * y: [plane][rows][pitch]. */
__kernel void net_ssim_down(__global float *scratch, hada_ssim_layout at)
{
    const int rows = at.rows, pitch = at.pitch;
    const int r = get_global_id(1), out_rows = rows - HADA_SSIM_SIZE + 1;
    const size_t plane = get_global_id(2), step = (size_t)out_rows * pitch;
    __global const float *x = scratch + at.x + (plane * rows + r) * pitch;
    __global const float *y = scratch + at.target + (plane * rows + r) * pitch;
    __global float *out = scratch + at.means + (plane * 5 * out_rows + r) * pitch;
    for (int c = 8 * get_global_id(0); c < pitch; c += 8 * get_global_size(0)) {
        float8 mx = 0.0f, my = 0.0f, xx = 0.0f, yy = 0.0f, xy = 0.0f;
        for (int k = 0; k < HADA_SSIM_SIZE; k++) {
            const float8 a = vload8(0, x + k * pitch + c), b = vload8(0, y + k * pitch + c);
            const float8 wa = ssim_weight[k] * a, wb = ssim_weight[k] * b;
            mx += wa;
            my += wb;
            xx = fma(wa, a, xx);
            yy = fma(wb, b, yy);
            xy = fma(wa, b, xy);
        }
        VECTORS_STORE8(__global, mx, out + c);
        VECTORS_STORE8(__global, my, out + step + c);
        VECTORS_STORE8(__global, xx, out + 2 * step + c);
        VECTORS_STORE8(__global, yy, out + 3 * step + c);
        VECTORS_STORE8(__global, xy, out + 4 * step + c);
    }
}

static inline __attribute__((always_inline)) float8 ssim_along(__global const float *p)
{
    float8 sum = 0.0f;
    for (int k = 0; k < HADA_SSIM_SIZE; k++)
        sum = fma((float8)ssim_weight[k], vload8(0, p + k), sum);
    return sum;
}

/* S, summed per work-item, and its derivatives by mx, sxx and sxy at slopes[plane][3][row][HADA_SSIM_MARGIN + column],
 * zeros where no window is; a row is pitch + 2 HADA_SSIM_MARGIN long. */
__kernel void net_ssim_along(__global float *scratch, hada_ssim_layout at, float c1, float c2)
{
    const int cols = at.cols, pitch = at.pitch;
    const int r = get_global_id(1), rows = get_global_size(1), wide = pitch + 2 * HADA_SSIM_MARGIN;
    const int out_cols = cols - HADA_SSIM_SIZE + 1;
    const size_t plane = get_global_id(2), step = (size_t)rows * pitch, out_step = (size_t)rows * wide;
    __global const float *in = scratch + at.means + (plane * 5 * rows + r) * pitch;
    __global float *out = scratch + at.slopes + (plane * 3 * rows + r) * wide;
    float8 sum = 0.0f;
    for (int place = 8 * get_global_id(0); place < wide; place += 8 * get_global_size(0)) {
        const int c = place - HADA_SSIM_MARGIN;
        float8 by_mean = 0.0f, by_square = 0.0f, by_product = 0.0f;
        if (c >= 0 && c < out_cols) {
            const float8 mx = ssim_along(in + c), my = ssim_along(in + step + c);
            const float8 vx = ssim_along(in + 2 * step + c) - mx * mx, vy = ssim_along(in + 3 * step + c) - my * my;
            const float8 vxy = ssim_along(in + 4 * step + c) - mx * my;
            const float8 a1 = 2.0f * mx * my + c1, a2 = 2.0f * vxy + c2;
            const float8 b1 = mx * mx + my * my + c1, b2 = vx + vy + c2, both = 1.0f / (b1 * b2), s = a1 * a2 * both;
            const int8 inside = (int8)(0, 1, 2, 3, 4, 5, 6, 7) < out_cols - c;
            sum += select((float8)0.0f, s, inside);
            by_mean = select((float8)0.0f, 2.0f * (my * (a2 - a1) * both + s * mx * (1.0f / b2 - 1.0f / b1)), inside);
            by_square = select((float8)0.0f, -s / b2, inside);
            by_product = select((float8)0.0f, 2.0f * a1 * both, inside);
        }
        VECTORS_STORE8(__global, by_mean, out + place);
        VECTORS_STORE8(__global, by_square, out + out_step + place);
        VECTORS_STORE8(__global, by_product, out + 2 * out_step + place);
    }
    const float4 a = sum.lo + sum.hi;
    const size_t item = (plane * rows + r) * get_global_size(0) + get_global_id(0);
    scratch[at.sums + item] = (a.x + a.z) + (a.y + a.w);
}

/* The transposed filter along the rows: slopes to [plane][3][row][pitch]. The weights are symmetric. */
__kernel void net_ssim_back_along(__global float *scratch, hada_ssim_layout at)
{
    const int pitch = at.pitch;
    const int r = get_global_id(1), rows = get_global_size(1), wide = pitch + 2 * HADA_SSIM_MARGIN;
    const size_t plane = get_global_id(2);
    for (int q = 0; q < 3; q++) {
        __global const float *in = scratch + at.slopes + ((plane * 3 + q) * rows + r) * wide + HADA_SSIM_MARGIN;
        __global float *out = scratch + at.means + ((plane * 3 + q) * rows + r) * pitch;
        for (int c = 8 * get_global_id(0); c < pitch; c += 8 * get_global_size(0))
            VECTORS_STORE8(__global, ssim_along(in + c - (HADA_SSIM_SIZE - 1)), out + c);
    }
}

/* The transposed filter down the columns, and the gradient, times `scale`, into a tensor in blocks (lib/net/tensor.h).
 * Dimension 2 counts blocks and images; eight pixels of a block are put together first, so that memory is written once.
 */
__kernel void net_ssim_back_down(__global const float *scratch, hada_ssim_layout at, __global float *dx,
                                 hada_tensor_layout at_dx, int block, float scale, int accumulate)
{
    const int rows = at.rows, cols = at.cols, pitch = at.pitch, channels = at_dx.channels;
    const int r = get_global_id(1), in_rows = rows - HADA_SSIM_SIZE + 1, blocks = (channels + block - 1) / block;
    const int image = get_global_id(2) / blocks, b = get_global_id(2) % blocks;
    const int present = min(block, channels - b * block);
    const size_t first_plane = (size_t)image * channels + b * block, step = (size_t)in_rows * pitch;
    __global float *to =
        dx + at_dx.offset + image * at_dx.image + (((size_t)b * (rows + 2) + r + 1) * (cols + 2) + 1) * block;
    const int first = max(r - HADA_SSIM_SIZE + 1, 0), last = min(r, in_rows - 1);
    float pixels[8 * SSIM_BLOCK];
    for (int i = 0; i < 8 * block; i++)
        pixels[i] = 0.0f;
    for (int c = 8 * get_global_id(0); c < cols; c += 8 * get_global_size(0)) {
        for (int lane = 0; lane < present; lane++) {
            const size_t plane = first_plane + lane;
            __global const float *in = scratch + at.means + plane * 3 * step + c;
            float8 by_mean = 0.0f, by_square = 0.0f, by_product = 0.0f;
            for (int k = first; k <= last; k++) {
                const float8 w = ssim_weight[r - k];
                by_mean = fma(w, vload8(0, in + (size_t)k * pitch), by_mean);
                by_square = fma(w, vload8(0, in + step + (size_t)k * pitch), by_square);
                by_product = fma(w, vload8(0, in + 2 * step + (size_t)k * pitch), by_product);
            }
            const float8 x = vload8(0, scratch + at.x + (plane * rows + r) * pitch + c);
            const float8 y = vload8(0, scratch + at.target + (plane * rows + r) * pitch + c);
            float column[8];
            vstore8(fma(2.0f * x, by_square, fma(y, by_product, by_mean)) * scale, 0, column);
            for (int k = 0; k < 8; k++)
                pixels[k * block + lane] = column[k];
        }
        for (int i = 0; i < min(8, cols - c) * block; i += 8) {
            const float8 v = vload8(0, pixels + i);
            VECTORS_STORE8(__global, accumulate ? v + vload8(0, to + c * block + i) : v, to + c * block + i);
        }
    }
}
