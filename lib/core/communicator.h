/* Exchanges between ranks, and who does what. A communicator that is NULL or of one rank exchanges nothing. Internal.
 */
#ifndef HADA_CORE_COMMUNICATOR_H
#define HADA_CORE_COMMUNICATOR_H

#include <hadalens/communicator.h>

#include "core/error.h"

static inline int hada_ranks(const hada_communicator *of)
{
    return of ? of->count : 1;
}

static inline int hada_rank(const hada_communicator *of)
{
    return of ? of->rank : 0;
}

/* Whether the n-th of equal pieces of work is this rank's: they are dealt out. */
static inline int hada_is_mine(const hada_communicator *of, long n)
{
    return n % hada_ranks(of) == hada_rank(of);
}

/* Whose it is. */
static inline int hada_owner(const hada_communicator *of, long n)
{
    return (int)(n % hada_ranks(of));
}

/* Where this rank's share of `count` begins that stand in a row; rank + 1: where it ends. */
static inline long hada_share_begin(const hada_communicator *of, long count, int rank)
{
    return (long)((long long)count * rank / hada_ranks(of));
}

/* What the caller's communicator must be; NULL is one. */
hada_status hada_communicator_check(const hada_communicator *callers, hada_error *err);

hada_status hada_reduce(const hada_communicator *of, double *values, size_t count, hada_error *err);
hada_status hada_reduce_floats(const hada_communicator *of, float *values, size_t count, hada_error *err);
hada_status hada_broadcast(const hada_communicator *of, int root, void *bytes, size_t count, hada_error *err);

#endif
