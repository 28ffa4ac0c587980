/* Convolutions along columns of half spectra, in scratch: the stages of a forward transform, a product with a transfer
 * function, and the stages backwards. Those take natural order and leave the digit-reversed order of the input, so
 * that nothing is put in order between the two transforms; with real and imaginary parts changed over in the middle,
 * and once more at the end, they are the inverse. For lengths whose stages all have butterflies. */
#ifndef INC_FFT_CONVOLVE_H
#define INC_FFT_CONVOLVE_H

#include "inc_fft_cols.h"

/* Block `number` of those that hold some rows of a column alone, from row0 on, where it is read and written. */
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
    return columns;
}

/* Input to scratch and through the stages 1 .. last-1. */
FFT_INLINE void fft_enter(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table,
                          __global const float *floats, int last)
{
    fft_first(columns, scratch, table);
    for (int i = 0; i <= table[FFT_POINTS] / table[FFT_CHUNK]; ++i) {
        const fft_part part = fft_part_of(table, i);
        for (int s = max(part.first, 1); s < min(part.last, last); ++s)
            fft_stage(scratch, table, floats, s, part.from, part.to, 0, table[FFT_LENGTH]);
    }
}

/* The first stage backwards, from scratch to memory. */
#define FFT_OUT(k) fft_put(columns, i + k * blocks, im[k], re[k]);
#define FFT_BACK(k)                                                                                                    \
    re[k] = q[2 * k];                                                                                                  \
    im[k] = q[2 * k + 1];
#define FFT_END(R)                                                                                                     \
    FFT_INLINE void fft_end##R(const fft_columns *columns, FFT_MEM const float8 *scratch, __global const int *place,   \
                               int blocks)                                                                             \
    {                                                                                                                  \
        for (int i = 0; i < blocks; ++i) {                                                                             \
            FFT_MEM const float8 *q = scratch + 2 * place[i];                                                          \
            float8 re[R], im[R];                                                                                       \
            FFT_EACH(R, FFT_BACK)                                                                                      \
            fft_radix##R(re, im);                                                                                      \
            FFT_EACH(R, FFT_OUT)                                                                                       \
        }                                                                                                              \
    }

FFT_END(1)
FFT_END(4)
FFT_END(8)

/* The stages last-1 .. 1 backwards, and output. */
FFT_INLINE void fft_leave(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table,
                          __global const float *floats, int last)
{
    __global const int *place = table + table[FFT_PLACE];
    const int n = table[FFT_LENGTH];
    for (int s = last - 1; s >= 1; --s)
        fft_unstage(scratch, table, floats, s);
    switch (table[FFT_HEADER + FFT_RADIX]) {
    case 4: fft_end4(columns, scratch, place, n / 4); break;
    case 8: fft_end8(columns, scratch, place, n / 8); break;
    default: fft_end1(columns, scratch, place, n); break;
    }
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

/* The last stage, the product and the last stage backwards, in registers. */
#define FFT_TIMES(k) fft_multiply(h, j + k * span, sign, &re[k], &im[k]);
#define FFT_MIDDLE(R)                                                                                                  \
    FFT_INLINE void fft_middle##R(FFT_MEM float8 *scratch, int span, __global const float *w, __global const float *h, \
                                  float sign)                                                                          \
    {                                                                                                                  \
        FFT_MEM float8 *q = scratch;                                                                                   \
        for (int j = 0; j < span; ++j, q += 2, w += 2 * (R - 1)) {                                                     \
            float8 re[R], im[R];                                                                                       \
            FFT_EACH(R, FFT_FETCH)                                                                                     \
            FFT_AFTER_FIRST_##R(FFT_TIMES_TWIDDLE);                                                                    \
            fft_radix##R(re, im);                                                                                      \
            FFT_EACH(R, FFT_TIMES)                                                                                     \
            fft_radix##R(re, im);                                                                                      \
            FFT_AFTER_FIRST_##R(FFT_TIMES_TWIDDLE);                                                                    \
            FFT_EACH(R, FFT_LEAVE)                                                                                     \
        }                                                                                                              \
    }

FFT_MIDDLE(1)
FFT_MIDDLE(2)
FFT_MIDDLE(3)
FFT_MIDDLE(4)
FFT_MIDDLE(5)
FFT_MIDDLE(7)
FFT_MIDDLE(8)

FFT_INLINE void fft_middle(FFT_MEM float8 *scratch, __global const int *table, __global const float *floats,
                           __global const float *h, float sign)
{
    __global const int *stage = table + FFT_HEADER + (table[FFT_STAGES] - 1) * FFT_STAGE_INTS;
    const int span = stage[FFT_SPAN];
    __global const float *w = floats + stage[FFT_TWIDDLES];
    switch (stage[FFT_RADIX]) {
    case 1: fft_middle1(scratch, span, w, h, sign); break;
    case 2: fft_middle2(scratch, span, w, h, sign); break;
    case 3: fft_middle3(scratch, span, w, h, sign); break;
    case 4: fft_middle4(scratch, span, w, h, sign); break;
    case 5: fft_middle5(scratch, span, w, h, sign); break;
    case 7: fft_middle7(scratch, span, w, h, sign); break;
    default: fft_middle8(scratch, span, w, h, sign); break;
    }
}

#endif
