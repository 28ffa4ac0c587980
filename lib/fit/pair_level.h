/* Pairs on a small grid: reduced copies of frames and scenes, and how much of a frame a convolution that the others of
 * its depth give leaves unexplained, and with which exposure. Internal. */
#ifndef HADA_FIT_PAIR_LEVEL_H
#define HADA_FIT_PAIR_LEVEL_H

#include <hadalens/fit.h>

#include "image/small_fft.h"

/* Rounds in which exposures are found from each other: on simulated and real pairs the third changed them by less than
 * a percent. */
enum { HADA_PAIR_LEVEL_ROUNDS = 3 };

/* How frames and scenes become small. */
typedef struct hada_reducer {
    const hada_fit_options *options;
    int factor, grid; /* pixels that become one; a side of the small grid */
    double response;  /* in which frames are encoded: linear, unless it is set */
    float *room;      /* a channel of a frame */
} hada_reducer;

/* grid: a side that frame and window shall fill together, a power of two; 0: as wide as a survey needs it. */
hada_status hada_reducer_create(hada_reducer *reducer, const hada_fit_options *options, int grid, hada_error *err);
void hada_reducer_destroy(hada_reducer *reducer);
/* Whether a pair is one that the fit will take. */
int hada_reducer_fits(const hada_reducer *reducer, const hada_image *raw, const hada_image *scene);
/* The frame in light, without dark level; the scene in light. *out is created by the call. */
hada_status hada_reduce_frame(const hada_reducer *reducer, const hada_image *raw, hada_image *out, hada_error *err);
hada_status hada_reduce_scene(const hada_reducer *reducer, const hada_image *scene, double response, hada_image *out,
                              hada_error *err);

/* Of one pair: its frame's energy, what is left of that, and the products of frame and prediction, and of the
 * prediction with itself, at exposure 1. */
typedef struct hada_judgement {
    double energy, left, cross, power;
} hada_judgement;

typedef struct hada_pair_level {
    hada_small_fft fft;
    int channels, most, count; /* pairs: room, and how many there are */
    size_t plane;              /* frequencies of half a spectrum */
    int *depth;                /* of each pair */
    float *frame, *scene;      /* [pair][channel][plane] complex */
    double *frame_energy;      /* per pair: over all frequencies, both halves */
    double *frame_light, *scene_light;
    hada_judgement *judged;
    int sharp;    /* 1: judged without low frequencies, where smooth light is */
    double *sums; /* room: of a channel, [plane][3] */
    float *work;  /* room: a transform */
} hada_pair_level;

/* size: a side of the grid, a power of two. */
hada_status hada_pair_level_create(hada_pair_level *level, int size, int channels, int most, hada_error *err);
void hada_pair_level_destroy(hada_pair_level *level);
/* Puts a pair at a place: frame without dark level, scene in light, of the level's channels; both fit on the grid. */
void hada_pair_level_put(hada_pair_level *level, int place, int depth, const hada_image *frame,
                         const hada_image *scene);
/* Per pair: the unexplained share of its frame, and (unless NULL) the exposure that would explain it best, when the
 * other pairs of its depth, and with `itself` the pair as well, are taken with their exposures `gain`. Pairs of
 * exposure 0 say nothing to others. */
void hada_pair_level_judge(hada_pair_level *level, const double *gain, int itself, double *unexplained, double *better);
/* What the other pairs of its depth, all at exposure 1, leave of a channel of a pair's frame: a half spectrum of
 * `plane` complex values. And the scalar product of two such over all frequencies. */
void hada_pair_level_residual(hada_pair_level *level, int pair, int channel, float *left);
/* How much of each frame of its depth, [pair][plane] complex, is left there: 1 of its own, and what the others' say of
 * it with the opposite sign. */
void hada_pair_level_shares(hada_pair_level *level, int pair, int channel, float *shares);
double hada_pair_level_product(const hada_pair_level *level, const float *a, const float *b);
/* Exposures of all pairs, from their light, then from each other, and what is unexplained with them. Their geometric
 * mean within a depth is 1. `room`: a number per pair. */
void hada_pair_level_expose(hada_pair_level *level, double *gain, double *unexplained, double *room);
/* Improves exposures by comparing the pairs of a depth with each other, in so many rounds. A pair of exposure 0 takes
 * no part. */
void hada_pair_level_even(hada_pair_level *level, int rounds, double *gain, double *unexplained, double *room);
/* Multiplies each scene by its exposure. */
void hada_pair_level_brighten(hada_pair_level *level, const double *gain);

#endif
