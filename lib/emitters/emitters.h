/* Emitters of a frame: where points of light are between pixels and depths, fitted to the frame. Internal. */
#ifndef HADA_EMITTERS_EMITTERS_H
#define HADA_EMITTERS_EMITTERS_H

#include <hadalens/emitters.h>
#include <hadalens/monitor.h>

#include "model/model.h"
#include "runtime/slot.h"
#include "surface/magnification.h"

/* The pixels where a point between two depths has light, from the pixel of the point on. */
typedef struct hada_reach {
    int count;
    short (*offset)[2]; /* row, column */
} hada_reach;

/* The light of a point anywhere: the camera's point spread functions of one channel as splines, and the law that
 * carries them from depth to depth. On the host; read by any threads. */
typedef struct hada_point_optics {
    int depths, rows, cols; /* of the model's grid */
    int frame_rows, frame_cols, window_rows, window_cols;
    int wraps;           /* 1: light that leaves the sensor comes in on the other side (circular cameras) */
    float *coefficients; /* [depth][rows + HADA_POINT_MORE][cols + HADA_POINT_MORE], periodic, origin at (0, 0) */
    double *norm;        /* [depth] root of the sum of squares of a PSF */
    hada_reach *reach;   /* [depth]: of a point from this depth to the next */
    hada_magnification law;
    int known_distances;
} hada_point_optics;
enum { HADA_POINT_MORE = 8 };

/* Of `count` depths of a model (indices). The slot's device makes the splines. */
hada_status hada_point_optics_create(hada_point_optics **out, hada_slot *slot, const hada_model *model,
                                     const int *depths, int count, hada_error *err);
void hada_point_optics_destroy(hada_point_optics **optics);

/* Where a point is: row and column of the frame, and depth. */
typedef struct hada_point {
    double row, col, depth;
} hada_point;

/* A pixel that sees a point, and how it changes by the point's row, column and depth, and by its light, of 1. */
enum { HADA_POINT_ROW, HADA_POINT_COL, HADA_POINT_DEPTH, HADA_POINT_LIGHT, HADA_POINT_UNKNOWNS };
typedef struct hada_touch {
    int pixel;
    float by[HADA_POINT_UNKNOWNS];
} hada_touch;

/* Tables for one point at a time; of a thread. */
typedef struct hada_point_renderer hada_point_renderer;
hada_status hada_point_renderer_create(hada_point_renderer **out, const hada_point_optics *optics, hada_error *err);
void hada_point_renderer_destroy(hada_point_renderer **renderer);

/* Into `out`, which has room for the largest reach; pixels of weight 0 are left out. Returns how many. */
int hada_point_render(hada_point_renderer *renderer, const hada_point *point, const float *weights, hada_touch *out);
int hada_point_most(const hada_point_optics *optics);

typedef struct hada_emitters_job {
    const hada_point_optics *optics;
    const float *values;         /* of the frame, without its dark level, [row][col] */
    const float *weights;        /* of its pixels, 0 or more */
    const hada_image *planes;    /* the volume, a plane per depth */
    double noise;                /* standard deviation of the frame's, as it is guessed before anything is known */
    const hada_monitor *monitor; /* asked whether to stop; may be NULL */
} hada_emitters_job;

hada_status hada_emitters_find(hada_emitters **out, const hada_emitters_job *job, hada_error *err);

#endif
