/* Hadalens: work that several processes or threads share, each with devices of its own.
 *
 * Those who share are ranks, 0 to count - 1, as in MPI (MPI Forum, MPI: A Message-Passing Interface Standard), and a
 * communicator is how they exchange arrays. It is a struct of functions that the caller fills: the program
 * hadalens-mpi has one over MPI, hada_team_communicator() gives one over threads, and others may be written over
 * anything that moves bytes. Options that take one (hada_fit_options, hada_train_options, hada_files_task) are the same
 * on all ranks, but for the communicator: every rank makes the same calls in the same order, and each does its share.
 * docs/how-to/use-several-machines.md tells what is shared.
 *
 * Sums are in a stated order, in double precision: ((rank 0 + rank 1) + rank 2) + ..., whatever the timing, and every
 * rank gets the same bits.
 *
 * Threads: a rank calls from one thread at a time. Errors: a rank whose work fails does not come to the next exchange;
 * the caller has to end the others (MPI_Abort, hada_team_abort()). */
#ifndef HADALENS_COMMUNICATOR_H
#define HADALENS_COMMUNICATOR_H

#include <hadalens/status.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_communicator {
    size_t size;     /* sizeof(hada_communicator) */
    int rank, count; /* this one, of so many; 0 of 1 by default: nothing is exchanged, and no function is needed */
    void *user;      /* handed to every function */

    /* values[i] becomes its sum over all ranks, which give as many. No rank returns before all have called. */
    hada_status (*reduce)(void *user, double *values, size_t count, hada_error *err);
    /* The same, added in double precision and rounded once. */
    hada_status (*reduce_floats)(void *user, float *values, size_t count, hada_error *err);
    /* The bytes of one rank, `root`, to all. */
    hada_status (*broadcast)(void *user, int root, void *bytes, size_t count, hada_error *err);
    /* 1: exchanges go over a network, and are begun while a CPU still computes; 0 (default): they go through memory,
     * which takes the cores that compute, and wait until these are done. Other devices compute on in either case. */
    int network;
} hada_communicator;
HADA_INIT(hada_communicator, HADA_STRUCT_COMMUNICATOR)

/* Ranks that are threads of one process: each calls with the communicator of its rank. */
typedef struct hada_team hada_team;
HADA_API hada_status hada_team_create(hada_team **out, int count, hada_error *err);
/* No rank may be in a call. */
HADA_API void hada_team_destroy(hada_team **team);
/* *out, whose size is set, is good while the team is. */
HADA_API hada_status hada_team_communicator(hada_team *team, int rank, hada_communicator *out, hada_error *err);
/* All exchanges fail from now on, those that wait as well, with HADA_ERROR_STATE: for a rank that has failed. */
HADA_API void hada_team_abort(hada_team *team);

#ifdef __cplusplus
}
#endif
#endif
