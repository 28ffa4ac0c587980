/* One program that checks and times every operation of the device against the double-precision reference.
 *
 * An operation is described by a check_op in check_<op>.c; a problem by a short string of letter-number pairs
 * ("r64c48b3"), read into check_state.value by check_get(). Shapes are in shapes/<op>.txt, and the same files are used
 * for correctness, bitwise and timing runs. */
#ifndef HADA_CHECK_H
#define HADA_CHECK_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "core/random.h"
#include "helpers.h"
#include "runtime/buffer.h"

typedef struct check_op check_op;

/* What a value of the output may be: anything finite; as it was before the operation. */
enum { CHECK_ANYTHING = 1, CHECK_UNTOUCHED = 2 };
enum { CHECK_REGIONS = 8, CHECK_ROOMS = 64, CHECK_BUFFERS = 32 };

typedef struct check_state {
    const check_op *op;
    const char *shape; /* the problem as text */
    uint64_t seed;
    hada_slot *slot;
    int timing;      /* 1: only the time counts: what the output must hold need not be worked out */
    int batch_limit; /* 0: whole batches; else the operation is to be enqueued in pieces of at most this many */

    /* Filled by prepare: the output with guard zones, and what it must hold. */
    hada_buffer out;
    size_t out_offset;          /* floats before the output: a guard zone */
    size_t out_count;           /* floats of the output */
    double *expected;           /* out_count values, freed by the driver */
    unsigned char *unspecified; /* per value, or NULL: 0 as expected, or one of these; check_room() */
    double tolerance;           /* relative L2; 0: exact */
    double bytes, flops;        /* least traffic and operations of one run, for the timing */
    void *own;                  /* the operation's, from check_own() */

    cl_mem region[CHECK_REGIONS]; /* see check_region(); released by the driver */
    int regions;
    void *room[CHECK_ROOMS]; /* see check_room() and check_upload(); given back by the driver */
    hada_buffer *buffer[CHECK_BUFFERS];
    int rooms, buffers;
} check_state;

struct check_op {
    const char *name, *help;                                     /* help: what the letters of a shape mean */
    hada_status (*prepare)(check_state *state, hada_error *err); /* inputs, plan, expected values */
    hada_status (*launch)(check_state *state, hada_error *err);  /* enqueues the operation once */
    void (*release)(check_state *state);                         /* of what is neither room nor buffer; NULL: nothing */
};

extern const check_op *const check_ops[];
extern const size_t check_op_count;

/* Four letters are the driver's: g1 or g0 takes the kernels by work-groups or by lanes whatever the device prefers,
 * t1 makes it believe that the device has no local memory to speak of, u1 has spectra row-major, as clFFT has them,
 * v16 or v8 is the length of its vectors (8 where only the result counts). */

/* Whether kernels of both shapes are run: on CPUs, where HADALENS_SHAPE names none. Elsewhere lines that ask for the
 * other shape are left out, and its kernels are not missed. */
int check_both_shapes(const hada_context *context);

/* The number behind a letter of the shape, or `otherwise` where the letter is absent. */
int check_get(const check_state *state, char letter, int otherwise);

/* Makes state->out with guard zones for `count` floats, and room for the expected values. */
hada_status check_output(check_state *state, size_t count, hada_error *err);

/* A part of the output by itself, for kernels that take no offset: `count` floats from `first` (a multiple of 256) on.
 */
hada_status check_region(check_state *state, size_t first, size_t count, cl_mem *region, hada_error *err);

/* The size of work-groups that the library takes where a kernel has no local memory. */
size_t check_local(const check_state *state, size_t groups);

/* Fills `count` floats of the output, from `first` on, with zeros (enqueued). */
hada_status check_clear(check_state *state, size_t first, size_t count, hada_error *err);

/* Zeroed memory on the host until the check is over. Never NULL: without memory the program ends. check_own() also
 * keeps it as state->own. */
void *check_room(check_state *state, size_t bytes);
void *check_own(check_state *state, size_t bytes);

/* A buffer with data, or without, until the check is over. */
hada_status check_scratch(check_state *state, hada_buffer *buffer, size_t bytes, hada_error *err);
hada_status check_upload(check_state *state, hada_buffer *buffer, const void *data, size_t bytes, hada_error *err);

/* Fills with small integers (exact in float32 sums) or normal numbers, from the state's seed and a stream number. */
void check_fill_integers(const check_state *state, uint64_t stream, float *out, size_t count, int largest);
void check_fill_normal(const check_state *state, uint64_t stream, float *out, size_t count);

/* Room for so many normal numbers, filled; *exact: the same in double precision. */
float *check_normal(check_state *state, size_t count, double **exact);

/* Which kernels ran (check_cover.c). check_cover_report() prints them where asked to, and what no operation launched;
 * returns how many kernels and programs of the manifest are missing. `partial`: shapes were skipped, so that is no
 * failure. */
int check_cover_report(const hada_slot *slot, int list, int partial);

/* The same over runs of single operations: each run saves what it launched in FOLDER/<op>.txt (returns 1 where it
 * cannot be written). Loading them all before check_cover_report() returns how many operations have not run since
 * `program` was built. */
int check_cover_save(const hada_slot *slot, const char *folder, const char *op, int partial);
int check_cover_load(const char *folder, const char *program, int *partial);
void check_cover_forget(void);

/* Each kernel file compiles alone, has the kernels that its text names and stands in the manifest; returns the number
 * of files that don't. */
int check_compile(hada_slot *slot);

#endif
