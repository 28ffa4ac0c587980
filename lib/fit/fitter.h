/* The inside of a fitter. Internal.
 *
 * The sums of one depth stand on the device, those of the others on the host, in the device's layout: pairs are best
 * given depth by depth. Kernels and the order of the sums: kernels/inc_fit.h. */
#ifndef HADA_FIT_FITTER_H
#define HADA_FIT_FITTER_H

#include <hadalens/fit.h>

#include "fft/fft.h"
#include "model/model.h"
#include "fit/nonnegative.h"

enum { HADA_FIT_SUMS = 4, HADA_FIT_SUMS_SPLIT = 6 };

/* As the macros FIT_CHUNK and FIT_SETTINGS of kernels/fit_score.cl: groups of frequencies in a partial sum, settings
 * tried at once. */
enum { HADA_FIT_CHUNK = 32, HADA_FIT_TRIALS = 5 };

/* Where alpha and lambda come from when no pair was scored. */
#define HADA_FIT_ALPHA  0.0
#define HADA_FIT_LAMBDA 1e-4

/* The least weight of what filters make outside the window: rounds would not settle below it. */
#define HADA_FIT_LEAST_OUTSIDE 0.01

/* What judging in the window left: filters in the place of the exact fit's, and what was tried. */
enum { HADA_FIT_JUDGED = 6 };
typedef struct hada_fitter_judged {
    float *filters; /* as in a model; NULL: the exact fit's serve */
    int count;      /* weights that were compared; 0: none */
    int chosen;
    double outside[HADA_FIT_JUDGED], psnr[HADA_FIT_JUDGED];
} hada_fitter_judged;

/* Pairs kept for the trial of refinement. */
enum { HADA_FIT_KEPT = 4 };
typedef struct hada_fitter_kept {
    int depth;
    float *raw, *scene; /* pixels, dark level off */
} hada_fitter_kept;

typedef struct hada_fitter_depth {
    float *sums; /* channels x (2 x sums x stride) floats; NULL while nothing was put here */
    int64_t pairs, scored;
    double *raw_energy, *scene_energy; /* per channel: sum of squared pixels of all pairs = mean of Sbb, Sxx */
    double *single, *twofold;          /* per setting: leave-one-out PSNR, summed over scored pairs */
} hada_fitter_depth;

struct hada_fitter {
    hada_context *context;
    hada_slot *slot;
    hada_fit_options options; /* distances_mm points to info.distances_mm */
    hada_model_info info;     /* sizes and conventions of the model to be */
    double *distances;
    hada_geometry geometry;
    hada_spectrum_layout layout;
    size_t vectors; /* groups of eight frequencies in an image */
    size_t stride;  /* floats from one array of sums to the next */
    int sum_count;
    const char *macros; /* of the kernels */
    uint64_t bytes;

    hada_fft *raw_fft, *scene_fft;
    hada_buffer raw, scene; /* pixels */
    hada_buffer b, x;       /* spectra, [channel][layout.count] complex */
    hada_buffer *sums;      /* per channel */
    hada_buffer *pool;      /* per channel */
    hada_buffer weights, settings, partial;
    hada_fft *trial_fft; /* made at the first score, like its buffers */
    hada_buffer trial, planes;
    hada_nonnegative *nonnegative; /* while a fit is finished; NULL: transfer functions from the pairs alone */
    float *raw_pixels, *scene_pixels, *room; /* a pair on its way to the device */
    double *raw_energy, *scene_energy;       /* of that pair, per channel */

    hada_fitter_depth *depth;
    int current; /* depth whose sums stand on the device, -1: none */
    int changed; /* they differ from the host's copy */
    int pooled;  /* the pools are up to date */

    hada_fitter_kept kept[HADA_FIT_KEPT];
    int kept_count;
    hada_fitter_judged judged;

    int setting_count;        /* a multiple of HADA_FIT_TRIALS: the last one may be repeated */
    int distinct;             /* settings that differ */
    double *alphas, *lambdas; /* per setting */
    int chunks;
};

/* The transform of frames (0) or of what stands in the window (1), of all channels. */
hada_fft_desc hada_fitter_describe(const hada_fitter *fitter, hada_fft_direction direction, int window);

/* Brings the sums of a depth to the device. */
hada_status hada_fitter_select(hada_fitter *fitter, int depth, hada_error *err);

/* The sums of the current depth back to the host. */
hada_status hada_fitter_put_back(hada_fitter *fitter, hada_error *err);

/* Whether a pair fits and is finite. */
hada_status hada_fitter_check_pair(const hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                                   hada_error *err);

/* Takes the dark level off a checked pair: pixels in fitter->raw_pixels and fitter->scene_pixels, sums of squared
 * pixels in fitter->raw_energy and fitter->scene_energy. */
void hada_fitter_take(hada_fitter *fitter, const hada_image *raw, const hada_image *scene);

/* The same, and transforms it: spectra in fitter->b and fitter->x. */
hada_status hada_fitter_stage(hada_fitter *fitter, const hada_image *raw, const hada_image *scene, hada_error *err);

/* Spectra of pixels whose dark level is off already; scene NULL: of the frame alone. */
hada_status hada_fitter_transform(hada_fitter *fitter, const float *raw, const float *scene, hada_error *err);

/* Adds the pair in fitter->b and fitter->x to the sums on the device, or (sign -1) takes it out of them. */
hada_status hada_fitter_accumulate(hada_fitter *fitter, double sign, hada_error *err);

/* Enqueues the filter of one channel, or the transfer functions of all channels, of the depth on the device, to complex
 * number `at`. scene_energy: per channel, of the pairs in the sums; trust: hada_nonnegative_trust(). */
hada_status hada_fitter_solve_filter(hada_fitter *fitter, int channel, double alpha, double ridge, cl_mem out,
                                     size_t at, hada_error *err);
hada_status hada_fitter_solve_transfers(hada_fitter *fitter, const double *scene_energy, const double *trust,
                                        cl_mem out, size_t at, hada_error *err);

/* Keeps the pair that was just scored for the trial of refinement, where that wants one of this depth. */
hada_status hada_fitter_keep(hada_fitter *fitter, int depth, hada_error *err);
void hada_fitter_drop_kept(hada_fitter *fitter);
void hada_fitter_drop_judged(hada_fitter *fitter);

/* The weights that the scores prefer, the caller's, or the defaults; as hada_fitter_best(). */
size_t hada_fitter_choice(const hada_fitter *fitter, double *alpha, double *lambda, int *scored);

/* One spectrum on the device, at complex number `at` of `from`, in rows; `blocks`: 2 layout.count floats. `what` names
 * it where it is not finite. */
hada_status hada_fitter_read_plane(hada_fitter *fitter, const hada_buffer *from, size_t at, float *blocks, float *to,
                                   const char *what, hada_error *err);

/* Whether refinement pays: tries it on kept pairs and sums of two of them, each left out of the sums, and sets the
 * model's refine_steps and refine_rho. Appends its rows to *rows (may be NULL). Without kept pairs nothing changes. */
hada_status hada_fit_choose_refinement(hada_fitter *fitter, hada_model *model, hada_fit_row **rows, size_t *row_count,
                                       hada_error *err);

/* New sums make old scores and pools worthless. */
void hada_fitter_forget_scores(hada_fitter *fitter);

/* Makes the pools over depths, unless they are up to date. */
hada_status hada_fitter_pool(hada_fitter *fitter, hada_error *err);

/* Makes what leave-one-out needs beyond the sums, once. */
hada_status hada_fitter_prepare_trials(hada_fitter *fitter, hada_error *err);

/* Enqueues a kernel of a file with an item per eight frequencies. */
hada_status hada_fitter_launch(hada_fitter *fitter, const char *file, const char *name, const hada_arg *args,
                               size_t arg_count, hada_error *err);

/* The setting that the scores prefer, or 0 without scores; *scored says whether there are any. Score: the PSNR of a
 * depth alone plus the PSNR with another depth's light, means over scored depths. In decibels, for the latter alone
 * would ruin single depths. */
size_t hada_fitter_best(const hada_fitter *fitter, int *scored);

/* Rows for the settings (where scored) and for the weights outside the window that were compared; *rows is freed with
 * free(). */
hada_status hada_fitter_rows(const hada_fitter *fitter, size_t best, int scored, hada_fit_row **rows, size_t *count,
                             hada_error *err);

/* Solves with the given weights into a new model. */
hada_status hada_fitter_solve(hada_fitter *fitter, double alpha, double lambda, hada_model **out, hada_error *err);

#endif
