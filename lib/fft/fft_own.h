/* One pass of the library's own transforms on a device: its tables, its scratch and how it is enqueued, in the shape of
 * the context. Internal to lib/fft. */
#ifndef HADA_FFT_OWN_H
#define HADA_FFT_OWN_H

#include "fft/fft_pass.h"
#include "runtime/buffer.h"

#define HADA_OWN_BLOCK 8 /* columns of a spectrum's block */

/* Local memory is used up to here: PoCL reports more, and aborts above 512 KiB. */
#define HADA_OWN_LOCAL_BYTES ((uint64_t)384 << 10)

typedef struct hada_own_pass {
    hada_buffer ints, floats, scratch;
    int width;          /* complex transforms that a work-group does side by side */
    size_t local_bytes; /* of local memory for each group, 0 where scratch lies in global memory */
    size_t groups;      /* at most in flight, where scratch lies in global memory */
} hada_own_pass;

hada_status hada_own_pass_make(hada_own_pass *pass, hada_slot *slot, const hada_fft_pass_desc *desc, hada_error *err);
void hada_own_pass_free(hada_own_pass *pass);

/* Bytes of device memory of a pass along rows or columns. */
size_t hada_own_pass_bytes(const hada_context *context, int n, int columns);

/* Bytes of local memory of such a pass for each group, 0 where its scratch lies in global memory. */
size_t hada_own_pass_local(const hada_context *context, int n, int columns);

/* The kernels' last arguments, width and scratch, which hada_own_pass_launch() sets. */
#define HADA_OWN_LAST_ARGS HADA_ARG_LOCAL(0), HADA_ARG_LOCAL(0)

/* Enqueues `tasks` of a pass: one work-group each, or, where scratch lies in global memory, as many groups as there is
 * scratch for. `name`: the kernel's without fft_ or fft_group_. `args` ends with HADA_OWN_LAST_ARGS. */
hada_status hada_own_pass_launch(const hada_own_pass *pass, hada_slot *slot, const char *name, const char *options,
                                 int tasks, hada_arg *args, size_t count, hada_error *err);

#endif
