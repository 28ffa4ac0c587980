/* Transforms along the columns of half spectra, a block of eight columns at a time. The direction and the order of the
 * input are in the table; while the input is read it can be multiplied by a filter. Input rows that are neither among
 * first..first+count-1 nor last..n-1 are zero and not read; output rows outside row0..row0+rows_out-1 are not
 * computed. */
#ifndef INC_FFT_COLS_H
#define INC_FFT_COLS_H

#include "inc_fft_lanes.h"
#include "inc_fft_product.h"
#include "shared_fft.h"

/* Where the columns are read from and written to. */
#ifndef FFT_COLS_IN
#define FFT_COLS_IN __global
#endif
#ifndef FFT_COLS_OUT
#define FFT_COLS_OUT __global
#endif

typedef struct fft_columns {
    FFT_COLS_IN const float *in;
    __global const filter_value *filter;
    FFT_COLS_OUT float *out;
    int first, count, last;
    int row0, rows_out;
    int swapped; /* whether real and imaginary parts are changed over on output */
} fft_columns;

/* Block number `block` of an image's columns of n rows, from the list that `from` describes. */
FFT_INLINE fft_columns fft_columns_of(FFT_COLS_IN const float *in, hada_fft_columns_in from,
                                      __global const void *filter, int image, int block, int n, FFT_COLS_OUT float *out,
                                      int row0, int rows_out)
{
    fft_columns columns;
    columns.in = in + 2 * (from.offset + (ulong)((from.first + image) % from.count) * from.distance +
                           (ulong)block * (ulong)n * 8);
    columns.out = out;
    columns.first = from.first_row;
    columns.count = from.rows;
    columns.last = from.last_row;
    columns.row0 = row0;
    columns.rows_out = rows_out;
    columns.swapped = 0;
    columns.filter = (__global const filter_value *)filter;
#if FFT_PRODUCT
    columns.filter += 2 * (from.filter_offset + (ulong)image * from.filter_distance + (ulong)block * (ulong)n * 8);
#endif
    return columns;
}

FFT_INLINE void fft_get(const fft_columns *columns, int row, float8 *re, float8 *im)
{
    if ((uint)(row - columns->first) >= (uint)columns->count && row < columns->last) {
        *re = (float8)0.0f;
        *im = (float8)0.0f;
        return;
    }
    FFT_COLS_IN const float *p = columns->in + (size_t)row * 16;
    lanes_apart(vload8(0, p), vload8(1, p), re, im);
#if FFT_PRODUCT
    float8 wr, wi;
    __global const filter_value *w = columns->filter + (size_t)row * 16;
    lanes_apart(load_filter(w), load_filter(w + 8), &wr, &wi);
#if FFT_PRODUCT == 1
    const float8 xr = *re, xi = *im;
    *re = fma(xr, wr, -(xi * wi));
    *im = fma(xr, wi, xi * wr);
#else
    *re *= wr;
    *im *= wi;
#endif
#endif
}

FFT_INLINE void fft_put(const fft_columns *columns, int row, float8 re, float8 im)
{
    const int r = row - columns->row0;
    if ((uint)r < (uint)columns->rows_out) {
        FFT_COLS_OUT float *p = columns->out + (size_t)r * 16;
        VECTORS_STORE8(FFT_COLS_OUT, columns->swapped ? lanes_low(im, re) : lanes_low(re, im), p);
        VECTORS_STORE8(FFT_COLS_OUT, columns->swapped ? lanes_high(im, re) : lanes_high(re, im), p + 8);
    }
}

FFT_INLINE int fft_wanted(const fft_columns *columns, int row)
{
    return (uint)(row - columns->row0) < (uint)columns->rows_out;
}

/* The first stage, from memory to scratch: walks through the memory in order, as R streams of rows (which caches fetch
 * ahead), and puts each butterfly's values in their place of the digit-reversed order. */
#define FFT_GET(k) fft_get(columns, source[i + k * blocks], &re[k], &im[k]);
#define FFT_KEEP(k)                                                                                                    \
    q[2 * k] = re[k];                                                                                                  \
    q[2 * k + 1] = im[k];
#define FFT_FIRST(R)                                                                                                   \
    FFT_INLINE void fft_first##R(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *source,      \
                                 __global const int *place, int blocks)                                                \
    {                                                                                                                  \
        for (int i = 0; i < blocks; ++i) {                                                                             \
            FFT_MEM float8 *q = scratch + 2 * place[i];                                                                \
            float8 re[R], im[R];                                                                                       \
            FFT_EACH(R, FFT_GET)                                                                                       \
            fft_radix##R(re, im);                                                                                      \
            FFT_EACH(R, FFT_KEEP)                                                                                      \
        }                                                                                                              \
    }

FFT_FIRST(1)
FFT_FIRST(4)
FFT_FIRST(8)

FFT_INLINE void fft_first(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table)
{
    __global const int *source = table + table[FFT_SOURCE], *place = table + table[FFT_PLACE];
    const int n = table[FFT_LENGTH];
    switch (table[FFT_HEADER + FFT_RADIX]) {
    case 4: fft_first4(columns, scratch, source, place, n / 4); break;
    case 8: fft_first8(columns, scratch, source, place, n / 8); break;
    default: fft_first1(columns, scratch, source, place, n); break;
    }
}

/* The last stage, from scratch to memory. */
#define FFT_PUT(k) fft_put(columns, j + k * span, re[k], im[k]);
#define FFT_LAST(R)                                                                                                    \
    FFT_INLINE void fft_last##R(const fft_columns *columns, FFT_MEM float8 *scratch, int span,                         \
                                __global const float *w)                                                               \
    {                                                                                                                  \
        FFT_MEM float8 *q = scratch;                                                                                   \
        for (int j = 0; j < span; ++j, q += 2, w += 2 * (R - 1)) {                                                     \
            float8 re[R], im[R];                                                                                       \
            FFT_EACH(R, FFT_FETCH)                                                                                     \
            FFT_AFTER_FIRST_##R(FFT_TIMES_TWIDDLE);                                                                    \
            fft_radix##R(re, im);                                                                                      \
            FFT_EACH(R, FFT_PUT)                                                                                       \
        }                                                                                                              \
    }

FFT_LAST(1)
FFT_EACH_RADIX(FFT_LAST)

FFT_INLINE void fft_last_odd(const fft_columns *columns, FFT_MEM float8 *scratch, int radix, int span,
                             __global const float *twiddles, __global const float *cosines)
{
    for (int j = 0; j < span; ++j) {
        fft_odd odd;
        fft_odd_all(&odd, radix);
        fft_odd_take(&odd, radix, scratch + 2 * j, span, twiddles + (size_t)(2 * (radix - 1)) * (size_t)j);
        if (fft_wanted(columns, j)) {
            float8 re, im;
            fft_odd_first(&odd, &re, &im);
            fft_put(columns, j, re, im);
        }
        for (int m = 1; m <= radix / 2; m += FFT_ODD_GROUP) {
            const int count = min(FFT_ODD_GROUP, radix / 2 - m + 1);
            int wanted = 0;
            for (int g = 0; g < count; ++g)
                wanted |= fft_wanted(columns, j + (m + g) * span) | fft_wanted(columns, j + (radix - m - g) * span);
            if (!wanted)
                continue;
            fft_odd_group(&odd, radix, m / FFT_ODD_GROUP, cosines);
            for (int g = 0; g < count; ++g) {
                fft_put(columns, j + (m + g) * span, odd.low_re[g], odd.low_im[g]);
                fft_put(columns, j + (radix - m - g) * span, odd.high_re[g], odd.high_im[g]);
            }
        }
    }
}

FFT_INLINE void fft_last(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table,
                         __global const float *floats)
{
    __global const int *stage = table + FFT_HEADER + (table[FFT_STAGES] - 1) * FFT_STAGE_INTS;
    const int radix = stage[FFT_RADIX], span = stage[FFT_SPAN];
    __global const float *w = floats + stage[FFT_TWIDDLES];
    switch (radix) {
    case 1:
        fft_last1(columns, scratch, span, w);
        break;
        FFT_CASES(fft_last, (columns, scratch, span, w))
    default: fft_last_odd(columns, scratch, radix, span, w, floats + stage[FFT_COSINES]); break;
    }
}

/* Lengths with a large prime factor are done as a convolution with a chirp: input times chirp to scratch, ... */
FFT_INLINE void fft_chirp_in(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table,
                             __global const float *floats)
{
    __global const int *source = table + table[FFT_SOURCE], *place = table + table[FFT_PLACE];
    __global const float *chirp = floats + table[FFT_CHIRP];
    for (int i = 0; i < 2 * table[FFT_POINTS]; ++i)
        scratch[i] = (float8)0.0f;
    for (int i = 0; i < table[FFT_LENGTH]; ++i) {
        float8 re, im;
        fft_get(columns, source[i], &re, &im);
        fft_times_twiddle(&re, &im, chirp[2 * i], chirp[2 * i + 1]);
        scratch[2 * place[i]] = re;
        scratch[2 * place[i] + 1] = im;
    }
}

/* ... and the result times chirp to memory. */
FFT_INLINE void fft_chirp_out(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table,
                              __global const float *floats)
{
    __global const int *place = table + table[FFT_PLACE];
    __global const float *chirp = floats + table[FFT_CHIRP];
    for (int i = columns->row0; i < columns->row0 + columns->rows_out; ++i) {
        float8 re = scratch[2 * place[i] + 1], im = scratch[2 * place[i]];
        fft_times_twiddle(&re, &im, chirp[2 * i], chirp[2 * i + 1]);
        fft_put(columns, i, re, im);
    }
}

/* One block of columns. */
FFT_INLINE void fft_columns_block(const fft_columns *columns, FFT_MEM float8 *scratch, __global const int *table,
                                  __global const float *floats)
{
    const int chirp = table[FFT_CHIRP] != 0;
    if (chirp)
        fft_chirp_in(columns, scratch, table, floats);
    else
        fft_first(columns, scratch, table);
    fft_stages(scratch, table, floats, chirp ? 0 : 1, table[FFT_STAGES] - (chirp ? 0 : 1));
    if (chirp) {
        fft_convolve(scratch, table, floats);
        fft_chirp_out(columns, scratch, table, floats);
    } else {
        fft_last(columns, scratch, table, floats);
    }
}

#endif
