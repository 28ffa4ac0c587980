/* An array goes through the window in pieces that stay in a core's cache: each rank copies its piece in; when all have,
 * each adds up its slice of it in the place of its own; when all have, each copies all slices out. Pieces take turns in
 * the two halves of the window, so that the next piece is copied in while others still copy this one out. */
#include "mpi_window.h"

#include <stdlib.h>
#include <string.h>

/* Values whose sums stand in the nearest cache while those of all ranks are added. */
enum { RUN = 512 };

/* Sums of all ranks in the order of their numbers, in double precision. */
/* NOLINTBEGIN(bugprone-macro-parentheses): a type cannot stand in parentheses */
#define DEFINE_ADD(type)                                                                                               \
    static void add_##type(type *out, const void *const *parts, size_t first, int ranks, size_t count)                 \
    {                                                                                                                  \
        double sums[RUN];                                                                                              \
        const type *part = (const type *)parts[0] + first;                                                             \
        for (size_t i = 0; i < count; i++)                                                                             \
            sums[i] = part[i];                                                                                         \
        for (int r = 1; r < ranks; r++) {                                                                              \
            part = (const type *)parts[r] + first;                                                                     \
            for (size_t i = 0; i < count; i++)                                                                         \
                sums[i] += part[i];                                                                                    \
        }                                                                                                              \
        for (size_t i = 0; i < count; i++)                                                                             \
            out[i] = (type)sums[i];                                                                                    \
    }
/* NOLINTEND(bugprone-macro-parentheses) */
DEFINE_ADD(double)
DEFINE_ADD(float)

void hada_mpi_add(size_t size, void *out, const void *const *parts, size_t first, int ranks, size_t count)
{
    for (size_t at = 0; at < count; at += RUN) {
        const size_t run = count - at < RUN ? count - at : RUN;
        if (size == sizeof(double))
            add_double((double *)out + at, parts, first + at, ranks, run);
        else
            add_float((float *)out + at, parts, first + at, ranks, run);
    }
}

/* Bytes of a piece: less than half of a core's second cache, 1 MiB and more on today's servers. */
enum { PIECE = 1 << 18 };

static int all_agree(MPI_Comm comm, int own)
{
    int all = 0;
    MPI_Allreduce(&own, &all, 1, MPI_INT, MPI_MIN, comm);
    return all;
}

/* The memory of all, in a communicator whose errors return. */
static int share(hada_mpi_window *window)
{
    window->parts = calloc((size_t)window->count, sizeof *window->parts);
    if (!all_agree(window->comm, window->parts != NULL))
        return 0;
    const int failed = MPI_Win_allocate_shared(2 * PIECE, 1, MPI_INFO_NULL, window->comm, &window->own, &window->win);
    if (!all_agree(window->comm, !failed)) {
        if (!failed)
            MPI_Win_free(&window->win);
        return 0;
    }
    MPI_Win_lock_all(MPI_MODE_NOCHECK, window->win);
    for (int r = 0; r < window->count; r++) {
        MPI_Aint bytes;
        int unit;
        void *part;
        MPI_Win_shared_query(window->win, r, &bytes, &unit, &part);
        window->parts[r] = part;
    }
    return 1;
}

static void forget(hada_mpi_window *window)
{
    free(window->parts);
    MPI_Comm_free(&window->comm);
    *window = (hada_mpi_window){.comm = MPI_COMM_NULL};
}

void hada_mpi_window_open(hada_mpi_window *window, MPI_Comm comm)
{
    int all;
    *window = (hada_mpi_window){.comm = MPI_COMM_NULL};
    MPI_Comm_rank(comm, &window->rank);
    MPI_Comm_size(comm, &all);
    MPI_Comm_split_type(comm, MPI_COMM_TYPE_SHARED, window->rank, MPI_INFO_NULL, &window->comm);
    MPI_Comm_size(window->comm, &window->count);
    MPI_Comm_set_errhandler(window->comm, MPI_ERRORS_RETURN);
    if (window->count < all || !share(window))
        forget(window);
}

void hada_mpi_window_close(hada_mpi_window *window)
{
    if (window->comm == MPI_COMM_NULL)
        return;
    MPI_Win_unlock_all(window->win);
    MPI_Win_free(&window->win);
    forget(window);
}

/* What each has written before, all see afterwards. */
static void meet(const hada_mpi_window *window)
{
    MPI_Win_sync(window->win);
    MPI_Barrier(window->comm);
    MPI_Win_sync(window->win);
}

static void reduce_piece(hada_mpi_window *window, size_t size, char *values, size_t count)
{
    const size_t first = window->half / size;
    const size_t begin = hada_mpi_slice(count, window->rank, window->count);
    const size_t end = hada_mpi_slice(count, window->rank + 1, window->count);
    char *own = window->own + window->half;
    memcpy(own, values, count * size);
    meet(window);
    hada_mpi_add(size, own + begin * size, window->parts, first + begin, window->count, end - begin);
    meet(window);
    for (int r = 0; r < window->count; r++) {
        const size_t from = hada_mpi_slice(count, r, window->count), to = hada_mpi_slice(count, r + 1, window->count);
        memcpy(values + from * size, (const char *)window->parts[r] + window->half + from * size, (to - from) * size);
    }
    window->half = PIECE - window->half;
}

void hada_mpi_window_reduce(hada_mpi_window *window, size_t size, char *values, size_t count)
{
    const size_t most = PIECE / size;
    for (size_t at = 0; at < count; at += most)
        reduce_piece(window, size, values + at * size, count - at < most ? count - at : most);
}
