/* Convolutions along columns of half spectra, in scratch: the stages of a forward transform backwards, a product with a
 * transfer function, and the stages forwards. The backward stages take natural order and leave row r at the point
 * FFT_PLACE[r], which is the order that the forward stages begin with, so nothing is reordered; with real and imaginary
 * parts swapped in the middle and at the end, the second transform is the inverse one. The largest radix comes first
 * and last, where it reads and computes only the rows that are needed. For any length that needs no chirp. */
#ifndef INC_FFT_CONVOLVE_H
#define INC_FFT_CONVOLVE_H

#include "inc_fft_cols.h"

/* Block number `number` of columns of which only the rows from row0 on are stored. */
FFT_INLINE fft_columns fft_window_block(__global float *blocks, size_t number, int row0, int rows)
{
    fft_columns columns;
    __global float *start = blocks + number * (size_t)rows * 16;
    columns.in = start - row0 * 16;
    columns.out = start;
    columns.first = row0;
    columns.count = rows;
    columns.last = INT_MAX;
    columns.row0 = row0;
    columns.rows_out = rows;
    columns.swapped = 1;
    return columns;
}

/* The last stage backwards, from memory to scratch. */
#define FFT_TAKE(k) fft_get(columns, j + k * span, &re[k], &im[k]);
#define FFT_BEGIN(R)                                                                                                   \
    FFT_INLINE void fft_begin##R(const fft_columns *columns, FFT_MEM float8 *scratch, int span,                        \
                                 __global const float *w)                                                              \
    {                                                                                                                  \
        FFT_MEM float8 *q = scratch;                                                                                   \
        for (int j = 0; j < span; ++j, q += 2, w += 2 * (R - 1)) {                                                     \
            float8 re[R], im[R];                                                                                       \
            FFT_EACH(R, FFT_TAKE)                                                                                      \
            fft_radix##R(re, im);                                                                                      \
            FFT_AFTER_FIRST_##R(FFT_TIMES_TWIDDLE);                                                                    \
            FFT_EACH(R, FFT_LEAVE)                                                                                     \
        }                                                                                                              \
    }

FFT_BEGIN(1)
FFT_EACH_RADIX(FFT_BEGIN)

/* The inputs of an odd-length butterfly, rows j, j + span, ... */
FFT_INLINE void fft_odd_get(fft_odd *odd, const fft_columns *columns, int radix, int span, int j)
{
    fft_odd_range(odd, radix, span, j, columns->first, columns->first + columns->count);
    fft_get(columns, j, &odd->re, &odd->im);
    for (int k = odd->from + 1; k <= odd->to; ++k) {
        float8 xr, xi, yr, yi;
        fft_get(columns, j + k * span, &xr, &xi);
        fft_get(columns, j + (radix - k) * span, &yr, &yi);
        fft_odd_pair(odd, k, xr, xi, yr, yi);
    }
}

FFT_INLINE void fft_begin_odd(const fft_columns *columns, FFT_MEM float8 *scratch, int radix, int span,
                              __global const float *twiddles, __global const float *cosines)
{
    for (int j = 0; j < span; ++j) {
        fft_odd odd;
        fft_odd_get(&odd, columns, radix, span, j);
        fft_odd_give(&odd, radix, scratch + 2 * j, span, twiddles + (size_t)(2 * (radix - 1)) * (size_t)j, cosines);
    }
}

/* Input to scratch, through all stages. */
FFT_INLINE void fft_enter(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table,
                          __global const float *floats)
{
    __global const int *stage = table + FFT_HEADER + (table[FFT_STAGES] - 1) * FFT_STAGE_INTS;
    const int radix = stage[FFT_RADIX], span = stage[FFT_SPAN];
    __global const float *w = floats + stage[FFT_TWIDDLES];
    switch (radix) {
    case 1:
        fft_begin1(columns, scratch, span, w);
        break;
        FFT_CASES(fft_begin, (columns, scratch, span, w))
    default: fft_begin_odd(columns, scratch, radix, span, w, floats + stage[FFT_COSINES]); break;
    }
    fft_unstages(scratch, table, floats, table[FFT_STAGES] - 1);
}

/* Through all stages, and from scratch to output. */
FFT_INLINE void fft_leave(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table,
                          __global const float *floats)
{
    fft_stages(scratch, table, floats, 0, table[FFT_STAGES] - 1);
    fft_last(columns, scratch, table, floats);
}

/* (re, im) of a row times the transfer function's value there, its imaginary part times `sign`; parts changed over. */
FFT_INLINE void fft_multiply(__global const float *h, int row, float sign, float8 *re, float8 *im)
{
    __global const float *p = h + (size_t)row * 16;
    const float8 x = *re, y = *im;
    float8 hr, hi;
    lanes_apart(vload8(0, p), vload8(1, p), &hr, &hi);
    hi *= sign;
    *re = fma(x, hi, y * hr);
    *im = fma(x, hr, -(y * hi));
}

#endif
