/* Reference of the learned ridge regulariser's steps, in double precision. Internal. */
#ifndef HADA_REF_RIDGE_H
#define HADA_REF_RIDGE_H

#include "core/base.h"

/* Images [channel][rows][cols] with filters of three channels, or of one where there are not three; see
 * kernels/refine_ridge.cl. */
hada_status hada_ref_ridge(const double *image, int channels, int rows, int cols, double noise, double *out,
                           hada_error *err);

/* What a step's filters, as the kernels have them, make of an image, and the transpose: responses [filter][rows - 4]
 * [cols - 4]. channels: 1 or 3. */
void hada_ref_ridge_respond(const double *image, int channels, int rows, int cols, int number, double *responses);
void hada_ref_ridge_gather(const double *responses, int channels, int rows, int cols, int number, double *image);

#endif
