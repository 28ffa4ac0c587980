/* Transforms of one length by work-groups, with all constants known when compiling: a work-item holds its points of a
 * stage in registers, and stages exchange them through local memory. Stages are Stockham's: butterfly b of a stage of
 * radix R reads the points b + k n/R and writes (b / span) span R + b % span + k span, so that the output is in natural
 * order without a table of places. An inverse transform is a forward one with real and imaginary parts swapped before
 * and after.
 *
 * `radix` and `span` are literals in every call: they choose loops and registers, not branches. A file defines
 * FFT_ITEMS(radix), the items that share the butterflies of such a stage. */
#ifndef INC_FFT_SIZED_H
#define INC_FFT_SIZED_H

#define FFT_V float
#include "inc_fft_radix.h"
#include "inc_fft_radix_large.h"
#include "shared_fft_sizes.h"

#ifndef FFT_POINTS
#define FFT_POINTS 512
#endif
#ifndef FFT_INVERSE
#define FFT_INVERSE 0
#endif

/* The radices of a length, of its row in FFT_COLUMN_SIZES or FFT_ROW_SIZES. */
#define FFT_RADIX0(n, r0, r1, r2, r3, parts, width) (n == FFT_POINTS ? r0 : 0) +
#define FFT_RADIX1(n, r0, r1, r2, r3, parts, width) (n == FFT_POINTS ? r1 : 0) +
#define FFT_RADIX2(n, r0, r1, r2, r3, parts, width) (n == FFT_POINTS ? r2 : 0) +
#define FFT_RADIX3(n, r0, r1, r2, r3, parts, width) (n == FFT_POINTS ? r3 : 0) +

/* Written-out loops over the points of a butterfly and the rounds of a stage: compilers do not reliably unroll loops
 * whose bounds are constants only where a function is called, and arrays must live in registers. */
#define FFT_EACH_POINT(M) M(0) M(1) M(2) M(3) M(4) M(5) M(6) M(7) M(8) M(9) M(10) M(11) M(12) M(13) M(14) M(15)
#define FFT_MOST_ROUNDS   6
#define FFT_EACH_ROUND(M) M(0) M(1) M(2) M(3) M(4) M(5)

#define FFT_BUTTERFLIES(radix) (FFT_POINTS / (radix))
#define FFT_ROUNDS(radix)      ((FFT_BUTTERFLIES(radix) + FFT_ITEMS(radix) - 1) / FFT_ITEMS(radix))

/* Whether butterfly b of this round is there: a test only where the last round is not full. */
#define FFT_IS_THERE(radix, round, b)                                                                                  \
    (((round) + 1) * FFT_ITEMS(radix) <= FFT_BUTTERFLIES(radix) || (b) < FFT_BUTTERFLIES(radix))

/* Where butterfly b writes its first output. */
#define FFT_FIRST_OUTPUT(radix, span, b) ((b) / (span) * ((span) * (radix)) + (b) % (span))

FFT_INLINE void fft_butterfly(int radix, float *re, float *im)
{
    switch (radix) {
    case 2: fft_radix2(re, im); break;
    case 3: fft_radix3(re, im); break;
    case 4: fft_radix4(re, im); break;
    case 5: fft_radix5(re, im); break;
    case 6: fft_radix6(re, im); break;
    case 7: fft_radix7(re, im); break;
    case 8: fft_radix8(re, im); break;
    case 12: fft_radix12(re, im); break;
    case 16: fft_radix16(re, im); break;
    case FFT_ODD_RADIX: fft_odd_fold(re, im); break;
    default: break;
    }
}

#endif
