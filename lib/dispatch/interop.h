/* Frames and results that stand on the device of a program of its own (hadalens/opencl.h). Internal. */
#ifndef HADA_DISPATCH_INTEROP_H
#define HADA_DISPATCH_INTEROP_H

#include <hadalens/opencl.h>

#include "dispatch/plan.h"

/* Whether the plan can fill the buffers that the result names, if any. */
hada_status hada_interop_check_result(const hada_plan *plan, const hada_result *result, hada_error *err);

/* A caller's frame, which may be of another version, taken over and checked for the plan. */
hada_status hada_interop_take_frame(hada_cl_frame *own, const hada_plan *plan, const hada_cl_frame *callers,
                                    hada_error *err);

/* Its values on the host, once its queue has done what it had to; *image has the model's sizes. */
hada_status hada_interop_read_frame(const hada_cl_frame *frame, const hada_plan *plan, hada_image *image,
                                    hada_error *err);

#endif
