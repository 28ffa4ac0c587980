/* Lengths of transforms: their stages, and which are good. Internal. */
#ifndef HADA_CORE_FFT_FACTOR_H
#define HADA_CORE_FFT_FACTOR_H

#define HADA_FFT_MAX_STAGES 32

typedef struct hada_fft_stages {
    int points; /* n, or a longer smooth length for a chirp convolution */
    int chirp;  /* n has a prime factor too large for a stage of its own */
    int count;
    int radix[HADA_FFT_MAX_STAGES];
} hada_fft_stages;

/* Whether n has no prime factors but 2, 3, 5 and 7. */
int hada_fft_smooth(int n);

/* The smallest size >= n that transforms well (2^a 3^b 5^c 7^d, even). */
int hada_fft_good_size(int n);

/* Splits a length into stages, in the order in which they run. `columns`: the first stage must be one that reads
 * memory (radix 1, 4 or 8) and there must be two at least. */
void hada_fft_factor(int n, int columns, hada_fft_stages *stages);

#endif
