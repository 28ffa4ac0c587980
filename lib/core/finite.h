/* Values that are not finite. Internal. */
#ifndef HADA_CORE_FINITE_H
#define HADA_CORE_FINITE_H

#include <stddef.h>

/* The number of values that are NaN or infinite; *largest: the largest magnitude of the others, 0 without any. */
size_t hada_not_finite(const float *values, size_t count, float *largest);

#endif
