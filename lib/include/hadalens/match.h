/* Hadalens: whether a camera belongs to a frame.
 *
 * A point spread function that was taken or saved upside down, mirrored, at another size or with another camera gives
 * planes all the same, of nothing. hada_plan_match() compares what the camera leaves unexplained of a frame with what
 * it leaves when its point spread functions are turned or magnified.
 *
 * Threads: as hada_plan_run(). */
#ifndef HADALENS_MATCH_H
#define HADALENS_MATCH_H

#include <hadalens/reconstruct.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_match_verdict {
    HADA_MATCH_UNKNOWN = 0,   /* noise is all that is left, the frame or model says too little (fewer than 48 pixels a
                                 side, no transfer functions), or the camera is symmetric */
    HADA_MATCH_BELONGS = 1,   /* the camera explains the frame, turned or magnified ones do not */
    HADA_MATCH_TURNED = 2,    /* the turned camera explains it better */
    HADA_MATCH_MAGNIFIED = 3, /* the magnified camera does; looked for in cameras of one depth */
    HADA_MATCH_UNRELATED = 4  /* the camera explains it no better than turned or magnified ones */
} hada_match_verdict;

typedef struct hada_match {
    size_t size; /* sizeof(hada_match), set by the caller */
    hada_match_verdict verdict;
    hada_turn turn;       /* TURNED: how point spread functions have to be turned */
    double magnification; /* MAGNIFIED: how, in steps of some hundredths from 0.9 to 1.1; else 1 */
    double factor;        /* what the camera leaves unexplained over what the best other way leaves: above 1 the other
                             way is better. 0 where no other way was compared */
    double unexplained;   /* of the frame's fine structure, at a reduced size: |left| / |frame|; NaN: not computed */
} hada_match;

/* Compares a camera as it is with turned and magnified ones, on a frame of the plan's (its first device, its dark
 * level). It takes about as long as refining a frame of 256 x 256 pixels four times, ten times where no turn explains
 * the frame. */
HADA_API hada_status hada_plan_match(const hada_plan *plan, const hada_pixels *raw, hada_match *match, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
