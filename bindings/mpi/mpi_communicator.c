/* Sums in rank order. Ranks of one machine have memory in common (mpi_window.h). Between machines each rank gets its
 * slice of all arrays, adds it up, and all get all slices. That moves as many bytes as a ring does, twice (ranks - 1) /
 * ranks of the array from each (R. Thakur, R. Rabenseifner and W. Gropp, International Journal of High Performance
 * Computing Applications 19, 2005), but the order is stated, which that of MPI_Allreduce is not. */
#include "mpi_communicator.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Values of a round, and of an exchange so small that every rank adds up the whole. */
enum { ROUND = 1 << 20, SMALL = 1 << 10 };

/* Bytes of one call: counts of MPI are ints. */
enum { MOST_BYTES = 1 << 30 };

static hada_status fail(hada_error *err, size_t bytes)
{
    if (err) {
        memset(err, 0, sizeof *err);
        err->status = HADA_ERROR_MEMORY;
        snprintf(err->message, sizeof err->message, "out of memory: %zu bytes for an exchange between ranks", bytes);
    }
    return HADA_ERROR_MEMORY;
}

static hada_status make_room(hada_mpi *mpi, size_t bytes, hada_error *err)
{
    if (bytes <= mpi->room_bytes)
        return HADA_OK;
    free(mpi->room);
    mpi->room = malloc(bytes);
    mpi->room_bytes = mpi->room ? bytes : 0;
    return mpi->room ? HADA_OK : fail(err, bytes);
}

/* What an array holds. */
typedef struct kind {
    MPI_Datatype type;
    size_t size;
} kind;

/* Adds up the ranks' `count` values, which stand one rank's behind another's in the room. */
static void add_room(hada_mpi *mpi, kind of, void *out, size_t count)
{
    for (int r = 0; r < mpi->count; r++)
        mpi->parts[r] = (const char *)mpi->room + (size_t)r * count * of.size;
    hada_mpi_add(of.size, out, mpi->parts, 0, mpi->count, count);
}

static hada_status reduce_small(hada_mpi *mpi, kind of, void *values, int count, hada_error *err)
{
    const size_t ranks = (size_t)mpi->count;
    const hada_status status = make_room(mpi, ranks * (size_t)count * of.size, err);
    if (status)
        return status;
    MPI_Allgather(values, count, of.type, mpi->room, count, of.type, mpi->comm);
    add_room(mpi, of, values, (size_t)count);
    mpi->bytes += (ranks - 1) * (size_t)count * of.size;
    return HADA_OK;
}

/* Where the slices of all ranks stand, and how long each is. */
typedef struct slices {
    int *counts, *offsets, *from_counts, *from_offsets;
} slices;

static void cut(const hada_mpi *mpi, const slices *list, int count)
{
    const size_t all = (size_t)count;
    const int own = (int)(hada_mpi_slice(all, mpi->rank + 1, mpi->count) - hada_mpi_slice(all, mpi->rank, mpi->count));
    for (int r = 0; r < mpi->count; r++) {
        list->offsets[r] = (int)hada_mpi_slice(all, r, mpi->count);
        list->counts[r] = (int)hada_mpi_slice(all, r + 1, mpi->count) - list->offsets[r];
        list->from_counts[r] = own;
        list->from_offsets[r] = r * own;
    }
}

static hada_status reduce_round(hada_mpi *mpi, kind of, char *values, int count, const slices *list, hada_error *err)
{
    cut(mpi, list, count);
    const size_t own = (size_t)list->counts[mpi->rank], ranks = (size_t)mpi->count;
    const hada_status status = make_room(mpi, ranks * own * of.size, err);
    if (status)
        return status;
    MPI_Alltoallv(values, list->counts, list->offsets, of.type, mpi->room, list->from_counts, list->from_offsets,
                  of.type, mpi->comm);
    add_room(mpi, of, values + (size_t)list->offsets[mpi->rank] * of.size, own);
    MPI_Allgatherv(MPI_IN_PLACE, 0, of.type, values, list->counts, list->offsets, of.type, mpi->comm);
    mpi->bytes += ((size_t)count - own + (ranks - 1) * own) * of.size;
    return HADA_OK;
}

static hada_status reduce_network(hada_mpi *mpi, kind of, char *values, size_t count, hada_error *err)
{
    int *room = calloc(4 * (size_t)mpi->count, sizeof *room);
    hada_status status = room ? HADA_OK : fail(err, 4 * (size_t)mpi->count * sizeof *room);
    if (!status) {
        const slices list = {room, room + mpi->count, room + 2 * mpi->count, room + 3 * mpi->count};
        for (size_t done = 0; done < count && !status; done += ROUND)
            status = reduce_round(mpi, of, values + done * of.size, (int)(count - done < ROUND ? count - done : ROUND),
                                  &list, err);
    }
    free(room);
    return status;
}

double hada_mpi_cpu_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* What an exchange costs, from before it on. */
typedef struct costs {
    double seconds, cpu_seconds;
} costs;

static costs begin(void)
{
    return (costs){MPI_Wtime(), hada_mpi_cpu_seconds()};
}

static void end(hada_mpi *mpi, costs begun)
{
    mpi->seconds += MPI_Wtime() - begun.seconds;
    mpi->cpu_seconds += hada_mpi_cpu_seconds() - begun.cpu_seconds;
}

/* Among the ranks of one machine. */
static hada_status reduce_window(hada_mpi *mpi, kind of, char *values, size_t count)
{
    const size_t own = hada_mpi_slice(count, mpi->rank + 1, mpi->count) - hada_mpi_slice(count, mpi->rank, mpi->count);
    hada_mpi_window_reduce(&mpi->window, of.size, values, count);
    mpi->bytes += (count - own + ((size_t)mpi->count - 1) * own) * of.size;
    return HADA_OK;
}

static hada_status reduce_kind(hada_mpi *mpi, kind of, void *values, size_t count, hada_error *err)
{
    const costs begun = begin();
    const hada_status status = count <= SMALL                      ? reduce_small(mpi, of, values, (int)count, err)
                               : mpi->window.comm != MPI_COMM_NULL ? reduce_window(mpi, of, values, count)
                                                                   : reduce_network(mpi, of, values, count, err);
    end(mpi, begun);
    return status;
}

static hada_status reduce(void *user, double *values, size_t count, hada_error *err)
{
    return reduce_kind(user, (kind){MPI_DOUBLE, sizeof *values}, values, count, err);
}

static hada_status reduce_floats(void *user, float *values, size_t count, hada_error *err)
{
    return reduce_kind(user, (kind){MPI_FLOAT, sizeof *values}, values, count, err);
}

static hada_status broadcast(void *user, int root, void *bytes, size_t count, hada_error *err)
{
    hada_mpi *mpi = user;
    const costs begun = begin();
    (void)err;
    for (size_t done = 0; done < count; done += MOST_BYTES)
        MPI_Bcast((char *)bytes + done, (int)(count - done < MOST_BYTES ? count - done : MOST_BYTES), MPI_BYTE, root,
                  mpi->comm);
    mpi->bytes += mpi->rank == root ? count : 0;
    end(mpi, begun);
    return HADA_OK;
}

int hada_mpi_open(hada_mpi *mpi, MPI_Comm comm, hada_communicator *out)
{
    const char *memory = getenv("HADALENS_MPI_MEMORY");
    *mpi = (hada_mpi){.comm = comm, .window.comm = MPI_COMM_NULL};
    MPI_Comm_rank(comm, &mpi->rank);
    MPI_Comm_size(comm, &mpi->count);
    mpi->parts = calloc((size_t)mpi->count, sizeof *mpi->parts);
    if (!mpi->parts)
        return 1;
    if (mpi->count > 1 && !(memory && !strcmp(memory, "off")))
        hada_mpi_window_open(&mpi->window, comm);
    hada_communicator_init(out);
    out->rank = mpi->rank;
    out->count = mpi->count;
    out->user = mpi;
    out->reduce = reduce;
    out->reduce_floats = reduce_floats;
    out->broadcast = broadcast;
    out->network = mpi->window.comm == MPI_COMM_NULL;
    return 0;
}

void hada_mpi_close(hada_mpi *mpi)
{
    hada_mpi_window_close(&mpi->window);
    free(mpi->parts);
    free(mpi->room);
    *mpi = (hada_mpi){.window.comm = MPI_COMM_NULL};
}
