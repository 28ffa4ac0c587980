/* The inside of a fitter: the modules of a fit, composed. Internal. */
#ifndef HADA_FIT_FITTER_H
#define HADA_FIT_FITTER_H

#include "fit/fit_sums.h"
#include "fit/leave_one_out.h"
#include "fit/outside.h"
#include "fit/transfers.h"
#include "fit/trial.h"

struct hada_fitter {
    hada_fit_options options; /* distances_mm is the caller's and not read any more */
    hada_fit_grid grid;
    hada_fit_pair pair; /* on its way in */
    hada_fit_sums sums;
    /* what is chosen on pairs held out; new sums make it worthless */
    hada_leave_one_out scores;
    hada_fit_kept kept;
    hada_fit_outside outside;
    hada_fit_transfers transfers;
};

#endif
