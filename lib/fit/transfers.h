/* Transfer functions of all depths where the sensor crops, and those that the trial of refinement needs, which never
 * saw its pairs. Internal. */
#ifndef HADA_FIT_TRANSFERS_H
#define HADA_FIT_TRANSFERS_H

#include "fit/fit_sums.h"
#include "fit/trial.h"

/* In the place of what sums give. */
typedef struct hada_fit_transfers {
    float *otf;    /* as in a model; NULL: those of the sums serve */
    double *noise; /* [depth][channel]: |N|^2 of what is left of a frame */
} hada_fit_transfers;

/* Learns those of all depths in so many passes over their pairs (cropped.h), and those of each kept pair's depth
 * without it, into kept. Pairs stay on the device where there is room, else they are read in every pass. */
hada_status hada_fit_transfers_learn(hada_fit_transfers *out, hada_fit_sums *sums, hada_fit_reader *from,
                                     hada_fit_kept *kept, int passes, hada_error *err);
void hada_fit_transfers_free(hada_fit_transfers *transfers);

/* For a single depth: the sum of squares that is left of the frames of `held`, whose pairs are not in the sums. */
hada_status hada_fit_transfers_left(hada_fit_sums *sums, hada_fit_reader *from, int passes, hada_fit_reader *held,
                                    double *left, hada_error *err);

#endif
