/* Hadalens: learning a camera from pairs (raw frame, known scene).
 *
 * With a squared error each frequency is a least-squares problem of its own, so a filter needs only sums over the pairs
 * of a depth: Sxb = sum X conj(B), Sbb = sum |B|^2, Sxx = sum |X|^2 (docs/explanation/learning-a-camera.md).
 * hada_fitter_add() streams pairs into the sums, so memory does not grow with their number; sums can be saved, loaded
 * and merged. hada_fitter_finish() makes a model of them. Where it is given the pairs again, it leaves some of them out
 * to choose what the options leave open, and learns what sums alone do not tell.
 *
 * Threads: one fitter is used by one thread at a time. */
#ifndef HADALENS_FIT_H
#define HADALENS_FIT_H

#include <hadalens/communicator.h>
#include <hadalens/dataset.h>
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
    double dark; /* taken off the raw frames, not negative; HADA_AUTO: each frame's and channel's own, the first
                    percentile of means of up to 16 pixels */
    double alpha, lambda;  /* HADA_AUTO (default): chosen by leave-one-out */
    double outside;        /* weight of a filter's error outside the window, 0.01 to 1, for hada_fitter_finish() with
                              all pairs; HADA_AUTO (default): chosen there by leaving pairs out; 1: the exact fit */
    int refine_steps;      /* HADA_AUTO (default): chosen by leave-one-out; 0: none */
    double refine_tv;      /* weight of total variation in refinement; HADA_AUTO (default): chosen with the steps, none
                              where these are given; 0: none */
    int nonnegative;       /* 1 (default): transfer functions are those of point spread functions that are nowhere
                              negative, as light's are, where the pairs say too little; 0: from the pairs alone */
    double scene_response; /* how the scenes are encoded (hadalens/response.h): they are brought to linear light before
                              anything is learned. HADA_AUTO (default): chosen by hada_fit_run(); saved sums say it
                              themselves; a fitter that is given none takes them as linear */
    int crop_passes; /* boundary padded: iterations that learn transfer functions with the crop of the sensor in the
                        model, in hada_fitter_finish() with all pairs; at least 3; HADA_AUTO (default): 15; 0: none.
                        With a mosaic, whatever the boundary, and 45 by default */
    double refine_colour;     /* in total variation, weight of differences of colour over those of brightness, 1 to 16;
                                 HADA_AUTO (default): chosen with the weight, 1.5 where that is given */
    int grid_rows, grid_cols; /* boundary padded: the grid, at least the frame's size; 0 (default): large enough for all
                                 light that a scene can send onto the sensor (hada_fit_find_boundary()) */
    double refine_ridge;      /* with total variation: strength of the learned regulariser in the last steps, 0 to 100;
                                 HADA_AUTO (default): chosen with the weight, 1 where that is given; 0: none */
    const hada_monitor *monitor;           /* told of progress, and asked several times a second whether to stop (then
                                              HADA_ERROR_CANCELLED; the sums stay). It must last as long as the fitter. NULL
                                              (default): none; in hada_fit_run() the task's */
    const hada_communicator *communicator; /* ranks that share the fit, each with a fitter of its own; copied; NULL
                                              (default): none do */
    int leave_one_out;  /* 1 (default): hada_fitter_finish() leaves pairs out to choose what is open; 0: alpha 0, lambda
                           1e-4, outside 1 and 12 steps of refinement are the defaults */
    const char *sums;   /* a file of saved sums to begin with: sizes, depths, distances, boundary and dark level are the
                           file's, and so is the response of the scenes where it is open. NULL (default): none */
    hada_mosaic mosaic; /* the frames' colours were filled in from a colour filter mosaic of this pattern
                           (hada_dataset_options): transfer functions are learned from the values that pixels hold, by
                           hada_fitter_finish() with all pairs, and the model knows the pattern. In hada_fit_run() that
                           of the data set. HADA_MOSAIC_NONE (default): pixels hold all channels */
    int downsample;     /* by which the data set bins pairs, for the model to do the same: in hada_fit_run() as */
    hada_mosaic sensor_mosaic; /* hada_dataset_info says; 1 and HADA_MOSAIC_NONE by default */
    int find_dark; /* 1 (default): where `dark` is 0, hada_fit_run() and hada_train_run() look in the pairs for a level
                      that all frames have in common */
    double
        colour_matrix[9]; /* three channels: the sensor's channel c sees colour_matrix[3 c + k] of what channel k of the
                             scenes makes, in linear light; frames are multiplied by its inverse. Rows have the sum 1:
                             brightness is in the transfer functions. All 0 (default): found by hada_fit_run() and
                             hada_train_run() where find_colours is 1, else the sensor sees the scenes' colours */
    int find_colours;     /* 1 by default */
    double frame_encoding; /* how the values of the raw frames' files stood for light, for the model, which takes those
                              of new frames for the same (hada_model_info). HADA_AUTO (default): in hada_fit_run() that
                              of the data set's options, or, of 8 or 16 bits and where nothing says it, sRGB if the
                              pairs are explained far better so: the frames are then decoded. Otherwise linear */
} hada_fit_options;
HADA_INIT(hada_fit_options, HADA_STRUCT_FIT_OPTIONS)

/* A model with the sizes, distances, form, boundary and dark level of `sizes`, and filters that are copied from an
 * array as hada_model_arrays has them: a camera that others have learned. otf: transfer functions, as
 * hada_model_arrays has them; NULL: none. filters NULL: all are zero, for a training that begins at random
 * (hadalens/train.h). NaN and infinite values are HADA_ERROR_NOT_FINITE. */
HADA_API hada_status hada_model_from_filters(hada_model **out, const hada_fit_options *sizes, const float *filters,
                                             const float *otf, hada_error *err);

/* Finds whether light leaves the sensor: sets options->boundary, and for HADA_BOUNDARY_PADDED the smallest grid that
 * suffices. The sizes of frames and scenes that `options` leaves 0 are those of the first pair; depths and distances
 * are those of the data set. A few pairs of the nearest depth and one channel are learned from with all light allowed;
 * a smaller grid suffices where it explains held-out frames as well (docs/explanation/learning-a-camera.md). Where no
 * depth has a pair to hold out: padded, with its default grid. options->distances_mm then points into the data set. */
HADA_API hada_status hada_fit_find_boundary(hada_fit_options *options, hada_context *context, const hada_dataset *pairs,
                                            hada_error *err);

HADA_API hada_status hada_fitter_create(hada_fitter **out, hada_context *context, const hada_fit_options *options,
                                        hada_error *err);
HADA_API void hada_fitter_destroy(hada_fitter **fitter);

/* Adds all pairs of a data set to the sums; its distances must be among the fitter's. Scenes have the window's size (or
 * the raw frame's, whose centre is used). Non-finite values are refused (HADA_ERROR_NOT_FINITE), as are values whose
 * squares leave single precision (HADA_ERROR_NUMERIC, tests/stress/bounds.md); the sums then have the pairs before.
 * Among ranks (options.communicator) each adds its share, and then all have the sums of all: ((rank 0 + rank 1) + ...),
 * with the bits of one rank where a depth's pairs are all of that rank. Afterwards such a fitter can be finished, and
 * nothing more can be added. */
HADA_API hada_status hada_fitter_add(hada_fitter *fitter, const hada_dataset *pairs, hada_error *err);

/* Sums to and from a file (safetensors); loading adds to those that are there, so files from several machines merge. */
HADA_API hada_status hada_fitter_save_sums(hada_fitter *fitter, const char *path, hada_error *err);
HADA_API hada_status hada_fitter_load_sums(hada_fitter *fitter, const char *path, hada_error *err);

/* What was compared to choose what the options leave open: PSNR is the mean in the window of held-out pairs (dB, peak
 * 1), and of each kind at most one is `chosen`, which the model has. */

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
    double psnr_single, psnr_double; /* of frames of one pair, and of the sum of two, in the scenes' encoding */
    int chosen;
} hada_fit_refine_score;

/* Lists of pointers, each ended by NULL. Later versions may add members to what they point to, at the end. */
typedef struct hada_fit_scores {
    const hada_fit_filter_score *const *filters;
    const hada_fit_outside_score *const *outsides;
    const hada_fit_refine_score *const *refinements;
} hada_fit_scores;

/* Makes a model of the sums. `pairs`, a data set with the depths of the fitter, tells what is learned beside the exact
 * fit; pair k of a depth is the k-th that was added to it:
 *   NULL              nothing
 *   some of the sums  alpha, lambda and refinement are chosen by leaving a few of them out (options.leave_one_out)
 *   all of the sums   that, and transfer functions with the crop of the sensor in the model (options.crop_passes,
 *                     docs/explanation/learning-a-camera.md), and filters that are judged in the window alone
 * (options.outside, docs/explanation/learning-a-camera.md) where these are used: where refinement, which does not use
 * the filters, leads by more than judging can gain, it is left out Pairs that are read several times stay in the data
 * set's cache; those of one depth stay on the device if they take at most a quarter of its memory. While it runs it
 * takes the room of up to 14 frames' spectra on the device. Pairs that are not those of the sums are refused
 * (HADA_ERROR_STATE). The sums stay; more pairs can be added. */
HADA_API hada_status hada_fitter_finish(hada_fitter *fitter, const hada_dataset *pairs, hada_model **out,
                                        hada_error *err);

/* Owned by the fitter, valid until the next call. */
typedef struct hada_fitter_info {
    int depths;
    const double *distances_mm;
    uint64_t bytes;                /* of device memory that it holds, whatever the number of pairs */
    const int64_t *pairs;          /* number of pairs in the sums of each depth */
    const hada_fit_scores *scores; /* of the last hada_fitter_finish() */
} hada_fitter_info;
HADA_API const hada_fitter_info *hada_fitter_get_info(hada_fitter *fitter);

#ifdef __cplusplus
}
#endif
#endif
