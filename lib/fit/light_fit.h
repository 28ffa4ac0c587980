/* Transfer functions of a few pairs and light beside that of their scenes, which follow from each other by least
 * squares with the crop in the model, on a small grid. Internal. */
#ifndef HADA_FIT_LIGHT_FIT_H
#define HADA_FIT_LIGHT_FIT_H

#include "fit/sample.h"

/* What frames hold beside their scenes' light: nothing; a level; a smooth surface (hada_smooth_term()), the same in all
 * or one in each. */
typedef enum hada_light_kind {
    HADA_LIGHT_NONE = 0,
    HADA_LIGHT_LEVEL = 1,
    HADA_LIGHT_SURFACE = 2,
    HADA_LIGHT_OWN = 3
} hada_light_kind;
enum { HADA_LIGHT_KINDS = 4 };

/* What is assumed: the number of a response, light, and whether exposures of frames are found as well. */
typedef struct hada_light_guess {
    int response, apart;
    hada_light_kind kind;
} hada_light_guess;

typedef struct hada_light_fit hada_light_fit;

/* For the pairs that the sample has now, which it shall keep; those of a depth one after the other. crops: 1: light may
 * leave the sensor, which few pairs do not settle. */
hada_status hada_light_fit_create(hada_light_fit **out, const hada_sample *sample, int crops, hada_error *err);
void hada_light_fit_destroy(hada_light_fit **fit);

/* What is left of a frame: its energy, and that of the means of squares of pixels, for detail says nothing of smooth
 * light and is not settled by few pairs. */
typedef struct hada_light_left {
    double whole, coarse;
} hada_light_left;

/* Learns a channel of all pairs but those that held_out (NULL: none) names. left[pair]: its own light and exposure are
 * taken off where a guess has these; weight[HADA_SMOOTH_TERMS]: light of all frames. Either may be NULL. */
void hada_light_fit_run(hada_light_fit *fit, int channel, hada_light_guess guess, const unsigned char *held_out,
                        hada_light_left *left, double *weight);

#endif
