/* Arguments of the transforms' kernels. Offsets and distances of real images count floats, those of spectra and filters
 * complex numbers. */
#ifndef SHARED_FFT_H
#define SHARED_FFT_H

#include "shared_types.h"

/* Columns of a block of the library's own spectra. */
#define HADA_FFT_BLOCK 8

/* Real images of a rectangle: its place within the transform and its size. */
typedef struct hada_fft_real {
    hada_ulong offset, distance, pitch;
    int row0, col0, rows, cols;
    int images;
    float scale; /* inverse: what is stored is times this */
} hada_fft_real;
HADA_SHARED_SIZE(hada_fft_real, 48)

/* Half spectra that rows become or are made of, up to the frequency kx = band. */
typedef struct hada_fft_spectra {
    hada_ulong offset, distance;
    int rows, band;
} hada_fft_spectra;
HADA_SHARED_SIZE(hada_fft_spectra, 24)

/* The input of columns: spectrum (first + image) % count times a filter for each image, up to the frequency kx = band;
 * the rows first_row ... first_row + rows - 1 and those from last_row on, the others are zero. */
typedef struct hada_fft_columns_in {
    hada_ulong offset, distance, filter_offset, filter_distance;
    int count, first;
    int first_row, rows, last_row;
    int band;
} hada_fft_columns_in;
HADA_SHARED_SIZE(hada_fft_columns_in, 56)

/* The output of columns: rows from row0 on. */
typedef struct hada_fft_columns_out {
    hada_ulong offset, distance;
    int row0, rows;
    int images;
} hada_fft_columns_out;
HADA_SHARED_SIZE(hada_fft_columns_out, 32)

/* A spectrum's size, and the band outside which it is zero. */
typedef struct hada_fft_band {
    int rows, cols;
    int band_rows, band_cols;
} hada_fft_band;
HADA_SHARED_SIZE(hada_fft_band, 16)

#endif
