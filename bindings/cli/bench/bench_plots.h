/* What the figures share. */
#ifndef HADA_CLI_BENCH_PLOTS_H
#define HADA_CLI_BENCH_PLOTS_H

#include "bench.h"
#include <hadalens/plot.h>

/* A device and a workload that was measured on it. */
typedef struct hada_bench_place {
    const char *device, *workload;
    char suffix[16]; /* of file names, where there are several devices */
    int number;      /* of the device */
    int first_of_workload;
} hada_bench_place;

/* The rows of a group at a place; `out` has room for all rows. Returns how many. */
int hada_bench_rows_of(const hada_bench *bench, const hada_bench_place *place, hada_bench_group group,
                       const hada_bench_row **out);

/* Run time against error, with the front. */
hada_status hada_bench_plot_error(const hada_bench *bench, const hada_bench_place *place, const char *folder,
                                  hada_error *err);

#endif
