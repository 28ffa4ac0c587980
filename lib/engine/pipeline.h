/* A pipeline: one in-order queue of a device, with all that a frame needs on its way. Internal.
 *
 * A pipeline is used by one thread at a time; those of a plan are independent and only read what they share. */
#ifndef HADA_ENGINE_PIPELINE_H
#define HADA_ENGINE_PIPELINE_H

#include <hadalens/profile.h>

#include "engine/constants.h"
#include "engine/frame.h"

typedef struct hada_pipeline hada_pipeline;

/* `batch`: depths at once. */
hada_status hada_pipeline_create(hada_pipeline **out, const hada_setup *setup, const hada_constants *constants,
                                 int batch, hada_error *err);
void hada_pipeline_destroy(hada_pipeline **pipeline); /* waits for its queue */

/* Takes a begun frame through all stages; its result is complete then. Where the device's memory is short it is tried
 * again in smaller batches, on the linear path. After a failure the pipeline is ready for the next frame. */
hada_status hada_pipeline_run(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);

/* Planes of depths first ... first + count - 1 of a frame that another pipeline runs, into its result. */
hada_status hada_pipeline_help(hada_pipeline *pipeline, hada_frame *frame, int first, int count, hada_error *err);

/* Depths at once; becomes smaller where memory is short. */
int hada_pipeline_batch(const hada_pipeline *pipeline);

/* The queue that it works on; NULL where it has none now. */
cl_command_queue hada_pipeline_queue(const hada_pipeline *pipeline);

/* Profiling (hadalens/profile.h). One that was lost, or made again since, is not profiled. */
hada_status hada_pipeline_profile(hada_pipeline *pipeline, int on, hada_error *err);
int hada_pipeline_is_profiled(const hada_pipeline *pipeline);
hada_status hada_pipeline_times(hada_pipeline *pipeline, hada_kernel_time **rows, size_t *count, hada_error *err);

/* What it asked of its device since it was made, or made again. */
hada_calls hada_pipeline_calls(const hada_pipeline *pipeline);

/* Bytes of device memory that a pipeline holds, without a surface, and would hold if no buffers shared memory. */
hada_status hada_pipeline_bytes(const hada_context *context, const hada_model *model, const hada_config *config,
                                int batch, uint64_t *bytes, uint64_t *apart, hada_error *err);

/* Bytes that are needed while one is made, beyond what it holds in the end. */
uint64_t hada_pipeline_making_bytes(const hada_context *context, const hada_model *model);

/* Depths at once such that `queues` pipelines fit a device: its memory and its largest allocation. */
int hada_pipeline_fit(const hada_context *context, const hada_model *model, const hada_config *config, int queues);

#endif
