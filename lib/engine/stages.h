/* Inside a pipeline: its parts, and the stages that a frame goes through. For the files of this folder alone.
 *
 * Each stage leaves its seconds in the frame's report. */
#ifndef HADA_ENGINE_STAGES_H
#define HADA_ENGINE_STAGES_H

#include "classic/classic.h"
#include "engine/pipeline.h"
#include "filter/hadamard.h"
#include "refine/admm.h"

/* What a frame needs of whose pixels some have weights, made when there first is one. */
typedef struct hada_weighing {
    hada_buffer raw;       /* the frame as it came: the stage has it filled */
    hada_refiner *refiner; /* these two of a circular camera, whose own refiner uses no weights */
    hada_buffer pixels;
    hada_plane_maker before; /* the pipeline's, while `used` */
    int used;
} hada_weighing;

/* Stray light of a frame, for the next one of a sequence. */
typedef struct hada_stray {
    int known;      /* 1: there was some: */
    double *weight; /* [channel][HADA_SMOOTH_TERMS] */
    double left;    /* what planes left when it was last looked for, in units of the frame's energy; 0: never */
} hada_stray;

struct hada_pipeline {
    const hada_setup *setup;
    const hada_constants *constants;
    int batch;
    hada_slot *slot;      /* NULL: to be made again */
    hada_scratch scratch; /* memory that the parts below share */
    hada_hadamard *stage;
    hada_meter *meter; /* NULL where spectra are not measured */
    hada_pursuit *pursuit;
    double usual_energy;   /* of frames of the pairs, about: that of their mean; 0: not known */
    hada_refiner *refiner; /* this or the next, or neither */
    hada_classic *classic;
    hada_plane_maker maker; /* of these: from a frame on the device to planes */
    hada_weighing weighing;
    hada_classic *volume;           /* this and the surface are made when a frame first needs them */
    hada_classic_result volume_now; /* of the current frame, as far as it went */
    hada_classic_sieved sieved;     /* and as tissue; without iterations where that was not looked for */
    hada_surface *surface;
    hada_surface_result shape; /* of the current frame */
    int no_surface;            /* 1: this camera, or the device's memory, allows none */
    hada_focus *focus;
    hada_enhance *enhance; /* NULL where no net is used */
    hada_buffer planes;    /* linear: a batch, [depth][channel][window]; joint, blended: one */
    hada_buffer pictures;  /* all-in-focus image, then distance map */
    int *occupied, *all;   /* lists of computed depths, ascending; of all of them */
    hada_maker_past past;  /* of a sequence */
    hada_stray stray;      /* of the frame before */
    int residual_due;      /* 1: the residual of the current frame is being read */
    uint64_t loaded;       /* serial of the frame with its spectrum in the stage; 0: none */
};

/* Bytes of device memory that the plan leaves to a pipeline for what a frame may need beyond it. */
hada_status hada_pipeline_room(const hada_pipeline *pipeline, uint64_t *bytes, hada_error *err);

/* Makes the parts of a pipeline that has a slot; a failure leaves some of them, for hada_pipeline_clear(). */
hada_status hada_pipeline_make_parts(hada_pipeline *pipeline, hada_error *err);

void hada_pipeline_clear(hada_pipeline *pipeline);

/* Adds the time since the last call to *seconds. Waits for the queue first where that costs next to nothing, on devices
 * that work in the host's memory; elsewhere stages run into each other. */
hada_status hada_pipeline_lap(hada_pipeline *pipeline, hada_frame *frame, double *seconds, hada_error *err);

/* Makes the Hadamard stage leave out what the frame does not need. */
void hada_pipeline_apply_skip(hada_pipeline *pipeline, const hada_frame *frame);

/* Brings a prepared frame and its spectrum into the Hadamard stage, unless they are there. */
hada_status hada_pipeline_load(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);

/* `count` planes through the model's net, in place; together: 1 where they are all that explain the frame jointly.
 * Nothing where the plan uses none. */
hada_status hada_pipeline_enhance(hada_pipeline *pipeline, hada_frame *frame, cl_mem planes, int count, int together,
                                  hada_error *err);

/* `count` planes, from number `place` of the buffer on, into the result as those of as many
 * depths from `depth` on; with the caller's buffer on the device, where there is one. Enqueued: they are there once the
 * slot is waited for. */
hada_status hada_pipeline_read_planes(hada_pipeline *pipeline, hada_frame *frame, const hada_buffer *planes, int place,
                                      int depth, int count, hada_error *err);

/* Zeros for the depths of the result that are not occupied. */
hada_status hada_pipeline_dark_planes(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);

/* Where the light of a frame is said to be: at `count` depths, those of pipeline->occupied, or on a surface, which is
 * pipeline->shape. */
typedef struct hada_support_of {
    int surface, count;
    int early; /* 1: there may be more depths, or a surface */
} hada_support_of;

/* Looks whether a frame is a volume; then its planes, of all depths, are hada_classic_planes() of pipeline->volume, and
 * the report says so. energy: what planes or a surface leave; below 0: not known, and only what is plain after few
 * iterations is found; else `against` says what they are. The planes of the result are overwritten. The frame must be
 * loaded. */
hada_status hada_pipeline_find_volume(hada_pipeline *pipeline, hada_frame *frame, double energy,
                                      const hada_support_of *against, int *found, hada_error *err);

/* The planes of a frame that the caller takes for a volume, by pipeline->classic. */
hada_status hada_pipeline_solve_volume(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);

/* For a frame that no depth explains: everything dark, no distance anywhere. */
hada_status hada_pipeline_no_pictures(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);

/* Planes' light that is no more than what the frame leaves unexplained: where a pixel and its neighbours have no more,
 * there is no distance. From the report's residual; 0 where that is not known. */
double hada_pipeline_noise_light(const hada_frame *frame);

/* All-in-focus image and distance map from what was pushed to the focus, into the result; enqueued as well. No distance
 * where there is no more than `light` (0: not looked at). */
hada_status hada_pipeline_pictures(hada_pipeline *pipeline, hada_frame *frame, double light, hada_error *err);

/* The two paths from a loaded frame to its result: linear filters, depths in batches; or the occupied depths jointly,
 * by refinement or a classic method. */
hada_status hada_pipeline_linear(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);
hada_status hada_pipeline_joint(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);

/* Finds the surface that explains the frame and keeps it in the pipeline. enough: the most energy that it may leave, 0:
 * any. *found: 0 where this camera has none, with why in the log, or where it would leave more than enough by far;
 * energy: what it leaves unexplained. */
hada_status hada_pipeline_find_surface(hada_pipeline *pipeline, hada_frame *frame, double enough, int *found,
                                       double *energy, hada_error *err);
/* The result, from the surface that was found last. */
hada_status hada_pipeline_take_surface(hada_pipeline *pipeline, hada_frame *frame, double energy, hada_error *err);

/* Whether a frame that is refined has values that say little or nothing: saturated, not finite, or of a small weight.
 */
int hada_pipeline_has_gaps(const hada_pipeline *pipeline, const hada_frame *frame);

/* Keeps the frame as it came, and lets refinement use its weights, until the frame ends: a circular camera is refined
 * as one whose sensor crops. *weighs: 0 where the device's memory does not allow it, which is said. */
hada_status hada_pipeline_weigh(hada_pipeline *pipeline, int *weighs, hada_error *err);
void hada_pipeline_weigh_end(hada_pipeline *pipeline);
void hada_weighing_free(hada_weighing *weighing);

/* Replaces saturated values, and those of weight 0, by what the `count` planes in the refiner predict, and loads the
 * frame again, for its spectrum. */
hada_status hada_pipeline_fill(hada_pipeline *pipeline, hada_frame *frame, int count, hada_error *err);

/* A path from a loaded frame to its result; gone again where the planes leave much of the frame and stray light is
 * found, which was taken off then. */
typedef hada_status (*hada_path)(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);
hada_status hada_pipeline_without_stray_light(hada_pipeline *pipeline, hada_frame *frame, hada_path path,
                                              hada_error *err);

/* What refinement left of the frame, into its report, once the slot was waited for; nothing where none was done. */
void hada_pipeline_residual(hada_pipeline *pipeline, const hada_frame *frame);

/* The linear path for one batch, without the focus. */
hada_status hada_pipeline_linear_batch(hada_pipeline *pipeline, hada_frame *frame, int first, int count,
                                       hada_error *err);

/* What a frame does not need, and bounds of what that changes (docs/explanation/speed-and-accuracy.md).
 *
 * Which frequencies are left out, once the spectrum is in the pipeline's stage. */
hada_status hada_skip_frequencies(hada_pipeline *pipeline, hada_frame *frame, hada_error *err);

/* What was skipped, into the report of the frame. */
void hada_skip_fill_report(hada_frame *frame);

#endif
