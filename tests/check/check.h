/* One program that checks and times every operation of the device against the double-precision reference.
 *
 * An operation is described by a check_op in check_<op>.c; a problem by a short string of letter-number pairs
 * ("r64c48b3"), read into check_state.value by check_get(). Shapes stand in shapes/<op>.txt, and the same files serve
 * correctness, bitwise and timing runs. */
#ifndef HADA_CHECK_H
#define HADA_CHECK_H

#include "core/random.h"
#include "memory/buffer.h"

typedef struct check_op check_op;

typedef struct check_state {
    const check_op *op;
    const char *shape; /* the problem as text */
    uint64_t seed;
    hada_slot *slot;
    int batch_limit; /* 0: whole batches; else the operation is to be enqueued in pieces of at most this many */

    /* Filled by prepare: the output with guard zones, and what it must hold. */
    hada_buffer out;
    size_t out_offset;          /* floats before the output: a guard zone */
    size_t out_count;           /* floats of the output */
    double *expected;           /* out_count values, freed by the driver */
    unsigned char *unspecified; /* per value: 1 where anything finite may stand; NULL: nowhere; freed by the driver */
    double tolerance;           /* relative L2; 0: exact */
    double bytes, flops;        /* least traffic and operations of one run, for the timing */
    void *own;                  /* the operation's */
} check_state;

struct check_op {
    const char *name, *help;                                     /* help: what the letters of a shape mean */
    hada_status (*prepare)(check_state *state, hada_error *err); /* inputs, plan, expected values */
    hada_status (*launch)(check_state *state, hada_error *err);  /* enqueues the operation once */
    void (*release)(check_state *state);
};

extern const check_op *const check_ops[];
extern const size_t check_op_count;

/* The number behind a letter of the shape, or `otherwise` where the letter is absent. */
int check_get(const check_state *state, char letter, int otherwise);

/* Makes state->out with guard zones for `count` floats, and room for the expected values. */
hada_status check_output(check_state *state, size_t count, hada_error *err);

/* Fills with small integers (exact in float32 sums) or normal numbers, from the state's seed and a stream number. */
void check_fill_integers(const check_state *state, uint64_t stream, float *out, size_t count, int largest);
void check_fill_normal(const check_state *state, uint64_t stream, float *out, size_t count);

#endif
