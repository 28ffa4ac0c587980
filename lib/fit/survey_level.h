/* Pairs on a small grid: how much of a frame a convolution that others of its depth give leaves unexplained, and with
 * which exposure. Internal. */
#ifndef HADA_FIT_SURVEY_LEVEL_H
#define HADA_FIT_SURVEY_LEVEL_H

#include <hadalens/image.h>

#include "image/small_fft.h"

/* Of one pair: what is left of its frame, and the products of frame and prediction, and of the prediction with itself,
 * at exposure 1. */
typedef struct hada_survey_judgement {
    double left, cross, power;
} hada_survey_judgement;

typedef struct hada_survey_level {
    hada_small_fft fft;
    int channels, most, count; /* pairs: room, and how many there are */
    size_t plane;              /* frequencies of half a spectrum */
    int *depth;                /* of each pair */
    float *frame, *scene;      /* [pair][channel][plane] complex */
    double *frame_energy;      /* per pair: over all frequencies, both halves */
    double *frame_light, *scene_light;
    hada_survey_judgement *judged;
    double *sums; /* room: of a channel, [plane][3] */
    float *work;  /* room: a transform */
} hada_survey_level;

/* size: a side of the grid, a power of two. */
hada_status hada_survey_level_create(hada_survey_level *level, int size, int channels, int most, hada_error *err);
void hada_survey_level_destroy(hada_survey_level *level);

/* Puts a pair at a place: frame without dark level, scene in light, of the level's channels; both fit on the grid. */
void hada_survey_level_put(hada_survey_level *level, int place, int depth, const hada_image *frame,
                           const hada_image *scene);

/* Per pair: the unexplained share of its frame, and (unless NULL) the exposure that would explain it best, when the
 * other pairs of its depth are taken with their exposures `gain`. Pairs of exposure 0 say nothing to others. */
void hada_survey_level_judge(hada_survey_level *level, const double *gain, double *unexplained, double *better);

/* Exposures of all pairs, from their light, then from each other, and what is unexplained with them. Their geometric
 * mean within a depth is 1. `room`: a number per pair. */
void hada_survey_level_expose(hada_survey_level *level, double *gain, double *unexplained, double *room);

#endif
