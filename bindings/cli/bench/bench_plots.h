/* What the figures share. */
#ifndef HADA_CLI_BENCH_PLOTS_H
#define HADA_CLI_BENCH_PLOTS_H

#include "bench.h"
#include <hadalens/plot.h>

/* Run time against error, with the front. */
hada_status hada_bench_plot_error(const hada_bench *bench, const hada_bench_place *place, const char *folder,
                                  hada_error *err);

#endif
