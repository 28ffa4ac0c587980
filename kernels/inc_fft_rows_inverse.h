/* Half spectra to real rows: sixteen rows at a time, by eight complex transforms Z = X + i Y whose real and imaginary
 * parts are the rows. */
#ifndef INC_FFT_ROWS_INVERSE_H
#define INC_FFT_ROWS_INVERSE_H

#include "inc_fft_lanes.h"

/* Where the half spectra are read from. */
#ifndef FFT_ROWS_IN
#define FFT_ROWS_IN __global
#endif

#define ROWS 16

/* Puts the value of frequency i where the transform expects its input number (n - i) % n, which makes a forward
 * transform an inverse one: the list FFT_PLACE of this pass counts backwards already, the chirp does not. */
FFT_INLINE void keep(FFT_MEM float8 *scratch, __global const int *place, int n, int i, float8 re, float8 im,
                     int chirped, __global const float *chirp)
{
    chirp += i ? 2 * (n - i) : 0;
    if (chirped)
        fft_times_twiddle(&re, &im, chirp[0], chirp[1]);
    scratch[2 * place[i]] = re;
    scratch[2 * place[i] + 1] = im;
}

/* Asks for the rows of the next block early: blocks lie further apart than caches look ahead by themselves. */
FFT_INLINE void fft_fetch_ahead(FFT_ROWS_IN const float *block, int rows)
{
#ifdef POCL_DEVICE_ADDRESS_BITS /* whose compiler knows the way; some simulators do not */
    for (int i = 0; i < rows; ++i)
        __builtin_prefetch((const void *)(size_t)(block + 16 * i));
#endif
}

/* Puts two rows' spectra together, at the frequency k = 8 block + c, to Z[k] and Z[n-k] in their places. */
#define TOGETHER(c)                                                                                                    \
    {                                                                                                                  \
        const float8 xr = x[2 * c], xi = x[2 * c + 1];                                                                 \
        const float8 yr = y[2 * c], yi = y[2 * c + 1];                                                                 \
        FFT_MEM float8 *z = scratch + 2 * low[c], *w = scratch + 2 * high[-c];                                         \
        z[0] = xr - yi;                                                                                                \
        z[1] = xi + yr;                                                                                                \
        w[0] = xr + yi;                                                                                                \
        w[1] = yr - xi;                                                                                                \
    }

/* One column of a full tile of the output. */
#define SCALE(c)                                                                                                       \
    x[c] = z[2 * c] * scale;                                                                                           \
    y[c] = z[2 * c + 1] * scale;

/* The first `count` of sixteen rows. The input holds `rows_in` rows in blocks of eight columns, `in` is the first row's
 * place in the first block; values at kx > band are taken as zero. Imaginary parts at kx = 0 and n/2 have no meaning
 * and are ignored. Columns col0..col0+cols_out-1 are stored, times `scale`. */
FFT_INLINE void fft_rows_inverse_task(FFT_ROWS_IN const float *in, int rows_in, int count, int band,
                                      __global float *out, ulong pitch, int col0, int cols_out, float scale,
                                      FFT_MEM float8 *scratch, __global const int *table, __global const float *floats)
{
    const int n = table[FFT_LENGTH], points = table[FFT_POINTS], chirped = table[FFT_CHIRP] != 0;
    __global const int *place = table + table[FFT_PLACE];
    __global const float *chirp = floats + table[FFT_CHIRP];
    if (chirped || band < n / 2) {
        for (int i = 0; i < 2 * points; ++i)
            scratch[i] = (float8)0.0f;
    }
    for (int block = 0; block <= band / 8; ++block) {
        FFT_ROWS_IN const float *p = in + (size_t)block * (size_t)rows_in * 16;
        float8 x[ROWS], y[ROWS];
        if (block < band / 8)
            fft_fetch_ahead(p + (size_t)rows_in * 16, count);
        for (int i = 0; i < 8; ++i) { /* rows beyond the image repeat its last row */
            FFT_ROWS_IN const float *q = p + 16 * min(i, count - 1), *r = p + 16 * min(8 + i, count - 1);
            x[i] = vload8(0, q);
            x[8 + i] = vload8(1, q);
            y[i] = vload8(0, r);
            y[8 + i] = vload8(1, r);
        }
        fft_transpose(x);
        fft_transpose(x + 8);
        fft_transpose(y);
        fft_transpose(y + 8);
        if (!chirped && block > 0 && 8 * block + 7 <= band && 16 * block + 14 < n) {
            __global const int *low = place + 8 * block, *high = place + n - 8 * block;
            FFT_EACH(8, TOGETHER)
            continue;
        }
        for (int c = 0; c < 8; ++c) {
            const int k = 8 * block + c;
            if (k > band)
                break;
            const float8 xr = x[2 * c], xi = x[2 * c + 1], yr = y[2 * c], yi = y[2 * c + 1];
            if (k == 0 || 2 * k == n) {
                keep(scratch, place, n, k, xr, yr, chirped, chirp);
            } else {
                keep(scratch, place, n, k, xr - yi, xi + yr, chirped, chirp);
                keep(scratch, place, n, n - k, xr + yi, yr - xi, chirped, chirp);
            }
        }
    }
    fft_stages(scratch, table, floats, 0, table[FFT_STAGES] - !chirped);
    if (chirped)
        fft_convolve(scratch, table, floats);
    else
        fft_stage(scratch, table, floats, table[FFT_STAGES] - 1, 0, points, 0, col0, cols_out);

    for (int done = 0; done < cols_out; done += 8) {
        const int start = min(done, max(cols_out - 8, 0)), width = min(8, cols_out - start);
        float8 x[8], y[8];
        if (width == 8 && !chirped) {
            FFT_MEM const float8 *z = scratch + 2 * (col0 + start);
            FFT_EACH(8, SCALE)
        } else {
            for (int c = 0; c < 8; ++c) {
                const int i = col0 + start + min(c, width - 1);
                float8 re, im;
                if (chirped) {
                    /* outputs stand where the forward order has them: place[(n - i) % n] */
                    const int at = place[i ? n - i : 0];
                    re = scratch[2 * at + 1];
                    im = scratch[2 * at];
                    fft_times_twiddle(&re, &im, chirp[2 * i], chirp[2 * i + 1]);
                } else {
                    re = scratch[2 * i];
                    im = scratch[2 * i + 1];
                }
                x[c] = re * scale;
                y[c] = im * scale;
            }
        }
        fft_transpose(x);
        fft_transpose(y);
        if (width == 8) {
            for (int i = 0; i < min(8, count); ++i)
                VECTORS_STORE8(__global, x[i], out + (ulong)i * pitch + start);
            for (int i = 8; i < count; ++i)
                VECTORS_STORE8(__global, y[i - 8], out + (ulong)i * pitch + start);
        } else {
            for (int i = 0; i < count; ++i) {
                float line[8];
                vstore8(i < 8 ? x[i] : y[i - 8], 0, line);
                for (int c = 0; c < width; ++c)
                    out[(ulong)i * pitch + start + c] = line[c];
            }
        }
    }
}

#endif
