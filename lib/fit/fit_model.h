/* From the sums of all depths to a model. Internal. */
#ifndef HADA_FIT_FIT_MODEL_H
#define HADA_FIT_FIT_MODEL_H

#include "fit/fit_sums.h"
#include "fit/nonnegative.h"
#include "fit/transfers.h"

/* Solves filters, transfer functions, noise and scene power of every depth. filters: as in a model, in the place of the
 * exact fit's; NULL: these. learned: transfer functions and noise in the place of those of the sums, where it has them.
 * nonnegative: NULL for transfer functions of the pairs alone. Makes the pools. */
hada_status hada_fit_model_make(hada_model **out, hada_fit_sums *sums, hada_fit_setting setting, const float *filters,
                                const hada_fit_transfers *learned, hada_nonnegative *nonnegative, hada_error *err);

#endif
