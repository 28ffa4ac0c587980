/* A few pairs of a depth, one channel of them, from which a camera is learned with the crop in the model before a fit,
 * on one grid or another, with what it leaves of held-out frames. Internal. */
#ifndef HADA_FIT_LOOK_H
#define HADA_FIT_LOOK_H

#include "core/callers.h"
#include "fit/fitter.h"

/* Pairs that are learned from at most, and those held out beside them; a depth needs as many as this. */
enum {
    HADA_LOOK_LEARNED = 8,
    HADA_LOOK_HELD = 2,
    HADA_LOOK_MOST = HADA_LOOK_LEARNED + HADA_LOOK_HELD,
    HADA_LOOK_LEAST = 2
};
/* Shares of a window beyond the sensor's edge that a grid may have. */
enum { HADA_OVERHANGS = 5 };

/* One channel of a few pairs of a depth, which are spread over all; the last ones are held out. */
typedef struct hada_look {
    hada_context *context;
    const hada_fit_options *options;
    int depth, first, count, held; /* first: the number of the pair that comes first */
    int channel;                   /* from 1 on; 0: the middle one */
    int smooth;  /* 1: what is left of a frame counts but for a smooth surface (hada_smooth_term()) and noise */
    int coarse;  /* 1: learned from coarse transfer functions on, so that light far beyond the sensor is found */
    int group;   /* above 0: so many pairs from `first` on, of which none is held out; at most HADA_LOOK_MOST */
    int centred; /* 1: pairs are taken less the mean of those that are learned from, so that light that all frames hold
                    does not count; scenes are linear then */
    hada_pair pair[HADA_LOOK_MOST];
    hada_image raw[HADA_LOOK_MOST], scene[HADA_LOOK_MOST]; /* their channels, not owned */
    hada_image weights[HADA_LOOK_MOST];                    /* the same; empty: all are 1 */
    hada_dataset *learned, *held_out, *mean;               /* mean: that pair, where they are centred */
    hada_image own_raw[HADA_LOOK_MOST + 1], own_scene[HADA_LOOK_MOST + 1], known; /* where they are; the mean last */
} hada_look;

/* Takes the pairs of at->depth, spread over all from at->first on. */
hada_status hada_look_take(hada_look *at, const hada_dataset *pairs, hada_error *err);
void hada_look_return(hada_look *at);

/* What is left of the frames held out, learned on a grid of rows x cols; 0: of the size that holds all light. */
hada_status hada_look_left(const hada_look *at, int rows, int cols, double *left, hada_error *err);
/* The same of each frame of other pairs, of one channel and depth; light: |H(0)|; rest: predictions less frames, all
 * pixels of these frames. Either may be NULL. */
hada_status hada_look_explain(const hada_look *at, int rows, int cols, const hada_dataset *others, double *left,
                              double *light, float *rest, hada_error *err);
/* What the scenes that were learned from make of their frames, [pair][row][col]; frame[pair], not owned, and
 * dark[pair]: the channel of each as it was taken, and its dark level. */
hada_status hada_look_predict(const hada_look *at, float *made, hada_image *frame, double *dark, hada_error *err);
/* Whether light that all frames hold was found and taken off, though not exactly. A look becomes one to which what is
 * left of it makes no difference: centred, or, where the pairs have few of that depth, smooth. */
int hada_look_is_lit(const hada_fit_options *options, const hada_dataset *pairs);
void hada_look_ignore_light(hada_look *at, const hada_dataset *pairs, int depth);

/* A side of the grid with overhang number k; and both sides of the grid that holds all light, with options->boundary.
 */
int hada_look_side(int raw, int window, int k);
void hada_look_whole(const hada_fit_options *options, int *rows, int *cols);

/* The first depth of which a pair can be held out; the number of depths if there is none. */
int hada_look_depth(const hada_fit_options *options, const hada_dataset *pairs);

#endif
