/* What the checks of nets share: tensors in blocks filled from plain arrays, an output that is a tensor with a halo. */
#ifndef HADA_CHECK_NET_H
#define HADA_CHECK_NET_H

#include "check.h"
#include "net/layers.h"
#include "ref/ref_layers.h"

enum { CHECK_NET_INPUTS = 6 };

typedef struct check_net check_net;
struct check_net {
    hada_tensor x[CHECK_NET_INPUTS]; /* inputs as tensors, as plain doubles, and their memory */
    double *plain[CHECK_NET_INPUTS];
    hada_buffer memory[CHECK_NET_INPUTS];
    int inputs;
    hada_tensor y;     /* the output's tensor */
    hada_buffer start; /* the output before each run */
    hada_buffer scratch;
    int mode, accumulate, size, stride, row, col, channel;
    float number;
    /* Runs the operation on the images first ... first + count - 1. */
    hada_status (*run)(check_state *state, check_net *own, int first, int count, hada_error *err);
};

/* The check's own record, in state->own; from its letters: a accumulate, b mode. */
check_net *check_net_own(check_state *state, hada_status (*run)(check_state *, check_net *, int, int, hada_error *));

/* The shape of the letters n (images), k (channels), r (rows), c (columns). */
hada_ref_shape check_net_shape(const check_state *state);

/* Channels in a block: letter v, or what the context takes. */
int check_net_block(const check_state *state);

/* The next input: a tensor of integers up to `largest`, or normal numbers where that is 0. p1: other memory stands
 * between the images. */
hada_status check_net_input(check_state *state, check_net *own, const hada_ref_shape *shape, int largest,
                            hada_error *err);
/* The next input: `count` plain floats. */
hada_status check_net_floats(check_state *state, check_net *own, size_t count, int largest, hada_error *err);

/* The output: a tensor of `shape`, then `floats` plain floats. Where the check accumulates they start as integers up to
 * `largest` (normal numbers), else as numbers that must be gone afterwards. *plain: what stands in the tensor at first,
 * then in the floats. */
hada_status check_net_output(check_state *state, check_net *own, const hada_ref_shape *shape, size_t floats,
                             int largest, double **plain, hada_error *err);
/* Takes what must come out, in the order of `plain` above. */
void check_net_expect(check_state *state, const check_net *own, const hada_ref_shape *shape, size_t floats,
                      const double *plain);
/* Leaves `count` values of the output out of the comparison: errors are relative to all that is compared, and large
 * values would hide those of small ones. */
void check_net_ignore(check_state *state, size_t first, size_t count);
/* The place of the plain floats behind the output's tensor. */
size_t check_net_behind(const check_state *state, const check_net *own);

/* The launch of every check of nets. */
hada_status check_net_launch(check_state *state, hada_error *err);

#endif
