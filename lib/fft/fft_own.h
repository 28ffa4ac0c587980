/* One pass of the library's own transforms on a device: its tables, its scratch and how it is enqueued, in the shape of
 * the context. Internal to lib/fft. */
#ifndef HADA_FFT_OWN_H
#define HADA_FFT_OWN_H

#include "fft/fft_pass.h"
#include "fft/fft_sized.h"
#include "kernels/shared_fft.h"
#include "runtime/buffer.h"
#include "runtime/launch.h"

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
