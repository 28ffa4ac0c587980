/* Planes clipped at zero, as reconstruction has them: light is not negative. Internal. */
#ifndef HADA_FILTER_CLIP_H
#define HADA_FILTER_CLIP_H

#include "runtime/launch.h"

/* The launch over `count` floats from `offset` on of kernels with kernels/inc_values.h. */
hada_range hada_values_range(const hada_slot *slot, size_t offset, size_t count);

/* The first `count` floats of a buffer (enqueued). */
hada_status hada_image_clip(hada_slot *slot, cl_mem planes, size_t count, hada_error *err);

/* `count` floats from `offset` on: share times these, plus the rest times the first floats of `others`, both clipped
 * (enqueued). */
hada_status hada_image_blend(hada_slot *slot, cl_mem planes, size_t offset, cl_mem others, size_t count, double share,
                             hada_error *err);

#endif
