/* Lengths whose transforms by work-groups have programs of their own (FFT_POINTS of fft_sized_*.cl), and their stages.
 *
 * Columns, M(points, radix 0, 1, 2, 3, parts, group): a group takes the eight columns of a block; or half of them where
 * local memory and registers take no more, which is `parts` 2: 32 bytes of a row still are a whole sector of DRAM.
 * Rows, M(points, radix 0, 1, 2, 3, items, width): `items` share a transform, and a group has `width` of them. The
 * first radix forward, which is the last one back, reads or writes four points in a row: it is 4.
 * Radices of 1 are no stages. A prime without a butterfly of its own in a register or two (43) stands first among the
 * columns' stages, where it needs no twiddle factors. */
#ifndef SHARED_FFT_SIZES_H
#define SHARED_FFT_SIZES_H

#define FFT_COLUMN_SIZES(M)                                                                                            \
    M(128, 8, 4, 4, 1, 1, 64)                                                                                          \
    M(256, 8, 8, 4, 1, 1, 128)                                                                                         \
    M(512, 8, 8, 8, 1, 1, 256)                                                                                         \
    M(720, 8, 6, 5, 3, 1, 180)                                                                                         \
    M(768, 16, 16, 3, 1, 1, 192)                                                                                       \
    M(1024, 16, 8, 8, 1, 1, 256)                                                                                       \
    M(1376, 43, 8, 4, 1, 1, 256)                                                                                       \
    M(2048, 16, 16, 8, 1, 2, 256)                                                                                      \
    M(2064, 43, 8, 6, 1, 2, 192)

#define FFT_ROW_SIZES(M)                                                                                               \
    M(128, 4, 4, 8, 1, 8, 16)                                                                                          \
    M(256, 4, 8, 8, 1, 16, 8)                                                                                          \
    M(512, 4, 8, 16, 1, 32, 4)                                                                                         \
    M(720, 4, 6, 6, 5, 45, 4)                                                                                          \
    M(768, 4, 8, 8, 3, 48, 4)                                                                                          \
    M(1024, 4, 16, 16, 1, 64, 2)                                                                                       \
    M(1376, 4, 43, 8, 1, 32, 2)                                                                                        \
    M(2048, 4, 8, 8, 8, 128, 1)                                                                                        \
    M(2064, 4, 43, 12, 1, 48, 2)

/* Points of local memory that a group's transforms take, for each column or pair of rows: after each butterfly of an
 * even first radix, or after so many points, one or two are left out, against bank conflicts. */
#define FFT_COLUMN_PAD(r0)       ((r0) % 2 ? 0 : (r0))
#define FFT_COLUMN_PLACES(n, r0) ((n) + ((r0) % 2 ? 0 : (n) / (r0)))
#define FFT_ROW_BANK             16
#define FFT_ROW_PLACES(n)        ((n) / FFT_ROW_BANK * (FFT_ROW_BANK + 2))

/* Pairs of twiddle factors of a stage: those of inputs k = 1 and 2 for each j = b % span, then of 3 and 4, ... */
#define FFT_TWIDDLE_PAIRS(radix, span) ((span) > 1 ? (radix) / 2 * (span) : 0)

/* The prime that work-groups have by its definition in registers (inc_fft_radix_large.h). */
#define FFT_ODD_RADIX 43

/* The largest radix whose butterflies take several columns or points of an item at a time. */
#define FFT_LARGEST_BUTTERFLY 16

#endif
