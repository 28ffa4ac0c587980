/* hadalens-mpi: the command line for several ranks, which share a command (docs/how-to/use-several-machines.md). */
#include "cli.h"
#include "mpi_communicator.h"

#include <stdio.h>
#include <stdlib.h>

/* The ranks of this machine, of which this is one. */
static void find_local(hada_cli_ranks *ranks)
{
    MPI_Comm local;
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, ranks->communicator.rank, MPI_INFO_NULL, &local);
    MPI_Comm_rank(local, &ranks->local);
    MPI_Comm_size(local, &ranks->locals);
    MPI_Comm_free(&local);
}

/* HADALENS_MPI_COSTS=FILE: what the exchanges of each rank cost, for perf/scale. */
static void tell_costs(const hada_mpi *mpi, double seconds)
{
    const char *path = getenv("HADALENS_MPI_COSTS");
    char name[4096];
    if (!path || snprintf(name, sizeof name, "%s.%d", path, mpi->rank) >= (int)sizeof name)
        return;
    FILE *file = fopen(name, "w");
    if (!file)
        return;
    fprintf(file,
            "{\"rank\": %d, \"ranks\": %d, \"seconds\": %.6f, \"exchange_seconds\": %.6f, \"cpu_seconds\": %.6f, "
            "\"exchange_cpu_seconds\": %.6f, \"bytes\": %llu}\n",
            mpi->rank, mpi->count, seconds, mpi->seconds, hada_mpi_cpu_seconds(), mpi->cpu_seconds, mpi->bytes);
    fclose(file);
}

int main(int argc, char **argv)
{
    int given, agreed = 0;
    hada_mpi mpi;
    hada_cli_ranks ranks = {.agreed = &agreed};
    const double begun = hada_cli_seconds();
    MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &given);
    if (hada_mpi_open(&mpi, MPI_COMM_WORLD, &ranks.communicator)) {
        fprintf(stderr, "hadalens: out of memory\n");
        MPI_Abort(MPI_COMM_WORLD, HADA_EXIT_MEMORY);
    }
    find_local(&ranks);
    const int code = hada_cli_program(argc, argv, &ranks);
    tell_costs(&mpi, hada_cli_seconds() - begun);
    /* The others wait for a rank that failed: the job ends with its code. */
    if (code && !agreed && mpi.count > 1)
        MPI_Abort(MPI_COMM_WORLD, code);
    hada_mpi_close(&mpi);
    MPI_Finalize();
    return code;
}
