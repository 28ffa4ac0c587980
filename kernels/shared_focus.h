/* Constants and structs of the focus measure, for kernels and host. */
#ifndef SHARED_FOCUS_H
#define SHARED_FOCUS_H

#include "shared_types.h"

#define HADA_FOCUS_DEPTHS 8     /* planes in a launch, at most */
#define HADA_FOCUS_BINS   32768 /* of a count: patterns of floats without sign, their upper 16 bits */

#define HADA_FOCUS_REACH 64 /* the widest window reaches that far, and less */

/* Rows of a tile of `cols` columns in local memory: of luminance, for vectors of `width`, and of responses. */
#define HADA_FOCUS_LIGHT_PITCH(cols, width) ((cols) + 2 * HADA_FOCUS_REACH + (width))
#define HADA_FOCUS_EDGES_PITCH(cols)        ((cols) + 2 * HADA_FOCUS_REACH)

/* Numbers of hada_focus_measure (<hadalens/focus.h>). */
#define FOCUS_MEASURE_CONTRAST 1
#define FOCUS_MEASURE_ENERGY   2
#define FOCUS_MEASURE_COMBINED 3 /* both */

/* Planes of a launch: their places behind `offset` (in floats), in planes, and their numbers, near to far. */
typedef struct hada_focus_batch {
    hada_ulong offset;
    int place[HADA_FOCUS_DEPTHS], depth[HADA_FOCUS_DEPTHS];
    int count;
} hada_focus_batch;
HADA_SHARED_SIZE(hada_focus_batch, 80)

/* The images of a focus object: rows of its own images are `pitch` apart. */
typedef struct hada_focus_image {
    int channels, rows, cols, pitch;
    int radius; /* of the window */
    int measure;
} hada_focus_image;
HADA_SHARED_SIZE(hada_focus_image, 24)

/* The state before a launch. */
typedef struct hada_focus_past {
    int seen;       /* planes of this frame; 0: nothing kept is read */
    int last_depth; /* of the last of them */
    int weighted;   /* all-in-focus is the mean weighted by the measures, else the sum */
} hada_focus_past;
HADA_SHARED_SIZE(hada_focus_past, 12)

/* Where a pixel has a distance: the best measure above `threshold`, and by more than `margin` above those that are not
 * next to it, and the all-in-focus image above `light`, if that is not 0: the mean of its channels, HADA_FOCUS_NEAR
 * pixels to every side. `base`: the level of losing depths. */
#define HADA_FOCUS_NEAR 2
typedef struct hada_focus_limits {
    float threshold, margin, base, light;
} hada_focus_limits;
HADA_SHARED_SIZE(hada_focus_limits, 16)

#endif
