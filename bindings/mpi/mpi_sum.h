/* Sums over ranks in their order, in double precision. */
#ifndef HADA_MPI_SUM_H
#define HADA_MPI_SUM_H

#include <stddef.h>

/* out[i] = (parts[0][first + i] + parts[1][first + i]) + ..., for `count` values that are doubles or floats, as their
 * size says; floats are rounded once. `out` may stand in one of the parts, at `first`. */
void hada_mpi_add(size_t size, void *out, const void *const *parts, size_t first, int ranks, size_t count);

/* Where a rank's slice of `count` values begins; of rank + 1: where it ends. */
static inline size_t hada_mpi_slice(size_t count, int rank, int ranks)
{
    return (size_t)((unsigned long long)count * (unsigned)rank / (unsigned)ranks);
}

#endif
