/* The passes of a fit over the pairs of a data set. Internal. */
#ifndef HADA_TASKS_FIT_PASSES_H
#define HADA_TASKS_FIT_PASSES_H

#include <hadalens/dataset.h>
#include <hadalens/fit.h>
#include <hadalens/monitor.h>
#include <hadalens/survey.h>

#include "tasks/fit_store.h"

/* Where pairs come from. */
typedef struct hada_fit_source {
    const hada_dataset *data;
    const hada_survey *survey; /* evens scenes out where frames were exposed differently; NULL: they were not */
    hada_fit_store *store;     /* for pairs that several passes ask for; NULL: they are read each time */
    const hada_monitor *monitor;
    const hada_communicator *communicator; /* ranks that share the pairs of the sums; NULL: none do */
    const char *part;                      /* file for this rank's sums on the way; NULL: none */
    double part_seconds;                   /* between two saves of it, at least */
    int resume;                            /* 1: from what it holds */
} hada_fit_source;

/* Before all passes: what the pairs say of themselves; where pairs disagree in exposure, a note tells. */
hada_status hada_fit_pass_survey(hada_survey **out, const hada_fit_source *from, const hada_fit_options *fit,
                                 hada_exposure exposure, hada_error *err);

/* Whether light leaves the sensor, and on which grid to fit (hada_fit_find_boundary()); a note says what was found. */
hada_status hada_fit_pass_boundary(hada_fit_options *fit, hada_context *context, const hada_fit_source *from,
                                   hada_error *err);

/* Among ranks: what the first of them has found out so far, for devices round differently. */
hada_status hada_fit_pass_agree(hada_fit_options *fit, const hada_communicator *ranks, hada_error *err);

/* First pass: all pairs into the sums, each by one rank, and the sums of all ranks to each. */
hada_status hada_fit_pass_add(hada_fitter *fitter, const hada_fit_source *from, hada_error *err);

/* Second pass: as many pairs as the fitter scores, evenly spread over each depth. */
hada_status hada_fit_pass_score(hada_fitter *fitter, const hada_fit_source *from, hada_error *err);

/* Further passes: transfer functions with the crop in the model (hada_fitter_learn_cropped()). */
hada_status hada_fit_pass_learn_cropped(hada_fitter *fitter, const hada_fit_source *from, hada_error *err);

/* Chooses and solves, with filters judged in the window where that serves (hada_fitter_learn_and_finish()). */
hada_status hada_fit_pass_learn_and_finish(hada_fitter *fitter, const hada_fit_source *from, hada_model **out,
                                           hada_fit_scores **scores, hada_error *err);

/* The exact fit with all that is left open chosen, but for filters judged in the window. */
hada_status hada_fit_exact(hada_model **out, hada_context *context, const hada_fit_options *fit,
                           const hada_fit_source *from, hada_error *err);

/* The model's filters in half precision, in its place. */
hada_status hada_model_make_half(hada_model **model, hada_error *err);

#endif
