/* The run-time description of one pass of transforms: an int table made by the host (lib/fft/fft_pass.c), so that one
 * program is enough for every length. A header, then five ints for each stage, then index lists; then the floats. */
#ifndef SHARED_FFT_TABLE_H
#define SHARED_FFT_TABLE_H

#define FFT_LENGTH         0 /* of the transform */
#define FFT_POINTS         1 /* held in scratch: the length, or the longer chirp convolution's */
#define FFT_STAGES         2 /* two at least */
#define FFT_CHUNK          3 /* points that the first stages take at a time, to stay in the nearest cache */
#define FFT_CHUNK_STAGES   4 /* the number of these stages */
#define FFT_CHIRP          5 /* 0, or the place of the chirp in the float table (then that of its transform follows) */
#define FFT_CHIRP_SPECTRUM 6
#define FFT_SOURCE         7  /* place of the list: number of an input -> its index in memory */
#define FFT_PLACE          8  /* place of the list: number of an input -> its point in scratch */
#define FFT_ODD            9  /* whether a stage has no butterfly of its own */
#define FFT_FLOATS         10 /* place of the float table, which follows */
#define FFT_HEADER         12

/* The float table, for kernels. */
#define FFT_FLOATS_OF(table) ((__global const float *)((table) + (table)[FFT_FLOATS]))

/* A stage combines `radix` transforms of `span` points each. */
#define FFT_STAGE_INTS 5
#define FFT_RADIX      0
#define FFT_SPAN       1
#define FFT_TWIDDLES   2 /* place in the float table: (radix - 1) complex numbers for each j < span */
#define FFT_COSINES    3 /* place of the cosine table of a radix without a butterfly of its own */
#define FFT_MAGIC      4 /* b / span is the high half of b times this, for all b of the pass; 0: divide */

/* Such a radix is an odd number up to this. */
#define FFT_ODD_LARGEST 127
/* Outputs of it that are summed up together. */
#define FFT_ODD_GROUP 3

#endif
