/* The kernels that find a device's ceilings. Internal; hada_device_peaks() times them, the check tool holds them. */
#ifndef HADA_RUNTIME_PEAKS_H
#define HADA_RUNTIME_PEAKS_H

#include "runtime/slot.h"

/* Floats that a kernel takes at a time on a context's device; on CPUs peak_flops has 16 as well. */
int hada_peak_width(const hada_context *context);

/* out = in, `count` floats (a multiple of the width). */
hada_status hada_peak_copy(hada_slot *slot, cl_mem in, cl_mem out, size_t count, hada_error *err);

/* `items` work-items: out[item * width + lane] = sum over HADA_PEAK_CHAINS chains k of v, v = v * factor + term for
 * `rounds` rounds from k + item % 16. *flops (may be NULL): operations of it all. */
hada_status hada_peak_flops(hada_slot *slot, int width, cl_mem out, size_t items, float factor, float term, int rounds,
                            double *flops, hada_error *err);

#endif
