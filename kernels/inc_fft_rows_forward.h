/* Real rows to half spectra: sixteen rows at a time, as the real and imaginary parts of eight complex transforms,
 * x + i y, whose spectra are taken apart: X[k] = (Z[k] + conj Z[n-k]) / 2 and Y[k] = (Z[k] - conj Z[n-k]) / 2i. */
#ifndef INC_FFT_ROWS_FORWARD_H
#define INC_FFT_ROWS_FORWARD_H

#include "inc_fft_lanes.h"

/* Where the half spectra are written to. */
#ifndef FFT_ROWS_OUT
#define FFT_ROWS_OUT __global
#endif

#define ROWS 16

/* Eight columns of sixteen rows, transposed: tile[c] the rows 0..7, tile[8 + c] the rows 8..15. */
FFT_INLINE void load_tile(__global const float *const *rows, int column, int count, float8 *tile)
{
    if (count == 8) {
        for (int i = 0; i < ROWS; ++i)
            tile[i] = vload8(0, rows[i] + column);
    } else {
        for (int i = 0; i < ROWS; ++i) {
            float line[8] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
            for (int c = 0; c < count; ++c)
                line[c] = rows[i][column + c];
            tile[i] = vload8(0, line);
        }
    }
    fft_transpose(tile);
    fft_transpose(tile + 8);
}

/* One column of a full tile to scratch. */
#define KEEP(c)                                                                                                        \
    scratch[2 * (i + c)] = tile[c];                                                                                    \
    scratch[2 * (i + c) + 1] = tile[8 + c];

/* The spectra x and y of two rows at the frequency k, from z = Z[k] and w = Z[n-k]. */
FFT_INLINE void take_apart(float8 zr, float8 zi, float8 wr, float8 wi, float8 *x, float8 *y)
{
    zr *= 0.5f;
    zi *= 0.5f;
    x[0] = fma(wr, (float8)0.5f, zr);
    x[1] = fma(wi, (float8)-0.5f, zi);
    y[0] = fma(wi, (float8)0.5f, zi);
    y[1] = fma(wr, (float8)0.5f, -zr);
}

/* At k = 8 block + c of a full tile. */
#define APART(c)                                                                                                       \
    {                                                                                                                  \
        FFT_MEM const float8 *z = scratch + 2 * low[c], *w = scratch + 2 * high[-c];                                   \
        take_apart(z[0], z[1], w[0], w[1], x + 2 * c, y + 2 * c);                                                      \
    }

/* The first `count` of sixteen rows, of which the columns col0..col0+cols_in-1 are in memory and the others are zero.
 * The first `blocks` blocks of eight columns by `rows` rows of the half spectra are made; `out` is the first row's
 * place in the first one. */
FFT_INLINE void fft_rows_forward_task(__global const float *in, ulong pitch, int count, int col0, int cols_in,
                                      FFT_ROWS_OUT float *out, int rows, int blocks, FFT_MEM float8 *scratch,
                                      __global const int *table, __global const float *floats)
{
    const int n = table[FFT_LENGTH], points = table[FFT_POINTS], chirped = table[FFT_CHIRP] != 0;
    __global const int *place = table + table[FFT_PLACE];
    __global const float *chirp = floats + table[FFT_CHIRP];
    __global const float *row[ROWS];
    for (int i = 0; i < ROWS; ++i) /* rows beyond the image repeat its last row */
        row[i] = in + (ulong)min(i, count - 1) * pitch;

    if (chirped) {
        for (int i = 0; i < 2 * points; ++i)
            scratch[i] = (float8)0.0f;
    } else {
        for (int i = 0; i < 2 * col0; ++i)
            scratch[i] = (float8)0.0f;
        for (int i = 2 * (col0 + cols_in); i < 2 * n; ++i)
            scratch[i] = (float8)0.0f;
    }
    for (int done = 0; done < cols_in; done += 8) {
        /* the last tile of eight overlaps the one before */
        const int start = min(done, max(cols_in - 8, 0)), width = min(8, cols_in - start);
        float8 tile[ROWS];
        load_tile(row, start, width, tile);
        if (width == 8 && !chirped) {
            const int i = col0 + start;
            FFT_EACH(8, KEEP)
            continue;
        }
        for (int c = 0; c < width; ++c) {
            const int i = col0 + start + c;
            float8 re = tile[c], im = tile[8 + c];
            if (chirped)
                fft_times_twiddle(&re, &im, chirp[2 * i], chirp[2 * i + 1]);
            scratch[2 * (chirped ? place[i] : i)] = re;
            scratch[2 * (chirped ? place[i] : i) + 1] = im;
        }
    }
    if (chirped) {
        fft_stages(scratch, table, floats, 0, table[FFT_STAGES]);
        fft_convolve(scratch, table, floats);
    } else { /* backwards, where what is 0 is left out of the largest radix; frequency k stands at place[k] then */
        fft_stage(scratch, table, floats, table[FFT_STAGES] - 1, 0, n, 1, col0, cols_in);
        fft_unstages(scratch, table, floats, table[FFT_STAGES] - 1);
    }

    for (int block = 0; block < blocks; ++block) {
        float8 x[ROWS], y[ROWS];
        if (!chirped && block > 0 && 8 * block + 7 <= n / 2) {
            __global const int *low = place + 8 * block, *high = place + n - 8 * block;
            FFT_EACH(8, APART)
        } else {
            for (int c = 0; c < 8; ++c) {
                const int k = 8 * block + c;
                if (k > n / 2) {
                    x[2 * c] = x[2 * c + 1] = y[2 * c] = y[2 * c + 1] = (float8)0.0f;
                    continue;
                }
                const int mirror = k ? n - k : 0;
                float8 zr, zi, wr, wi;
                if (chirped) {
                    zr = scratch[2 * place[k] + 1];
                    zi = scratch[2 * place[k]];
                    wr = scratch[2 * place[mirror] + 1];
                    wi = scratch[2 * place[mirror]];
                    fft_times_twiddle(&zr, &zi, chirp[2 * k], chirp[2 * k + 1]);
                    fft_times_twiddle(&wr, &wi, chirp[2 * mirror], chirp[2 * mirror + 1]);
                } else {
                    zr = scratch[2 * place[k]];
                    zi = scratch[2 * place[k] + 1];
                    wr = scratch[2 * place[mirror]];
                    wi = scratch[2 * place[mirror] + 1];
                }
                take_apart(zr, zi, wr, wi, x + 2 * c, y + 2 * c);
            }
        }
        fft_transpose(x);
        fft_transpose(x + 8);
        fft_transpose(y);
        fft_transpose(y + 8);
        FFT_ROWS_OUT float *p = out + (size_t)block * (size_t)rows * 16;
        for (int i = 0; i < min(8, count); ++i) {
            VECTORS_STORE8(FFT_ROWS_OUT, x[i], p + 16 * i);
            VECTORS_STORE8(FFT_ROWS_OUT, x[8 + i], p + 16 * i + 8);
        }
        for (int i = 8; i < count; ++i) {
            VECTORS_STORE8(FFT_ROWS_OUT, y[i - 8], p + 16 * i);
            VECTORS_STORE8(FFT_ROWS_OUT, y[i], p + 16 * i + 8);
        }
    }
}

#endif
