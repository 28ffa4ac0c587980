/* Numbers that are none, and the size of the others. Internal. */
#ifndef HADA_CORE_FINITE_H
#define HADA_CORE_FINITE_H

#include <stddef.h>

/* How many values are NaN or infinite; *largest: the largest magnitude of the others, 0 where there are none. */
size_t hada_not_finite(const float *values, size_t count, float *largest);

#endif
