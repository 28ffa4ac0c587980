/* Room for results. Internal. */
#ifndef HADA_ENGINE_RESULT_H
#define HADA_ENGINE_RESULT_H

#include <hadalens/reconstruct.h>

#include "core/error.h"

/* Makes the result fit a model and a number of depths; images that fit already are kept. Empty on failure. */
hada_status hada_result_fit(hada_result *result, const hada_model_info *info, int depths, hada_error *err);

/* Makes `to` a copy of `from`, which is of the model, report included. Empty on failure. */
hada_status hada_result_copy(hada_result *to, const hada_result *from, const hada_model_info *info, hada_error *err);

/* The exponent on planes and all-in-focus image. */
void hada_result_apply_gamma(hada_result *result, double gamma);

#endif
