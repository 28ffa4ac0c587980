/* Filters in half precision. Internal. */
#ifndef HADA_MODEL_HALF_FILTER_H
#define HADA_MODEL_HALF_FILTER_H

#include <stddef.h>
#include <stdint.h>

#include "core/error.h"

/* Converts the values of a filter. HADA_ERROR_NUMERIC where one is too large for half, or where so many are below its
 * normal numbers that the filter changes by more than half's 2^-11 (relative L2). */
hada_status hada_filter_to_half(const float *filter, size_t values, uint16_t *half, hada_error *err);

#endif
