/* The steps that a fit and a training begin with. Internal. */
#ifndef HADA_TASKS_FIT_STEPS_H
#define HADA_TASKS_FIT_STEPS_H

#include <hadalens/monitor.h>
#include <hadalens/survey.h>

#include "dataset/dataset.h"

/* Sizes, depths and boundary of a data set, into `fit`, as hada_fit_task has them; boundary: a hada_boundary, or 0 for
 * that of camera.json, else padded. fit->monitor becomes `monitor`, unless it has one. */
hada_status hada_fit_prepare(hada_fit_options *fit, const hada_dataset *data, int boundary, const hada_monitor *monitor,
                             hada_error *err);

/* What the sensor adds to frames: pairs without it, and what they lack; all NULL and empty where it is nothing. */
typedef struct hada_mended {
    hada_dataset *linear;        /* decoded */
    hada_dataset *sound, *above; /* without bad pixels; and without light that is in all frames */
    hada_image flat, dark;       /* of these */
    int no_level;                /* a dark level was looked for, and nothing found */
    hada_dataset *unlit;         /* without light of each frame's own */
    double *light;               /* that, as hada_fit_find_own_light() has it: exposures apart or not, */
    int apart;
    const hada_dataset *lit; /* of these pairs; not owned */
    hada_dataset *balanced;  /* of one white balance, */
    double *balance;         /* as hada_fit_find_balance() has it */
} hada_mended;
void hada_mended_free(hada_mended *mended);

/* Decodes frames of files that say nothing of their values, as `fit` says (frame_encoding); HADA_AUTO: where they are
 * explained far better so, with a note, and `fit` has what was found. *data: the pairs with linear frames. *encoded: 1
 * where they seem to be encoded and stay so. */
hada_status hada_fit_decode(hada_mended *mended, const hada_dataset **data, hada_context *context,
                            hada_fit_options *fit, const hada_communicator *ranks, int *encoded, hada_error *err);

/* The same, and finds bad pixels, and where `fit` asks for it the dark level or (`surfaces`) light that is in all
 * frames, with notes. *data: the pairs without these. */
hada_status hada_fit_mend(hada_mended *mended, const hada_dataset **data, hada_context *context, hada_fit_options *fit,
                          const hada_communicator *ranks, int surfaces, hada_error *err);

/* Finds the response of the scenes and what the sensor sees of their colours, for `fit`, and exposures; *even: the
 * pairs of one exposure. Light in frames, which `mended` has, becomes more precise once these are known. */
hada_status hada_fit_survey(hada_survey **out, hada_dataset **even, hada_mended *mended, hada_context *context,
                            const hada_dataset *data, hada_fit_options *fit, hada_exposure exposure,
                            const hada_communicator *ranks, const hada_monitor *monitor, hada_error *err);

/* The boundary, where neither the caller gave it nor camera.json says that it is circular, with a message that says
 * what was found; padded, a dark level that was found becomes more precise. */
hada_status hada_fit_choose_boundary(hada_fit_options *fit, hada_context *context, const hada_dataset *pairs, int given,
                                     hada_error *err);

/* Among ranks: what the first of them has found so far, as devices round differently. */
hada_status hada_fit_agree(hada_fit_options *fit, const hada_communicator *ranks, hada_error *err);

/* What a fit ends with: filters in half precision where `half` is 1; then the model is tried before it is called one:
 * its numbers are those that a file may hold, and a frame of its `pairs` (NULL: a point of light, by its filters alone)
 * is reconstructed and not black; context NULL: no frame is, as of point spread functions, which are looked at before
 * they become a model. HADA_ERROR_MODEL or HADA_ERROR_NUMERIC. */
hada_status hada_model_complete(hada_model **model, int half, hada_context *context, const hada_dataset *pairs,
                                hada_error *err);

#endif
