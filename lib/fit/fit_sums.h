/* The first pass: sums over the pairs of each depth. Internal.
 *
 * The sums of one depth are on the device, those of the others wait on the host in the device's layout: pairs are
 * best given depth by depth. Kernels and the order of the sums: kernels/inc_fit.h. */
#ifndef HADA_FIT_FIT_SUMS_H
#define HADA_FIT_FIT_SUMS_H

#include "fit/fit_grid.h"
#include "io/safetensors.h"

typedef struct hada_fit_depth {
    float *sums; /* channels x (2 x sum_count x stride) floats; NULL while nothing was put here */
    int64_t pairs;
    double *raw_energy, *scene_energy; /* per channel: of all pairs = mean over frequencies of Sbb, Sxx */
} hada_fit_depth;

typedef struct hada_fit_sums {
    const hada_fit_grid *grid;
    hada_buffer *sums;   /* per channel, of the depth `current` */
    hada_buffer *pool;   /* per channel: over all depths */
    hada_buffer weights; /* how often a frequency of the half spectrum counts; 0 in the padding */
    hada_fit_depth *depth;
    uint64_t bytes; /* of device memory */
    int current;    /* depth whose sums are on the device, -1: none */
    int changed;    /* they differ from the host's copy */
    int pooled;     /* the pools are up to date */
} hada_fit_sums;

hada_status hada_fit_sums_create(hada_fit_sums *sums, const hada_fit_grid *grid, hada_error *err);
void hada_fit_sums_destroy(hada_fit_sums *sums);

/* Brings the sums of a depth to the device. */
hada_status hada_fit_sums_select(hada_fit_sums *sums, int depth, hada_error *err);

/* The same, on loan: what is done to them on the device is not kept, and the next selection brings the true ones. */
hada_status hada_fit_sums_borrow(hada_fit_sums *sums, int depth, hada_error *err);

/* Adds the spectra of a pair to the sums on the device, or (sign -1) takes them out of them, and nothing else. */
hada_status hada_fit_sums_accumulate(hada_fit_sums *sums, const hada_fit_pair *pair, double sign, hada_error *err);

/* Adds a transformed pair to a depth; HADA_ERROR_NUMERIC where its values leave single precision. */
hada_status hada_fit_sums_add(hada_fit_sums *sums, int depth, const hada_fit_pair *pair, hada_error *err);

/* Adds sums of the same shape, `more` (on the device, high and low parts), to a channel of the depth on the device. */
hada_status hada_fit_sums_merge(hada_fit_sums *sums, int channel, const hada_buffer *more, hada_error *err);

/* Makes the pools over depths, unless they are up to date; afterwards any depth may be on the device. */
hada_status hada_fit_sums_pool(hada_fit_sums *sums, hada_error *err);

/* The sums of all ranks. */
/* The sums become those of all ranks, on every rank: a depth whose pairs are all of one rank comes from that one with
 * its bits, the others are added in double precision, in rank order. */
hada_status hada_fit_sums_reduce(hada_fit_sums *sums, hada_error *err);

/* Sums to and from files: to go on later, or to merge what several machines have added up (docs/reference/files.md).
 * part: 1 for those that a fit saves on its way, and removes at its end; the file says so. */
hada_status hada_fit_sums_save(hada_fit_sums *sums, const char *path, int part, hada_error *err);

/* HADA_ERROR_FILE_WRITE where something stands at `path` that is no part which a fit left, so that no file of anybody
 * else's is taken for one, replaced and removed. */
hada_status hada_fit_sums_check_part(const char *path, hada_error *err);

/* Adds a file's sums; one that does not belong to this fit is refused before anything changes. */
hada_status hada_fit_sums_load(hada_fit_sums *sums, const char *path, hada_error *err);

/* What a file says of its camera: sizes, depths, boundary, dark level, and, where it is open in `options`, the response
 * of the scenes; the distances point into the file. */
hada_status hada_fit_sums_camera(const hada_tensors *file, const char *path, hada_fit_options *options,
                                 hada_error *err);

/* The same of a file at `path`, without the distances. */
hada_status hada_fit_sums_options(const char *path, hada_fit_options *options, hada_error *err);

#endif
