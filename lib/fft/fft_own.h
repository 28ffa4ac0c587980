/* The library's own transforms: tables of a pass, and a pass on a device. Internal to lib/fft and fft_fused.h. */
#ifndef HADA_FFT_FFT_OWN_H
#define HADA_FFT_FFT_OWN_H

#include <stddef.h>
#include <stdint.h>

#include "kernels/shared_fft.h"
#include "runtime/buffer.h"
#include "runtime/context.h"
#include "runtime/launch.h"

/* The run-time description of one pass of transforms of one length: the tables that the kernels of fft_rows_*.cl and
 * fft_rows_cols.cl read (their layout: kernels/shared_fft_table.h). Internal. */

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

/* The points of scratch, whether a stage has no butterfly of its own, and the sizes of the tables that
 * a pass would get. */
void hada_fft_pass_sizes(int n, int direct, int *points, int *odd, size_t *int_count, size_t *float_count);

/* Transforms by work-groups of lengths that have programs of their own (kernels/fft_sized_*.cl, shared_fft_sizes.h):
 * whether there is one, and its table. Internal to lib/fft. */

#define HADA_SIZED_STAGES 4

/* How a pass of such a length is launched. */
typedef struct hada_fft_sized {
    int radix[HADA_SIZED_STAGES]; /* 1: no stage */
    int group;                    /* work-items */
    int parts;                    /* columns: groups of a block */
    int pairs;                    /* rows: pairs of a group */
    size_t local_bytes;
} hada_fft_sized;

/* One pass of the library's own transforms on a device: its tables, its scratch and how it is enqueued, in the shape of
 * the context. Internal to lib/fft. */

/* Local memory is used up to here: PoCL reports more, and aborts above 512 KiB. */
#define HADA_OWN_LOCAL_BYTES ((uint64_t)384 << 10)

typedef struct hada_own_pass {
    hada_buffer table, scratch;
    int width;          /* complex transforms that a work-group does side by side */
    size_t local_bytes; /* of local memory for each group, 0 where scratch lies in global memory */
    size_t groups;      /* at most in flight, where scratch lies in global memory */
    int sized;          /* a program of its own serves the length; then `table` is its one, and nothing else is there */
    hada_fft_sized size;
} hada_own_pass;

hada_status hada_own_pass_make(hada_own_pass *pass, hada_slot *slot, const hada_fft_pass_desc *desc, hada_error *err);

/* The same with the tables of any length, also where the length has a program of its own. */
hada_status hada_own_pass_make_any(hada_own_pass *pass, hada_slot *slot, const hada_fft_pass_desc *desc,
                                   hada_error *err);

void hada_own_pass_free(hada_own_pass *pass);

/* Bytes of local memory of such a pass for each group, 0 where its scratch lies in global memory. */
size_t hada_own_pass_local(const hada_context *context, int n, int columns);

/* What enqueues `tasks` of a pass: one work-group each, or, where scratch lies in global memory, as many groups as
 * there is scratch for; and that scratch, the kernels' last argument. */
hada_range hada_own_pass_range(const hada_own_pass *pass, const hada_slot *slot, int tasks);
hada_either hada_own_pass_scratch(const hada_own_pass *pass);

#endif
