/* A prior's weight, found from a frame alone: a part of its values is left out of the data, planes are made with one
 * weight after the other, from large to small, each going on from those before, and the weight whose planes predict
 * the values that were left out best is taken (cross-validation: G. Golub, M. Heath, G. Wahba, Technometrics 21(2),
 * 1979; of pixels). docs/explanation/refinement.md has the figures. Internal. */
#ifndef HADA_PLANES_WEIGHT_SEARCH_H
#define HADA_PLANES_WEIGHT_SEARCH_H

#include "planes/maker.h"

/* Which of `count` blocks of a frame's values are left out: 1; the others, about 95 %, stay: 0. The same for all frames
 * of a size. */
void hada_hold_out_blocks(unsigned char *blocks, size_t count);

typedef struct hada_weight_search {
    /* Planes with this weight, from those of the call before (*steps is 0: from nothing). Adds the steps that it took
     * to *steps; *left: the energy that they leave of the values that were left out. */
    hada_status (*solve)(void *user, double weight, int *steps, double *left, hada_error *err);
    void *user;
    int most_steps; /* no other weight is tried after so many; 0: any number */
    double least;   /* the sweep ends with a weight that predicts better by less than this share; 0: it goes on */
    double factor;  /* times the weight that predicts best is taken */
    double doubt;   /* where planes leave more than twice the noise, the rest being errors of the optics, predictions
                       that are worse by this share of it are as good; 0: they are not */
    double usual;   /* this times r^(2/3) is the usual weight, r being the share of its energy that planes leave of the
                       frame, no more than four times the noise; 0: there is none */
    double trust;   /* the weight is a geometric mean of the usual one and of that which predicts best, but not less
                       than a third of the usual one; this is the exponent of the latter, 1 if all is error */
} hada_weight_search;

/* Weights are in units of the frame's root mean square. */
hada_status hada_weight_find(const hada_weight_search *search, const hada_frame_exposure *exposure,
                             hada_maker_choice *choice, hada_error *err);

#endif
