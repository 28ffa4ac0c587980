/* Along the columns of half spectra: what planes predict of a frame (transpose 0: frames = sum over depths of H
 * planes), and the adjoint (transpose 1: planes = conj(H) frames). Forward transform, product with the transfer
 * functions and inverse transform of a block of columns, while it is in the cache. Whole spectra are never stored.
 *
 * Half spectra of planes and frames: complex [image][block of eight columns][row of the image][8]; otf: complex
 * [depth][channel][count].
 * A work-item takes one block of columns of one channel. scratch: a block of columns, two where depths > 1. */
#include "inc_fft_convolve.h"
#include "shared_classic.h"
#include "shared_local.h"

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
classic_columns(__global float *planes, __global float *frames, __global const float *otf, __global const int *list,
                hada_classic_columns job, __global const int *table, __local STATED_SIZE float8 *scratch)
{
    const int depths = job.depths, channels = job.channels, blocks = job.blocks, back = job.transpose;
    const int channel = get_group_id(0) % channels, block = get_group_id(0) / channels;
    const int n = table[FFT_LENGTH];
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    const float sign = back ? -1.0f : 1.0f;
    const size_t image = (size_t)blocks * n * 16; /* floats of a transfer function */
    __global const float *h = otf + 2 * job.otf_offset + channel * image + block * (size_t)n * 16;
    const fft_columns frame =
        fft_window_block(frames, (size_t)channel * blocks + block, job.frame_row0, job.frame_rows);
    __local float8 *other = scratch + (depths > 1 ? 2 * n : 0);

    if (back)
        fft_enter(&frame, scratch, table, floats);
    for (int s = 0; s < depths; ++s) {
        const fft_columns plane =
            fft_window_block(planes, ((size_t)s * channels + channel) * blocks + block, job.plane_row0, job.plane_rows);
        __global const float *here = h + (size_t)list[s] * channels * image;
        if (!back)
            fft_enter(&plane, scratch, table, floats);
        for (int i = 0; i < n; ++i) {
            const int at = 2 * place[i];
            float8 re = scratch[at], im = scratch[at + 1];
            fft_multiply(here, i, sign, &re, &im);
            if (!back && s > 0) {
                re += other[at];
                im += other[at + 1];
            }
            other[at] = re;
            other[at + 1] = im;
        }
        if (back)
            fft_leave(&plane, other, table, floats);
    }
    if (!back)
        fft_leave(&frame, other, table, floats);
}
