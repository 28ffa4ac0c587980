/* The tables of the library's own transforms, for kernels outside this folder that take a pass of a transform together
 * with what comes before and after it, while its data stand in the cache. Internal.
 *
 * Such kernels are those of the lanes (kernels/inc_fft_convolve.h, inc_fft_rows_*.h), or by work-groups
 * (kernels/inc_fft_groups.h), with scratch in local memory. Lanes take lengths that need no chirp, groups those whose
 * factors all have butterflies, or but a last one of 43 (kernels/inc_fft_groups_odd.h). */
#ifndef HADA_FFT_FUSED_H
#define HADA_FFT_FUSED_H

#include "fft/fft_own.h"
#include "kernels/shared_fft.h"

typedef struct hada_fft_fused {
    hada_own_pass rows, rows_back; /* forward and inverse along rows; groups take the same table for both */
    hada_own_pass columns;         /* forward along columns */
    hada_buffer row_tables; /* of both passes along rows, which hold none: kernels that take both have one argument */
    int back_table;         /* where that of the inverse one begins there, in numbers */
    int odd_rows, odd_columns; /* groups: the last stage is of radix 43, and kernels of their own take it */
} hada_fft_fused;

/* Whether there can be such kernels for transforms of rows x cols, with `blocks` blocks of columns in local memory. */
int hada_fft_fuses(const hada_context *context, int rows, int cols, int blocks);

/* The same by work-groups of `group` items: the columns of each of `images` images that one takes, or the pairs of
 * rows, a power of two; 0: there can be none. */
enum { HADA_FFT_LEAST_COLUMNS = 2 };
int hada_fft_group_columns(const hada_context *context, int rows, int cols, int images, size_t group);
int hada_fft_group_pairs(const hada_context *context, int cols, size_t group);

/* Whether the last stage of such a length is of radix 43. */
int hada_fft_group_odd(int n);

hada_status hada_fft_fused_make(hada_fft_fused *fused, hada_slot *slot, int rows, int cols, hada_error *err);
void hada_fft_fused_free(hada_fft_fused *fused); /* the slot's queue must be done with it */

/* The size >= n that costs such kernels the least, along columns or along rows. */
int hada_fft_quick_size(int n, int columns);

#endif
