/* The run-time description of one pass of transforms of one length: the tables that the kernels of fft_rows_*.cl and
 * fft_rows_cols.cl read (their layout: kernels/shared_fft_table.h). Internal. */
#ifndef HADA_FFT_PASS_H
#define HADA_FFT_PASS_H

#include <stddef.h>
#include <stdint.h>

#include "core/error.h"

typedef enum hada_fft_pass_kind {
    HADA_PASS_COLUMNS = 0,     /* reads by FFT_SOURCE */
    HADA_PASS_ROWS = 1,        /* writes scratch by FFT_PLACE */
    HADA_PASS_ROWS_INVERSE = 2 /* likewise, by (n - i) % n */
} hada_fft_pass_kind;

typedef struct hada_fft_pass_desc {
    hada_fft_pass_kind kind;
    int n;
    int inverse;
    int direct; /* the first stage reads memory itself: it must be one of those that can */
    int across; /* tables of the last stage, a prime's, for items that take a butterfly each: twiddle factors stand by
                   input, then by butterfly; cosines and sines in pairs by input, then by output */
} hada_fft_pass_desc;

typedef struct hada_fft_pass {
    int n;
    int points; /* complex numbers of scratch for each transform */
    int32_t *ints;
    float *floats;
    size_t int_count, float_count;
} hada_fft_pass;

hada_status hada_fft_pass_make(hada_fft_pass *pass, const hada_fft_pass_desc *desc, hada_error *err);
void hada_fft_pass_free(hada_fft_pass *pass);

/* The points of scratch, whether a stage has no butterfly of its own, and the sizes of the tables that
 * hada_fft_pass_make() would give. */
void hada_fft_pass_sizes(int n, int direct, int *points, int *odd, size_t *int_count, size_t *float_count);

/* exp(-2 pi i k / n), rounded once. */
void hada_fft_root(long long k, long long n, float *out);

#endif
