/* A pipeline: one in-order queue of a device, with all that a frame needs on its way. Internal.
 *
 * A pipeline is used by one thread at a time; those of a plan are independent and only read what they share. */
#ifndef HADA_ENGINE_PIPELINE_H
#define HADA_ENGINE_PIPELINE_H

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

/* The slot that it works on; NULL where it has none now. A slot that is made again is not profiled, and counts its
 * calls from zero. */
hada_slot *hada_pipeline_slot(const hada_pipeline *pipeline);

/* Device memory that a plan takes on a device, known by making its parts dry (runtime/memory.h). */
typedef struct hada_needs {
    uint64_t constants; /* what all pipelines share, without surfaces */
    uint64_t each;      /* a pipeline, without a surface */
    uint64_t apart;     /* a pipeline, if no buffers shared memory */
    uint64_t making;    /* at most beside, while a pipeline is made */
} hada_needs;
hada_status hada_pipeline_needs(hada_needs *needs, const hada_context *context, const hada_setup *setup, int batch,
                                hada_error *err);

/* Depths at once such that the plan's pipelines fit a device: its memory and its largest allocation. */
int hada_pipeline_fit(const hada_context *context, const hada_setup *setup);

#endif
