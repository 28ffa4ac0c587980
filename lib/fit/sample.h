/* Pairs that are looked at before a fit, on a small grid, and what is left of their frames. Internal. */
#ifndef HADA_FIT_SAMPLE_H
#define HADA_FIT_SAMPLE_H

#include "core/callers.h"
#include "dataset/dataset.h"
#include "fit/pair_level.h"

/* Pairs of the nearest, the middle and the farthest depth. Fewer than HADA_SAMPLE_LEAST of a depth leave none to learn
 * from when one is held out. Scenes are taken in so many responses at most. */
enum {
    HADA_SAMPLE_DEPTHS = 3,
    HADA_SAMPLE_EACH = 6,
    HADA_SAMPLE_MOST = HADA_SAMPLE_DEPTHS * HADA_SAMPLE_EACH,
    HADA_SAMPLE_LEAST = 2,
    HADA_SAMPLE_RESPONSES = 8
};
/* Shares below this, of frames without noise, count as this. */
#define HADA_LEAST_SHARE 1e-9

typedef struct hada_sample {
    hada_fit_options options;
    const hada_dataset *pairs;
    const int *counts; /* pairs of each depth */
    hada_progress progress;
    int grid; /* as hada_reducer_create() has it */
    hada_reducer reducer;
    int tried; /* responses: 1 where it is given; 0: frames alone are looked at */
    const double *response;
    hada_pair_level level;
    int count, depth[HADA_SAMPLE_MOST];
    double noise[HADA_SAMPLE_MOST]; /* of a reduced pixel, where frames alone are looked at */
    hada_image frame[HADA_SAMPLE_MOST], scene[HADA_SAMPLE_MOST][HADA_SAMPLE_RESPONSES];
    double unexplained[HADA_SAMPLE_RESPONSES][2][HADA_SAMPLE_MOST]; /* exposures alike, and apart */
} hada_sample;

/* Of options, pairs and counts, which are set; takes the pairs in the responses tried. */
hada_status hada_sample_begin(hada_sample *sample, hada_error *err);
void hada_sample_end(hada_sample *sample);

/* Scenes are taken in the response of the options, or in a few where that is open. */
void hada_sample_try_responses(hada_sample *sample);

/* Up to HADA_SAMPLE_EACH pairs, evenly spread, of the depths that are looked at; or one, with its number. */
hada_status hada_sample_take(hada_sample *sample, hada_error *err);
hada_status hada_sample_take_pair(hada_sample *sample, int depth, int pair, hada_error *err);
void hada_sample_forget(hada_sample *sample);

/* Term k of smooth light (hada_smooth_term()) at a place of a reduced frame. */
double hada_sample_term(const hada_sample *sample, int k, int row, int col);

/* What is unexplained of each pair, by response, exposures alike and apart. */
void hada_sample_compare(hada_sample *sample);

/* The geometric mean: shares of one response differ by ten from pair to pair, and their mean is that of the worst. */
double hada_sample_mean(const double *shares, int count);

/* Whether so much less is left (a logarithm of each pair), by two standard errors of the mean. */
int hada_sample_is_better(const double *less, int count, double by);

#endif
