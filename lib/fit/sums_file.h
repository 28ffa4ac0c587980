/* Sums to and from files: to go on later, or to merge what several machines have added up (docs/reference/files.md).
 * Internal. */
#ifndef HADA_FIT_SUMS_FILE_H
#define HADA_FIT_SUMS_FILE_H

#include "fit/fit_sums.h"
#include "io/safetensors.h"

hada_status hada_fit_sums_save(hada_fit_sums *sums, const char *path, hada_error *err);

/* Adds a file's sums; one that does not belong to this fit is refused before anything changes. */
hada_status hada_fit_sums_load(hada_fit_sums *sums, const char *path, hada_error *err);

/* The response of the scenes behind a file's sums. */
hada_status hada_fit_sums_response(const char *path, double *response, hada_error *err);

/* What a file says of its camera: sizes, depths, boundary, dark level, and, where it is open in `options`, the response
 * of the scenes; the distances point into the file. */
hada_status hada_fit_sums_camera(const hada_tensors *file, const char *path, hada_fit_options *options,
                                 hada_error *err);

/* Its boundary and grid alone, into options. */
hada_status hada_fit_sums_grid(const char *path, hada_fit_options *options, hada_error *err);

#endif
