/* Constants and structs of a fit, for kernels and host. */
#ifndef SHARED_FIT_H
#define SHARED_FIT_H

#include "shared_types.h"

enum {
    HADA_FIT_SUMS = 4,        /* per frequency; inc_fit.h lists them */
    HADA_FIT_SUMS_SPLIT = 6,  /* the same of the form split */
    HADA_FIT_POOLS = 3,       /* pooled over depths; fit_sums.cl lists them */
    HADA_FIT_POOLS_SPLIT = 5, /* the same of the form split */
    HADA_FIT_SCENE_POOL = 2,  /* which of them is |X|^2 per pair */
    HADA_FIT_VECTOR = 8,      /* frequencies that a step takes */
    HADA_FIT_CHUNK = 32,  /* vectors in a partial sum: few enough for a float's digits, many enough to read in a row */
    HADA_FIT_GROUP = 128, /* work-items of a group where one takes a vector of a chunk */
    HADA_FIT_TRIALS = 5   /* settings that are tried at once, which share what is read */
};

/* The image of a channel among the spectra, and the layout of its sums. */
typedef struct hada_fit_image {
    hada_ulong first;   /* complex numbers before it */
    hada_ulong count;   /* of complex numbers; what follows belongs to the next image */
    hada_ulong vectors; /* that hold them */
    hada_ulong stride;  /* floats from one array of sums to the next: whole vectors */
    hada_ulong chunks;  /* partial sums over the image */
    hada_ulong partial; /* numbers before them */
} hada_fit_image;
HADA_SHARED_SIZE(hada_fit_image, 48)

/* The terms added to a filter's denominator: alpha times the other depths' |B|^2, and the ridge. */
typedef struct hada_fit_penalty {
    float alpha, ridge;
} hada_fit_penalty;
HADA_SHARED_SIZE(hada_fit_penalty, 8)

/* Penalties to try on a pair held out, and how the light of the other depths is scaled: by the pairs of this depth, and
 * by the number of the others. */
typedef struct hada_fit_trials {
    hada_fit_penalty penalty[HADA_FIT_TRIALS];
    float per_pair, per_other;
} hada_fit_trials;
HADA_SHARED_SIZE(hada_fit_trials, 48)

/* Scale of the pairs' sums, and weight of the guess. */
typedef struct hada_fit_blend_rule {
    float scale, weight;
} hada_fit_blend_rule;
HADA_SHARED_SIZE(hada_fit_blend_rule, 8)

/* A step of the non-negative image: relaxation, and the last weight over the next one, by which its dual is scaled. */
typedef struct hada_fit_clip_rule {
    float relaxation, dual_scale;
    int start; /* the first step: nothing was kept yet */
    int last;  /* what goes out is the image itself, not the next guess */
} hada_fit_clip_rule;
HADA_SHARED_SIZE(hada_fit_clip_rule, 16)

#endif
