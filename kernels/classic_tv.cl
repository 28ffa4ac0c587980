/* The proximal step of total variation with non-negativity, min 1/2 |x - z|^2 + w |grad x|_1, x >= 0, by projected
 * gradients on its dual with momentum: A. Beck and M. Teboulle, "Fast gradient-based algorithms for constrained total
 * variation image denoising and deblurring problems", IEEE TIP 18(11), 2009. Differences are forward, 0 at the far
 * edges. Duals stand as [plane][2] images (along columns of pixels, along rows of pixels), scaled by w.
 * Dimensions: bands of rows, planes; plane p belongs to channel p % channels. */
#include "inc_classic.h"
#include "shared_classic.h"

/* x = max(0, z - grad^T dual) */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void classic_tv_planes(__global const float *given,
                                                                                          __global const float *duals,
                                                                                          __global float *planes,
                                                                                          hada_classic_bands image)
{
    const int rows = image.rows, cols = image.cols, pitch = image.pitch, band = image.band;
    const int from = get_group_id(0) * band, to = min(rows, from + band);
    const size_t distance = (size_t)rows * pitch, plane = (size_t)get_global_id(1) * distance;
    __global const float *pi = duals + 2 * plane, *pj = pi + distance;
    for (int i = from; i < to; ++i) {
        const size_t row = (size_t)i * pitch;
        for (int j = get_local_id(0) * REFINE_WIDTH; j < cols; j += REFINE_GROUP * REFINE_WIDTH) {
            const refine_real here = image_get(pj, row + j), left = image_left(here, j ? pj[row + j - 1] : 0.0f);
            const refine_real up = i ? image_get(pi, row - pitch + j) : (refine_real)0.0f;
            const refine_real x = image_get(given, plane + row + j) - (up - image_get(pi, row + j) + left - here);
            image_put(planes, plane + row + j, image_cut(max(x, 0.0f), j, 0, cols));
        }
    }
}

/* p' = clamp(r + grad x / 8, -w, w), r = p' + beta (p' - p), p = p'; w = weight alpha[channel] */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_tv_duals(__global const float *planes, __global float *duals, __global float *momentum,
                 __global const float *alpha, float weight, float beta, uint channels, hada_classic_bands image)
{
    const int rows = image.rows, cols = image.cols, pitch = image.pitch, band = image.band;
    const int from = get_group_id(0) * band, to = min(rows, from + band);
    const size_t distance = (size_t)rows * pitch, plane = (size_t)get_global_id(1) * distance;
    __global const float *x = planes + plane;
    const float w = weight * alpha[get_global_id(1) % channels];
    for (int i = from; i < to; ++i) {
        const size_t row = (size_t)i * pitch, down = i + 1 < rows ? row + pitch : row;
        for (int j = get_local_id(0) * REFINE_WIDTH; j < cols; j += REFINE_GROUP * REFINE_WIDTH) {
            const int next = min(j + REFINE_WIDTH, cols - 1);
            const refine_real here = image_get(x, row + j);
            const refine_real right = image_set(image_right(here, x[row + next]), x[row + cols - 1], j, cols - 1);
            const refine_real slope[2] = {image_get(x, down + j) - here, right - here};
            for (int k = 0; k < 2; ++k) {
                const size_t at = 2 * plane + k * distance + row + j;
                const refine_real p = clamp(fma(slope[k], (refine_real)0.125f, image_get(momentum, at)), -w, w);
                image_put(momentum, at, image_cut(fma((refine_real)beta, p - image_get(duals, at), p), j, 0, cols));
                image_put(duals, at, image_cut(p, j, 0, cols));
            }
        }
    }
}
