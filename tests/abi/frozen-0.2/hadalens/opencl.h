/* Hadalens and a program's own OpenCL: contexts, devices, queues and buffers change hands here, and only here; the
 * other headers need no OpenCL.
 *
 * Buffers hold dense float32 values: a frame [channel][row][col] in linear intensity, as the model has it; a stack
 * [depth][channel][row][col]; offsets are in bytes, multiples of 4. Objects that are handed in stay the caller's and
 * must live as long as what was made from them; what is handed out stays the library's. Retain it to keep it.
 *
 * Order. A frame's queue says when its pixels are there: the library waits for all commands that were enqueued in it.
 * What comes out is complete when hada_plan_run_cl() has returned or the job has ended, in every queue of the context.
 * No buffer may be written by others meanwhile.
 *
 * Errors are statuses, as everywhere; hada_error.cl_code holds OpenCL's. Threads: as in reconstruct.h and job.h.
 * Source: the OpenCL Specification 1.2, Khronos (2012). */
#ifndef HADALENS_OPENCL_H
#define HADALENS_OPENCL_H

#ifndef CL_TARGET_OPENCL_VERSION
#define CL_TARGET_OPENCL_VERSION 120
#endif
#include <CL/cl.h>
#include <hadalens/job.h>

#ifdef __cplusplus
extern "C" {
#endif

/* As hada_context_create(), on a device of an OpenCL context that is there already (both are retained). Of the options,
 * device, part and parts are not looked at. HADA_ERROR_DEVICE_CHOICE where the device is none of the context's. */
HADA_API hada_status hada_context_adopt(hada_context **out, cl_context context, cl_device_id device,
                                        const hada_context_options *options, hada_error *err);

HADA_API cl_context hada_context_cl_context(const hada_context *context);
HADA_API cl_device_id hada_context_cl_device(const hada_context *context);

/* The in-order queue that a queue of a plan works on (0 <= index < hada_plan_queues()), while the plan is there; NULL
 * where it has none now, and another one after hada_plan_profile(). Commands may be enqueued in it while no frame runs.
 */
HADA_API cl_command_queue hada_plan_cl_queue(const hada_plan *plan, int index);

/* A frame on the device. Begin with hada_cl_frame_init(). */
typedef struct hada_cl_frame {
    size_t size; /* sizeof(hada_cl_frame) */
    cl_mem pixels;
    size_t offset;
    cl_command_queue queue; /* whose commands so far are waited for; NULL (default): the pixels are there */
} hada_cl_frame;
HADA_INIT(hada_cl_frame, HADA_STRUCT_CL_FRAME)

/* Buffers on the device that a result is written into as well; NULL: not. Begin with hada_cl_arrays_init(). */
typedef struct hada_cl_arrays {
    size_t size; /* sizeof(hada_cl_arrays) */
    cl_mem stack, all_in_focus, distance_map;
    size_t stack_offset, all_in_focus_offset, distance_map_offset;
} hada_cl_arrays;
HADA_INIT(hada_cl_arrays, HADA_STRUCT_CL_ARRAYS)

/* From now on, until hada_result_destroy(), this result is written into these buffers too, without a way over the
 * host. Plans that fill it have one context, that of the buffers, and a gamma of 1 (HADA_ERROR_UNSUPPORTED otherwise);
 * buffers that are too small are HADA_ERROR_SIZE. HADA_SKIP_FRAMES is not used for such results. */
HADA_API hada_status hada_result_use_cl(hada_result *result, const hada_cl_arrays *arrays, hada_error *err);

/* As hada_plan_run() and hada_job_submit(), of a frame on the device, in the context of the plan, which has one. The
 * frame is transformed where it stands; the host reads it once, for its checks and its dark level, before
 * hada_job_submit_cl() returns. */
HADA_API hada_status hada_plan_run_cl(hada_plan *plan, const hada_cl_frame *raw, hada_result *result, hada_error *err);
HADA_API hada_status hada_job_submit_cl(hada_job **out, hada_plan *plan, const hada_cl_frame *raw, hada_result *result,
                                        hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
