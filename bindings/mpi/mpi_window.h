/* Sums over ranks, and memory that the ranks of one machine share: sums without messages. */
#ifndef HADA_MPI_WINDOW_H
#define HADA_MPI_WINDOW_H

#include <mpi.h>
#include <stddef.h>

typedef struct hada_mpi_window {
    MPI_Comm comm; /* MPI_COMM_NULL: there is none */
    MPI_Win win;
    int rank, count;
    char *own;          /* this rank's part */
    const void **parts; /* of each rank, where all see it */
    size_t half;        /* bytes before the half of a part that comes next: 0 or those of a half */
} hada_mpi_window;

/* There is none where a rank of `comm` is on another machine, or the system gives no memory. The same on all ranks. */
void hada_mpi_window_open(hada_mpi_window *window, MPI_Comm comm);
void hada_mpi_window_close(hada_mpi_window *window);

/* values[i], of `size` bytes (hada_mpi_add), becomes its sum over the ranks. */
void hada_mpi_window_reduce(hada_mpi_window *window, size_t size, char *values, size_t count);

/* In the order of the ranks, in double precision: out[i] = (parts[0][first + i] + parts[1][first + i]) + ..., for
 * `count` values. size is 8 for doubles, 4 for floats. Sums of floats are rounded to floats once, at the end. `out` may
 * be the place in one of the parts where its values begin. */
void hada_mpi_add(size_t size, void *out, const void *const *parts, size_t first, int ranks, size_t count);

/* Where a rank's slice of `count` values begins; of rank + 1: where it ends. */
static inline size_t hada_mpi_slice(size_t count, int rank, int ranks)
{
    return (size_t)((unsigned long long)count * (unsigned)rank / (unsigned)ranks);
}

#endif
