/* Looking for the transform on a level. Internal. */
#ifndef HADA_REGISTER_REGISTER_SEARCH_H
#define HADA_REGISTER_REGISTER_SEARCH_H

#include "register/register_level.h"

/* What hada_register_scan() tries next to each other on a grid of HADA_REGISTER_COARSE: half of what spoils a match. */
#define HADA_REGISTER_STEP     0.05 /* of log magnification */
#define HADA_REGISTER_TURN_DEG 3.0
enum { HADA_REGISTER_COARSE = 64, HADA_REGISTER_FINEST = 256 };

/* The best magnification and rotation of each of the eight orientations (4 * mirrored + quarter turns) and its score.
 */
hada_status hada_register_scan(hada_register_level *level, const hada_register_options *options,
                               hada_registration best[8], double scores[8], hada_error *err);

/* Improves magnification and rotation, about `step` (of log magnification, and in radians) around, within the options'
 * range and one coarse step beyond. */
hada_status hada_register_refine(hada_register_level *level, const hada_register_options *options, double step,
                                 hada_registration *at, double *score, hada_error *err);

#endif
