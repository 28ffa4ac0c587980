/* The sums of all ranks. Internal. */
#ifndef HADA_FIT_SUMS_REDUCE_H
#define HADA_FIT_SUMS_REDUCE_H

#include "fit/fit_sums.h"

/* The sums become those of all ranks, on every rank: a depth whose pairs are all of one rank comes from that one with
 * its bits, the others are added in double precision, in rank order. */
hada_status hada_fit_sums_reduce(hada_fit_sums *sums, hada_error *err);

#endif
