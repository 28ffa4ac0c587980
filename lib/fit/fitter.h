/* The inside of a fitter, and the steps of hada_fitter_finish(). Internal. */
#ifndef HADA_FIT_FITTER_H
#define HADA_FIT_FITTER_H

#include <hadalens/survey.h>

#include "fit/cropped.h"
#include "fit/fit_sums.h"
#include "fit/leave_one_out.h"
#include "fit/trial.h"
#include "fit/window.h"
#include "image/colour_matrix.h"

/* What was compared, and the lists of it for callers. */
typedef struct hada_fit_rows {
    hada_fit_filter_score filter[HADA_FIT_SETTINGS];
    hada_fit_outside_score outside[HADA_FIT_OUTSIDES];
    hada_fit_refine_score refinement[HADA_FIT_TRIAL_ROWS];
    int filters, outsides, refinements;
    const hada_fit_filter_score *filter_list[HADA_FIT_SETTINGS + 1];
    const hada_fit_outside_score *outside_list[HADA_FIT_OUTSIDES + 1];
    const hada_fit_refine_score *refinement_list[HADA_FIT_TRIAL_ROWS + 1];
} hada_fit_rows;

/* The lists of rows, as they are now. */
hada_fit_scores hada_fit_rows_list(hada_fit_rows *rows);

struct hada_fitter {
    hada_fit_options options; /* distances_mm, sums and communicator are the caller's and not read any more */
    hada_fit_grid grid;
    hada_fit_pair pair; /* that is being added or looked at */
    hada_fit_sums sums;
    int reduced;  /* the sums are those of all ranks */
    int weighted; /* frames that were scored have values that say nothing, or are saturated */
    /* what the last finish has chosen on pairs held out */
    hada_leave_one_out scores;
    hada_fit_kept kept;
    hada_fit_outside outside;
    hada_fit_transfers transfers;
    hada_fit_rows rows;
    /* for callers */
    hada_fit_scores list;
    int64_t *pairs;
    hada_fitter_info info;
};

/* Adds one pair to the sums of a depth. */
hada_status hada_fitter_add_pair(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                                 hada_error *err);

/* A file for a rank's sums, which are saved while pairs are added. */
typedef struct hada_fit_part {
    const char *path; /* NULL: none */
    double seconds;   /* between two saves, at least */
    int resume;       /* 1: pairs that the file holds are not added again */
} hada_fit_part;
hada_status hada_fitter_add_part(hada_fitter *fitter, const hada_dataset *pairs, const hada_fit_part *part,
                                 hada_error *err);

/* Among ranks, once each has added its pairs: the sums of all. */
hada_status hada_fitter_reduce(hada_fitter *fitter, hada_error *err);

/* The steps of hada_fitter_finish(): forget what the last one chose; leave-one-out of a pair, which the trial may keep,
 * and of a few pairs of each depth; transfer functions with the crop; filters judged in the window; a model. */
void hada_fit_forget(hada_fitter *fitter);
hada_status hada_fit_score_pair(hada_fitter *fitter, int depth, int number, const hada_image *raw,
                                const hada_image *scene, const hada_image *weights, hada_error *err);
hada_status hada_fit_learn_cropped(hada_fitter *fitter, const hada_dataset *pairs, hada_error *err);
hada_status hada_fit_learn_windowed(hada_fitter *fitter, const hada_dataset *pairs, hada_error *err);
hada_status hada_fit_solve(hada_fitter *fitter, hada_model **out, hada_error *err);

/* Solves filters, transfer functions, noise and scene power of every depth. filters: as in a model, instead of the
 * exact fit's; NULL: these. learned: transfer functions and noise instead of those of the sums, where it has them.
 * nonnegative: NULL for transfer functions from the pairs alone. Makes the pools. */
hada_status hada_fit_model_make(hada_model **out, hada_fit_sums *sums, hada_fit_setting setting, const float *filters,
                                const hada_fit_transfers *learned, hada_nonnegative *nonnegative, hada_error *err);

/* HADA_ERROR_DATASET where all frames or all scenes of a depth are constant images. Reads one pair of a depth, and more
 * of those where it is constant. */
hada_status hada_fit_check_content(const hada_dataset *pairs, hada_error *err);

/* Depths, distances and sizes of a data set (of its first pair; the others are checked when they are read), into
 * options. A window that options give is cut from scenes that are as large as the frame. */
hada_status hada_fit_sizes_from(hada_fit_options *options, const hada_dataset *pairs, hada_error *err);
/* Pixels of the sensor that lie beyond those around them in most frames: hot, dead and stuck ones, *found in all,
 * values of all channels counted. *flat: the flat frame of the pairs with 0 there, created by the call; empty where
 * none is found. sizes: hada_fit_sizes_from(). */
hada_status hada_fit_find_bad_pixels(const hada_fit_options *sizes, const hada_dataset *pairs, hada_image *flat,
                                     size_t *found, hada_error *err);
/* Where options->find_dark asks for it, and the pairs have no dark frame: the dark level with which they leave least of
 * held-out frames, into options->dark, where they have one. Or, unless NULL, light that is in all frames, a smooth
 * surface of their channels and size, which is created; or whether each frame has light of its own
 * (hada_fit_find_own_light()), with exposures that are alike or differ. options->find_dark becomes whether a level or a
 * surface was found. */
typedef enum hada_own_light {
    HADA_OWN_LIGHT_NONE = 0,
    HADA_OWN_LIGHT_ALIKE = 1,
    HADA_OWN_LIGHT_APART = 2
} hada_own_light;
hada_status hada_fit_find_dark(hada_fit_options *options, const hada_dataset *pairs, hada_image *surface,
                               hada_own_light *own, hada_error *err);
/* The dark level of options more precisely, or light that all frames have beside it, a smooth surface of each channel,
 * which is created: of pairs of one exposure, with scenes of options->scene_response. */
hada_status hada_fit_refine_dark(hada_fit_options *options, const hada_dataset *pairs, hada_error *err);
hada_status hada_fit_find_common_light(const hada_fit_options *options, const hada_dataset *pairs, hada_image *light,
                                       hada_error *err);
/* The response with which pairs leave least of held-out frames, whether or not their exposures differ. *best becomes
 * its number, and stays as it is where there are too few pairs. lit: all frames may hold light beside their scenes'. */
hada_status hada_fit_find_response(const hada_fit_options *options, const hada_dataset *pairs, int lit,
                                   const double *responses, int count, int *best, hada_error *err);
/* Light that comes from no scene and differs from frame to frame, a smooth surface of each: [pair][channel]
 * [HADA_SMOOTH_TERMS], by hada_pair_number(), free(); NULL where a depth has fewer than three pairs. apart: frames may
 * differ in exposure as well. */
hada_status hada_fit_find_own_light(const hada_fit_options *fit, const hada_dataset *pairs, int apart, double **light,
                                    hada_error *err);
/* Whether frames, taken for linear, seem to be encoded so (hadalens/response.h): decoded, they are explained better. */
hada_status hada_fit_seem_encoded(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                  double encoding, int *seem, hada_error *err);
/* What is left of held-out frames with the response, if it is open, and the exposures that leave least, over the
 * variance of the frames of the depth that is looked at. */
hada_status hada_fit_left_share(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                double *share, hada_error *err);
/* Compares what a survey chose with other responses, and with exposures alike, as boundaries are compared: with the
 * crop in the model. Has the survey choose what is better. */
hada_status hada_fit_confirm_survey(hada_survey *survey, const hada_fit_options *fit, hada_exposure exposure,
                                    hada_context *context, const hada_dataset *pairs, hada_error *err);
/* Exposures of a depth's pairs, which a survey has, more precise. */
hada_status hada_fit_expose_depth(const hada_survey *survey, const hada_fit_options *fit, int depth,
                                  hada_context *context, const hada_dataset *pairs, hada_error *err);
/* Exposures of depths beside each other are not in the pairs: they become such that scenes are as bright at all depths,
 * for a pixel of the scene stands for the same angle at each. */
hada_status hada_fit_level_depths(const hada_survey *survey, const hada_fit_options *fit, hada_context *context,
                                  const hada_dataset *pairs, hada_error *err);
/* By what the channels of frames must be multiplied to have one white balance: [pair][channel], by hada_pair_number(),
 * free(); NULL where they have. The pairs are of one exposure, fit->scene_response and fit->colour_matrix are known. */
hada_status hada_fit_find_balance(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                  double **balance, hada_error *err);
/* What a sensor's channels see of the scenes' colours, of options->scene_response, by pairs of one exposure or, if
 * `exposed`, of nearly one: *found, whether frames are explained far better so; m as hada_fit_options.colour_matrix,
 * all 0 otherwise. */
hada_status hada_fit_find_colours(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                  int exposed, double m[HADA_COLOUR_MATRIX], int *found, hada_error *err);
/* Among ranks: what the first of them has found. */
hada_status hada_survey_agree(hada_survey *survey, const hada_communicator *ranks, const hada_dataset *pairs,
                              hada_error *err);
/* Makes a row the chosen one, with the exposures of another survey of the same pairs, which gets those that were there;
 * NULL: they are alike. */
void hada_survey_choose(hada_survey *survey, const hada_survey_row *row, hada_survey *exposures);
/* Leaves out pairs that contradict the others of their depth: at most a third, in depths with 4 to 32 pairs; and scenes
 * that were cut off at white. *out: the pairs that stay. (*left_out)[depth][pair]: a hada_left_out. Both are NULL where
 * all stay. options->monitor gets a note for each pair that contradicts the others. */
typedef enum hada_left_out { HADA_STAYS = 0, HADA_CONTRADICTS = 1, HADA_CUT_OFF = 2, HADA_FILLED = 3 } hada_left_out;
/* Values from this one on are at white: nearly the largest of the image. */
float hada_fit_white(const hada_image *image);

hada_status hada_fit_screen(hada_dataset **out, unsigned char ***left_out, const hada_dataset *pairs,
                            const hada_fit_options *options, hada_error *err);
/* Pairs that are HADA_FILLED become HADA_STAYS, or HADA_CONTRADICTS where the others of their depth are explained far
 * worse with them. response: of the scenes. */
hada_status hada_fit_judge_filled(const hada_dataset *pairs, unsigned char *const *leave,
                                  const hada_fit_options *options, double response, hada_error *err);
void hada_fit_left_out_free(unsigned char ***left_out, int depths);

#endif
