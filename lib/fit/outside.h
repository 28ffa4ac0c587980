/* The weight of what filters make outside the window: chosen by cross-validation, and the filters that come of it.
 * Internal. */
#ifndef HADA_FIT_OUTSIDE_H
#define HADA_FIT_OUTSIDE_H

#include "fit/fit_sums.h"

/* Weights that are compared; the last is 1, the exact fit. */
enum { HADA_FIT_OUTSIDES = 6 };

/* The least weight that may be given: iterations would not converge below it. */
#define HADA_FIT_LEAST_OUTSIDE 0.01

/* Filters in the place of the exact fit's, and what was compared. */
typedef struct hada_fit_outside {
    float *filters; /* as in a model; NULL: the exact fit's serve */
    int count;      /* weights that were compared; 0: none */
    int chosen;
    double weight[HADA_FIT_OUTSIDES], psnr[HADA_FIT_OUTSIDES];
} hada_fit_outside;

/* Solves filters of all depths with a weight, < 0: chosen by leaving pairs out. Where that is 1, or nothing can be left
 * out, *out is empty and the exact fit stays. `from` reads the pairs of the sums. Makes the pools. */
hada_status hada_fit_outside_solve(hada_fit_outside *out, hada_fit_sums *sums, hada_fit_reader *from,
                                   hada_fit_setting setting, double weight, hada_error *err);
void hada_fit_outside_free(hada_fit_outside *outside);

/* Decibels by which the chosen weight was better than the exact fit; 0 where nothing was compared. */
double hada_fit_outside_gain(const hada_fit_outside *outside);

#endif
