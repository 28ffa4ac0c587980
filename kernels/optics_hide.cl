/* Opaque planes: the part of a plane that one lens sees behind another plane. */
#include "inc_vectors.h"
#include "shared_optics.h"

/* The sum of weight[i][j] opacity[r + i][k + j] over the taps that meet the image. */
static inline float hide_cover(__global const float *opacity, __global const float *weights, int r, int k, int tap_rows,
                               int tap_cols, int rows, int cols)
{
    const int last_row = min(tap_rows, rows - r), last_col = min(tap_cols, cols - k);
    float cover = 0.0f;
    for (int i = max(0, -r); i < last_row; i++)
        for (int j = max(0, -k); j < last_col; j++)
            cover = fma(weights[i * tap_cols + j], opacity[(r + i) * cols + k + j], cover);
    return cover;
}

/* seen[c] = light[c] * max(0, 1 - cover) for `channels` images, where cover is the sum over the weights of weight[i][j]
 * opacity[r + row0 + i][k + col0 + j], 0 beyond the edges. An item takes eight pixels of a row in all channels. `seen`
 * (from `seen_offset` on) may be `light`. */
__kernel void optics_hide(__global const float *light, __global float *seen, const ulong seen_offset,
                          __global const float *opacity, const ulong opacity_offset, __global const float *weights,
                          const hada_optics_taps taps, const hada_optics_image image)
{
    const int channels = image.channels, rows = image.rows, cols = image.cols;
    const int row0 = taps.row0, tap_rows = taps.rows, tap_cols = taps.cols;
    const int first = 8 * get_global_id(0), r = get_global_id(1), k = first + taps.col0;
    if (first >= cols)
        return;
    opacity += opacity_offset;
    size_t at = (size_t)r * cols + first;
    if (first + 8 <= cols && k >= 0 && k + tap_cols + 7 <= cols) {
        const int last = min(tap_rows, rows - r - row0);
        float8 cover = 0.0f;
        for (int i = max(0, -r - row0); i < last; i++)
            for (int j = 0; j < tap_cols; j++)
                cover =
                    fma((float8)weights[i * tap_cols + j], vload8(0, opacity + (r + row0 + i) * cols + k + j), cover);
        const float8 clear = max(0.0f, 1.0f - cover);
        for (int c = 0; c < channels; c++, at += (size_t)rows * cols)
            VECTORS_STORE8(__global, vload8(0, light + at) * clear, seen + seen_offset + at);
        return;
    }
    for (int i = 0; i < min(8, cols - first); i++) {
        const float clear =
            max(0.0f, 1.0f - hide_cover(opacity, weights, r + row0, k + i, tap_rows, tap_cols, rows, cols));
        for (int c = 0; c < channels; c++) {
            const size_t pixel = at + i + (size_t)c * rows * cols;
            seen[seen_offset + pixel] = light[pixel] * clear;
        }
    }
}
