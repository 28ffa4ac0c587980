/* Hadalens: learning a camera from pairs (raw frame, known scene), exactly, in one pass.
 *
 * With a squared error each frequency is its own least-squares problem, so a filter needs only sums over the pairs of
 * a depth: Sxb = sum X conj(B), Sbb = sum |B|^2, Sxx = sum |X|^2 (docs/explanation/learning-a-camera.md). The sums are
 * streamed: memory does not grow with the number of pairs. They can be saved, loaded, added to, and merged. A second
 * pass over some pairs chooses alpha and lambda, and whether refinement pays, by leave-one-out. Further passes judge
 * filters in the window alone.
 *
 * Threads: one fitter is used by one thread at a time. */
#ifndef HADALENS_FIT_H
#define HADALENS_FIT_H

#include <hadalens/communicator.h>
#include <hadalens/device.h>
#include <hadalens/image.h>
#include <hadalens/model.h>
#include <hadalens/monitor.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_fitter hada_fitter;

typedef struct hada_fit_options {
    size_t size; /* sizeof(hada_fit_options) */
    int depths, channels;
    const double *distances_mm; /* near to far */
    int raw_rows, raw_cols, window_rows, window_cols;
    hada_boundary boundary; /* HADA_BOUNDARY_CIRCULAR by default */
    hada_form form;         /* HADA_FORM_COMPLEX (default) or HADA_FORM_SPLIT */
    double dark;            /* taken off the raw frames; HADA_AUTO: estimated for each frame and channel, as its first
                               percentile */
    double alpha, lambda;   /* HADA_AUTO (default): chosen by leave-one-out */
    double outside;         /* weight of a filter's error outside the window, 0.01 to 1; HADA_AUTO (default): chosen by
                               hada_fitter_learn_windowed(), without which it is 1 */
    int refine_steps;       /* HADA_AUTO (default): chosen by leave-one-out; 0: none */
    double refine_tv;       /* weight of total variation in refinement; HADA_AUTO (default): chosen with the steps, none
                               where these are given; 0: none */
    int nonnegative;        /* 1 (default): transfer functions are those of point spread functions that are nowhere
                               negative, as light's are, where the pairs say too little; 0: from the pairs alone */
    double scene_response;  /* how the scenes are encoded (hadalens/response.h): they are brought to linear light before
                               anything is learned. HADA_AUTO (default): chosen by hada_fit_run(); saved sums say it
                               themselves; a fitter that is given none takes them as linear */
    int crop_passes;      /* iterations of hada_fitter_learn_cropped(), at least 3; HADA_AUTO (default): 15; 0: none */
    double refine_colour; /* in total variation, weight of differences of colour over those of brightness, 1 to 16;
                             HADA_AUTO (default): chosen with the weight, 1.5 where that is given */
    int grid_rows, grid_cols; /* boundary padded: the grid, at least the frame's size; 0 (default): large enough for all
                                 light that a scene can send onto the sensor (hada_fit_find_boundary()) */
    double refine_shrink; /* with total variation, for a single depth: threshold of the shrinkage of blocks, in units of
                             its weight, 0 to 100; HADA_AUTO (default): chosen with the weight, 1.6 where that is given;
                             0: none */
    const hada_monitor *monitor; /* asked several times a second whether to stop, while a fitter learns or finishes and
                                    while the boundary is looked for (then HADA_ERROR_CANCELLED; sums, scores and what
                                    was learned before stay). It must last as long as the fitter. NULL (default):
                                    nobody; in hada_fit_run() the task's */
    const hada_communicator *communicator; /* ranks that share the fit, each with a fitter of its own; copied; NULL
                                              (default): none do */
} hada_fit_options;
HADA_INIT(hada_fit_options, HADA_STRUCT_FIT_OPTIONS)

/* A model of zero filters with the sizes, distances, form, boundary and dark level of `sizes`: something to begin
 * training from at random (hadalens/train.h). */
HADA_API hada_status hada_model_blank(hada_model **out, const hada_fit_options *sizes, hada_error *err);

/* The same with filters, and with transfer functions where `otf` is not NULL, copied from arrays as
 * hada_model_get_filters() and hada_model_get_otf() have them: cameras that others have learned. NaN and infinite
 * values are HADA_ERROR_NOT_FINITE. */
HADA_API hada_status hada_model_from_filters(hada_model **out, const hada_fit_options *sizes, const float *filters,
                                             const float *otf, hada_error *err);

/* Gives a pair of a depth (0 <= pair < the depth's number of pairs) by pointers that last until the next call. */
typedef hada_status (*hada_fit_show)(void *user, int depth, int64_t pair, const hada_image **raw,
                                     const hada_image **scene, hada_error *err);

/* Whether light leaves the sensor, from pairs: sets options->boundary, and for HADA_BOUNDARY_PADDED the smallest grid
 * that serves. counts: the number of pairs of each depth. Of the first and the last depth a few pairs and one channel
 * are learned from with all light allowed, and where folding it back onto a smaller grid explains held-out frames as
 * well, that grid serves (docs/explanation/learning-a-camera.md). Where no depth has a pair to hold out, padded, with
 * its default grid. */
HADA_API hada_status hada_fit_find_boundary(hada_fit_options *options, hada_context *context, const int *counts,
                                            hada_fit_show show, void *user, hada_error *err);

HADA_API hada_status hada_fitter_create(hada_fitter **out, hada_context *context, const hada_fit_options *options,
                                        hada_error *err);
HADA_API void hada_fitter_destroy(hada_fitter **fitter);

/* Bytes of device memory that a fitter holds, whatever the number of pairs: more from the first score on, and
 * hada_fitter_finish() takes room for transfer functions and for the trial of refinement while it runs. */
HADA_API uint64_t hada_fitter_bytes(const hada_fitter *fitter);

/* First pass: adds a pair to the sums of a depth. `scene` has the window's size (or the raw frame's, then its centre is
 * used). Non-finite values are refused (HADA_ERROR_NOT_FINITE), as are values whose squares leave single precision
 * (HADA_ERROR_NUMERIC, tests/stress/bounds.md); the sums are then as they were. */
HADA_API hada_status hada_fitter_add(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                                     hada_error *err);

/* Sums to and from a file (safetensors); loading adds to what is there, so files from several machines merge. */
HADA_API hada_status hada_fitter_save_sums(hada_fitter *fitter, const char *path, hada_error *err);
HADA_API hada_status hada_fitter_load_sums(hada_fitter *fitter, const char *path, hada_error *err);

/* A fitter from saved sums alone, for merging without pairs: camera, depths and dark level are the file's; `choices`
 * says form, alpha, lambda, refine_steps, refine_tv, refine_colour and nonnegative (its other fields are not used);
 * NULL: the defaults. */
HADA_API hada_status hada_fitter_create_from_sums(hada_fitter **out, hada_context *context, const char *path,
                                                  const hada_fit_options *choices, hada_error *err);

/* Among ranks (options.communicator), once each has added pairs of its own: their sums become those of all ranks, on
 * every rank, added in rank order. Where a depth's pairs are all of one rank, with the bits of that one. All ranks call
 * it, once; hada_fitter_score() and what follows then take the same pairs on all ranks, in the same order, and share
 * the work. For a fitter alone it does nothing. */
HADA_API hada_status hada_fitter_reduce(hada_fitter *fitter, hada_error *err);

/* Number of pairs in the sums of a depth. */
HADA_API int64_t hada_fitter_pairs(const hada_fitter *fitter, int depth);

/* Second pass, optional: gives a pair that is among the sums again; its leave-one-out errors are added to the score
 * table. Without any, alpha and lambda fall back to 0 and 1e-4. A few pairs decide, so further ones (beyond 8 in all
 * and 2 of a depth) are checked and passed over; new pairs in the sums discard the scores so far. */
HADA_API hada_status hada_fitter_score(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                                       hada_error *err);

/* Further passes, optional, for the boundary padded: transfer functions of a sensor that crops its scenes' light. What
 * leaves the sensor is missing in the sums, so that transfer functions of one pass are off by up to a tenth there; with
 * the crop in the model they are not (docs/explanation/learning-a-camera.md). Every pair of the sums is shown once
 * where all pairs of a depth find room on the device (a quarter of its memory at most), else options.crop_passes times,
 * and again where the trial of refinement needs them left out. Noise is what this model leaves. Call it after scoring,
 * before hada_fitter_finish(); new pairs discard what was found. Pairs that are not those of the sums are refused
 * (HADA_ERROR_STATE). With another boundary, with nonnegative or crop_passes 0, nothing is shown and the transfer
 * functions of the sums stay. While it runs it takes the room of about ten frames' spectra, beside the pairs. */
HADA_API hada_status hada_fitter_learn_cropped(hada_fitter *fitter, hada_fit_show show, void *user, hada_error *err);

/* Further passes, optional: filters that are judged in the window. The exact fit of the first pass minds the whole
 * grid, although only the window of what a filter makes is kept; here what it makes outside counts with the weight
 * options.outside alone (docs/explanation/learning-a-camera.md). Every pair of the sums is shown up to 12 times, and
 * some more often to choose the weight (where options.outside is HADA_AUTO) by leaving pairs out. Transfer functions,
 * and so refined images, stay as they are. Call it after scoring, before hada_fitter_finish(); new pairs and scores
 * discard what was found. Pairs that are not those of the sums are refused (HADA_ERROR_STATE): sums from files cannot
 * be judged without their pairs. With options.outside = 1, or where nothing can be left out, no pair is shown and the
 * exact fit stays. While it runs it takes as much room on the device as 14 frames' spectra (6 with options.outside
 * given). */
HADA_API hada_status hada_fitter_learn_windowed(hada_fitter *fitter, hada_fit_show show, void *user, hada_error *err);

/* What was compared to choose what the options leave open, and how it did: PSNR is the mean in the window of held-out
 * pairs (dB, peak 1), and of each kind at most one is `chosen`: what the model takes. */
typedef struct hada_fit_scores hada_fit_scores;

/* Alpha and lambda of filters, by leave-one-out. */
typedef struct hada_fit_filter_score {
    double alpha, lambda;
    double psnr_single; /* only the pair's depth is occupied */
    double psnr_double; /* one other depth is occupied as well, whose light is counted over the whole frame: a lower
                           bound. NaN for one depth */
    int chosen;
} hada_fit_filter_score;

/* Weights of the error outside the window. */
typedef struct hada_fit_outside_score {
    double outside;
    double psnr; /* of the mean squared error of all pairs */
    int chosen;
} hada_fit_outside_score;

/* Refinement: first with numbers of steps, of which the first is none (linear filters), then weights of total variation
 * that were compared, never marked, for one depth. NaN where there was no such pair. */
typedef struct hada_fit_refine_score {
    int steps;
    double rho, tv;
    double psnr_single, psnr_double; /* of frames of one pair, and of the sum of two */
    int chosen;
} hada_fit_refine_score;

/* The score number `index` of a kind, from 0 on; NULL behind the last one. Owned by the scores, which may be NULL.
 * Later versions may add members at the end. */
HADA_API const hada_fit_filter_score *hada_fit_scores_filter(const hada_fit_scores *scores, size_t index);
HADA_API const hada_fit_outside_score *hada_fit_scores_outside(const hada_fit_scores *scores, size_t index);
HADA_API const hada_fit_refine_score *hada_fit_scores_refinement(const hada_fit_scores *scores, size_t index);
HADA_API void hada_fit_scores_destroy(hada_fit_scores **scores);

/* Chooses, solves W and H, and makes the model. *scores (may be left out, NULL) are for the caller to destroy. */
HADA_API hada_status hada_fitter_finish(hada_fitter *fitter, hada_model **out, hada_fit_scores **scores,
                                        hada_error *err);

/* The same with hada_fitter_learn_cropped() before it, unless that was called, and hada_fitter_learn_windowed(), where
 * that serves: where options.outside is given, or the linear filters are what the model will use. Judging gains a
 * decibel or two and takes most of the time of a fit, so where refinement, which does without the filters, is found to
 * lead by more than that, it is left out. */
HADA_API hada_status hada_fitter_learn_and_finish(hada_fitter *fitter, hada_fit_show show, void *user, hada_model **out,
                                                  hada_fit_scores **scores, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
