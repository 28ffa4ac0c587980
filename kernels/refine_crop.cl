/* From spectra of the whole grid to those of a coarse grid, channels averaged: out[image] = factor * mean over its
 * channels of in[image][channel], at the frequencies that both grids have. A Gaussian window over the frequencies,
 * 2^-(fy^2 + fx^2) with f = 1 at the coarse grid's last frequency, is applied `tapers` times (negative: divided out).
 * The coarse grid's Nyquist row and column and its padding become 0. Dimensions: columns of all blocks, rows, images.
 * parts: 2 for complex values, 1 for real ones. invert: 1 / out. */
#include "inc_spectrum.h"

__kernel void refine_crop(__global const float *in, ulong in_offset, int in_rows, int in_block, uint in_count,
                          __global float *out, uint out_offset, int rows, int cols, int block, uint count, int parts,
                          int channels, float factor, float tapers, int invert)
{
    const int kx = get_global_id(0), ky = get_global_id(1), image = get_global_id(2);
    if (kx >= (cols / 2 + block) / block * block)
        return;
    const int sy = 2 * ky < rows ? ky : ky - rows;
    const int known = 2 * kx < cols && 2 * sy > -rows;
    const float fy = 2.0f * (float)sy / (float)rows, fx = 2.0f * (float)kx / (float)cols;
    const float scale = factor / (float)channels * exp2(-tapers * (fy * fy + fx * fx));
    const size_t from = known ? spectrum_index(in_rows, in_block, sy < 0 ? sy + in_rows : sy, kx) : 0;
    const size_t to = spectrum_index(rows, block, ky, kx);
    for (int part = 0; part < parts; ++part) {
        float sum = 0.0f;
        for (int c = 0; c < channels; ++c)
            sum += in[(in_offset + (size_t)(image * channels + c) * in_count + from) * parts + part];
        sum *= scale;
        if (invert)
            sum = sum > 0.0f ? 1.0f / sum : 0.0f;
        out[((size_t)out_offset + (size_t)image * count + to) * parts + part] = known ? sum : 0.0f;
    }
}
