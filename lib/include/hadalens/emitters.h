/* Hadalens: the emitters of a volume, one by one.
 *
 * A volume has light in voxels. Where it is that of points, such as fluorescent beads or molecules, a few numbers say
 * more: each emitter's place between the pixels and depths, and its light. They are found in the volume and then fitted
 * together to the frame itself (docs/explanation/surfaces.md#emitters).
 *
 * Threads: as hada_plan_run(). */
#ifndef HADALENS_EMITTERS_H
#define HADALENS_EMITTERS_H

#include <hadalens/monitor.h>
#include <hadalens/reconstruct.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The library's; later versions may append to it. */
typedef struct hada_emitter {
    double x, y, z;     /* column and row of the window, and depth among those that are computed; all from 0 on, whole
                           numbers being the centres of pixels and the depths themselves */
    double distance_mm; /* of z, linear in 1 / distance between two depths; NaN where distances are not known */
    double amplitude;   /* light, in the unit of a voxel of the volume */
    double sd_x, sd_y, sd_z, sd_amplitude; /* standard deviations; sd_z is 0 for a camera of one depth */
    double residual;                       /* root of the mean square of what is left of the frame where the emitter's
                                              light falls, weighted by its square; in units of the frame's values */
} hada_emitter;

/* Those of a frame, one block of memory, given back by hada_memory_destroy(); later versions may append to it. */
typedef struct hada_emitters {
    int count;
    const hada_emitter *const *list; /* by falling amplitude */
} hada_emitters;

/* Finds the emitters of a frame of one channel that the plan reconstructed as a volume. raw: that frame; result: what
 * the plan made of it; monitor: asked whether to stop, may be NULL. An emitter must be so bright
 * that noise alone would give one in twenty frames. HADA_ERROR_ARGUMENT: the frame was taken for something else;
 * HADA_ERROR_MODEL: the camera has colours; HADA_ERROR_MEMORY: there are so many that they take more than 1 GiB. */
HADA_API hada_status hada_plan_emitters(hada_emitters **out, hada_plan *plan, const hada_pixels *raw,
                                        const hada_result *result, const hada_monitor *monitor, hada_error *err);

/* Joins the emitters of successive frames to tracks. */
typedef struct hada_tracker hada_tracker;

/* pixels, depths: the largest motion from a frame to the next; deviations of places add to it. gap: a track goes on
 * after so many frames without its emitter. */
HADA_API hada_status hada_tracker_create(hada_tracker **out, double pixels, double depths, int gap, hada_error *err);
/* Adds a frame's emitters, `count` of them. tracks[i]: the track of emitters[i], counted from 0 in the order in which
 * tracks begin; no two emitters of a frame have the same. At a failure nothing is added. */
HADA_API hada_status hada_tracker_add(hada_tracker *tracker, const hada_emitter *const *emitters, int count,
                                      int *tracks, hada_error *err);
HADA_API void hada_tracker_destroy(hada_tracker **tracker);

#ifdef __cplusplus
}
#endif
#endif
