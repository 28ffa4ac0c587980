/* Transforms by work-groups of lengths that have programs of their own (kernels/fft_sized_*.cl, shared_fft_sizes.h):
 * whether there is one, and its table. Internal to lib/fft. */
#ifndef HADA_FFT_SIZED_H
#define HADA_FFT_SIZED_H

#include "fft/fft_pass.h"
#include "runtime/context.h"

#define HADA_SIZED_STAGES 4

/* How a pass of such a length is launched. */
typedef struct hada_fft_sized {
    int radix[HADA_SIZED_STAGES]; /* 1: no stage */
    int group;                    /* work-items */
    int parts;                    /* columns: groups of a block */
    int pairs;                    /* rows: pairs of a group */
    size_t local_bytes;
} hada_fft_sized;

/* Whether a program serves such a pass on this device. */
int hada_fft_sized_find(hada_fft_sized *sized, const hada_context *context, int n, int columns);

/* Floats of its table; and the table: pairs of twiddle factors, stage by stage in the order of the pass's kind. */
size_t hada_fft_sized_floats(const hada_fft_sized *sized, hada_fft_pass_kind kind);
void hada_fft_sized_fill(const hada_fft_sized *sized, hada_fft_pass_kind kind, float *floats);

#endif
