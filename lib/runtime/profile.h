/* What the commands of a slot took: events, added up by stage and kernel. Internal.
 *
 * Off by default, and then nothing is kept. Who launches says beforehand what the work needs (hada_slot_cost), and who
 * knows the stage says that (hada_slot_stage); a launch without a cost counts no bytes and no operations. */
#ifndef HADA_RUNTIME_PROFILE_H
#define HADA_RUNTIME_PROFILE_H

#include <hadalens/profile.h>

#include "runtime/slot.h"

/* Starts with nothing recorded, or ends and forgets. */
hada_status hada_slot_profile(hada_slot *slot, int on, hada_error *err);

/* Waits for the slot and adds what it recorded so far to *rows (freed by the caller with free(), also on failure). Rows
 * of the same stage and name are merged; their order is that of first use. */
hada_status hada_slot_times(hada_slot *slot, hada_kernel_time **rows, size_t *count, hada_error *err);

/* Keeps a command that was enqueued; takes the events. `begin` NULL: it took from the start of `end` to its end, else
 * from the end of `begin`. hada_slot_times() reports a failure to keep it. */
void hada_profile_add(hada_slot *slot, const char *name, int transfer, cl_event begin, cl_event end);

/* The kernels that find a device's ceilings. Internal; hada_device_peaks() times them, the check tool holds them. */

/* Floats that a kernel takes at a time on a context's device; on CPUs peak_flops has 16 as well. */
int hada_peak_width(const hada_context *context);

/* out = in, `count` floats (a multiple of the width). */
hada_status hada_peak_copy(hada_slot *slot, cl_mem in, cl_mem out, size_t count, hada_error *err);

/* `items` work-items: out[item * width + lane] = sum over HADA_PEAK_CHAINS chains k of v, v = v * factor + term for
 * `rounds` rounds from k + item % 16. *flops (may be NULL): operations of it all. */
hada_status hada_peak_flops(hada_slot *slot, int width, cl_mem out, size_t items, float factor, float term, int rounds,
                            double *flops, hada_error *err);

#endif
