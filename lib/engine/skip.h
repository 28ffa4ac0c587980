/* What a frame does not need, and bounds of what that changes (docs/skipping.md). Internal. */
#ifndef HADA_ENGINE_SKIP_H
#define HADA_ENGINE_SKIP_H

#include "engine/frame.h"

typedef struct hada_pipeline hada_pipeline;

/* Which channels are black or equal, once the levels are known. */
void hada_skip_channels(hada_frame *frame);

/* Which frequencies are left out, once the spectrum stands in the pipeline's stage. */
hada_status hada_skip_frequencies(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);

/* Whether planes must come from filters in single precision, which the bank does not hold, and computing them: as
 * hada_hadamard_run(). */
int hada_skip_needs_single(const hada_frame *frame);
hada_status hada_skip_run_single(hada_pipeline *pipeline, int first, int count, hada_error *err);

/* After the planes came home: whether max_error was kept. Where not, the bounded kinds are off from now on and the
 * planes must be computed again. */
int hada_skip_kept(hada_frame *frame);

/* A change of the stack by at most `change`, relative to what the stack would be without it, which is at least its norm
 * - change: L2 over all pixels. Infinite where nothing can be said. */
double hada_skip_relative(double change, double norm);

/* What was skipped, into the report of the frame. */
void hada_skip_fill_report(hada_frame *frame);

#endif
