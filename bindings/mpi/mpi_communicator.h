/* A communicator (hadalens/communicator.h) over MPI. */
#ifndef HADA_MPI_COMMUNICATOR_H
#define HADA_MPI_COMMUNICATOR_H

#include <hadalens/communicator.h>
#include <mpi.h>

#include "mpi_window.h"

/* What the functions need of it. */
typedef struct hada_mpi {
    MPI_Comm comm;
    int rank, count;
    unsigned long long bytes; /* sent by this rank */
    double seconds;           /* in exchanges, waiting for others included */
    double cpu_seconds;       /* of this process meanwhile */
    hada_mpi_window window;   /* where all ranks are on one machine */
    void *room;               /* for an exchange */
    size_t room_bytes;
    const void **parts; /* of it, each rank's */
} hada_mpi;

/* Not zero: there is no memory. Errors of MPI itself end the job, as MPI has it by default. With
 * HADALENS_MPI_MEMORY=off ranks of one machine exchange as those of several do. */
int hada_mpi_open(hada_mpi *mpi, MPI_Comm comm, hada_communicator *out);
void hada_mpi_close(hada_mpi *mpi);

/* Processor seconds of this process, all threads. */
double hada_mpi_cpu_seconds(void);

#endif
