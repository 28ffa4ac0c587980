/* Filters and transfer functions of the depth on the device, from its sums: each frequency by itself. Internal. */
#ifndef HADA_FIT_FIT_SOLVE_H
#define HADA_FIT_FIT_SOLVE_H

#include "fit/fit_sums.h"
#include "fit/nonnegative.h"

/* Frequencies where scenes had less light than this part of their mean are not trusted with a transfer function. */
#define HADA_FIT_LEAST_SCENE 1e-6

/* What a setting adds under a filter's fraction. raw_energy: of the channel, the mean over frequencies of Sbb. */
hada_fit_penalty hada_fit_penalty_of(hada_fit_setting setting, double raw_energy);

/* Enqueues the filter of one channel, to the n-th image of `out`; images are solved in order. */
hada_status hada_fit_solve_filter(const hada_fit_sums *sums, int channel, hada_fit_penalty penalty, cl_mem out,
                                  size_t n, hada_error *err);

/* Enqueues the transfer functions of all channels, to the n-th image and those that follow. scene_energy: per channel,
 * of the pairs in the sums; nonnegative: NULL for those of the pairs alone, else with the trust of
 * hada_nonnegative_trust() per channel.
 */
hada_status hada_fit_solve_transfers(const hada_fit_sums *sums, hada_nonnegative *nonnegative,
                                     const double *scene_energy, const double *trust, cl_mem out, size_t n,
                                     hada_error *err);

/* The sum over frequencies of what no linear camera explains of a channel's frames. scene_energy: as above; partial:
 * room for `chunks` floats, on the device and on the host. */
hada_status hada_fit_unexplained(const hada_fit_sums *sums, int channel, double scene_energy,
                                 const hada_buffer *partial, float *values, double *sum, hada_error *err);

#endif
