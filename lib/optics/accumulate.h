/* The product-sum of the forward model on the device. Internal. */
#ifndef HADA_OPTICS_ACCUMULATE_H
#define HADA_OPTICS_ACCUMULATE_H

#include "runtime/slot.h"

/* Enqueues sum[c] = otf[c % otf_images] * scene[c] (add 0) or adds that to it (add 1), for `images` images c of `count`
 * complex numbers each; `sum_offset` in complex numbers. */
hada_status hada_optics_accumulate(hada_slot *slot, cl_mem sum, size_t sum_offset, cl_mem otf, int otf_images,
                                   cl_mem scene, int images, size_t count, int add, hada_error *err);

#endif
