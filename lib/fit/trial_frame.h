/* Frames on trial: pairs that the sums are without, filtered and refined as a reconstruction would, and compared with
 * their scenes. Internal. */
#ifndef HADA_FIT_TRIAL_FRAME_H
#define HADA_FIT_TRIAL_FRAME_H

#include "fit/trial.h"
#include "planes/maker.h"

/* Pairs of a frame, steps of a refinement, and shares that are compared, at most. */
enum { HADA_TRIAL_MEMBERS = 2, HADA_TRIAL_STEPS = 16, HADA_TRIAL_MOST_STEPS = 64, HADA_TRIAL_SHARES = 10 };

typedef struct hada_trial_bench {
    const hada_fit_trial *with;
    const hada_fit_grid *grid;
    hada_plane_maker maker;
    hada_fft *inverse;
    hada_buffer filters, otfs;  /* [place][channel][count] complex: of pairs that are held out, HADA_FIT_KEPT at once */
    hada_buffer prior, weights; /* weights: of the current frame's values; empty: all alike */
    double noise_unit;          /* hada_noise_unit() of the current frame */
    float *raw, *raw_weights;   /* of the current frame */
    float *planes, *linear;     /* planes at hand, and those of the linear filters */
    double *scene_energy, *trust; /* per channel; without a pair, and the model's */
} hada_trial_bench;

/* A frame on trial: of one pair, or the sum of two; its filters are at the places from `first` on. */
typedef struct hada_trial_frame {
    const hada_fit_kept_pair *member[HADA_TRIAL_MEMBERS];
    int members, first;
} hada_trial_frame;

/* `with` and `grid` are set. */
hada_status hada_trial_bench_create(hada_trial_bench *bench, hada_error *err);
void hada_trial_bench_destroy(hada_trial_bench *bench);

/* Filters and transfer functions of the members' depths without their pairs. */
hada_status hada_trial_hold_out(hada_trial_bench *bench, const hada_trial_frame *frame, hada_error *err);

/* Makes a frame the current one: its pixels, spectrum and noise. */
hada_status hada_trial_expose(hada_trial_bench *bench, const hada_trial_frame *frame, hada_error *err);

/* Linear planes, to the host. */
hada_status hada_trial_filter(hada_trial_bench *bench, const hada_trial_frame *frame, hada_error *err);

/* Steps of refinement; ends: those with the learned regulariser follow, and no others may. The planes come to the host.
 */
hada_status hada_trial_refine(hada_trial_bench *bench, const hada_trial_frame *frame,
                              const hada_refine_weights *weights, const hada_maker_steps *steps, int ends,
                              hada_error *err);

/* The sum of squares. */
double hada_trial_energy(const float *values, size_t count);

/* PSNR of planes (negative light clipped, as reconstruction does) against the members' scenes, in the scenes' encoding,
 * mean over members, for each of some shares of theirs in the blend with linear ones; added to psnr[]. */
void hada_trial_compare(const hada_trial_bench *bench, const hada_trial_frame *frame, const double *shares, int count,
                        double *psnr);

#endif
