/* Selection by rank. Internal. */
#ifndef HADA_IMAGE_RANK_H
#define HADA_IMAGE_RANK_H

#include <stddef.h>

/* The value of rank k (0: the least) of `count`, which are brought into another order; k < count, no NaN. */
float hada_select_rank(float *values, size_t count, size_t k);

#endif
