/* A depth's transfer functions where the sensor crops the light of its scenes. Internal.
 *
 * Per channel, over the pairs of a depth, the point spread function h >= 0 that minimises
 *     sum |b - crop(h * x)|^2
 * The crop couples the frequencies, so that sums do not hold what is needed. Since crop takes nothing but pixels away,
 * sum |X|^2 |H' - H|^2 bounds what the sum of squares does beyond its tangent at H, and the problem of one pass
 * (nonnegative.h) with the cross sums
 *     V = Sxx H - step G,     G = sum conj(X) F(crop F^-1(H X) - b)
 * in the place of conj(Sxb) is that bound: V is Sxb with the light beyond the sensor filled in as H has it (D. Hunter
 * and K. Lange, The American Statistician 58(1), 2004). An iteration takes every pair once, and then the steps of ADMM
 * that share V: the linearised method of multipliers (Z. Lin et al., NIPS 2011). What lies half beyond the sensor comes
 * slowly, so that every third step is longer: 1, 3, 1 leaves (1 - s)^2 (1 - 3 s) of an error whose share s the sensor
 * sees, which is below 1 in magnitude for all s in (0, 1]. docs/explanation/learning-a-camera.md has the figures.
 * Of a colour filter mosaic, crop takes away the values that a pixel does not hold as well, and of saturated ones the
 * prediction is taken where it is larger; the sums have what was filled in, and saturated values as they are. Results
 * are the same bits at every run, whether pairs are kept on the device or brought again. */
#ifndef HADA_FIT_CROPPED_H
#define HADA_FIT_CROPPED_H

#include "fit/fit_sums.h"
#include "fit/nonnegative.h"
#include "fit/trial.h"

/* Iterations of a fit from nothing, and of one that goes on with other pairs; whole rounds of three steps. The first
 * of those from nothing needs no pass. Of a mosaic, frames show a third as much, and so many times more are taken. */
enum { HADA_FIT_CROP_PASSES = 15, HADA_FIT_CROP_FURTHER = 6, HADA_FIT_LEAST_PASSES = 3, HADA_FIT_CROP_MOSAIC = 3 };

typedef struct hada_fit_cropped hada_fit_cropped;

/* The pair's spectra are used as said below; `nonnegative` is of the grid's size, NULL: for gathering alone. */
hada_status hada_fit_cropped_create(hada_fit_cropped **out, const hada_fit_sums *sums, hada_fit_pair *pair,
                                    hada_nonnegative *nonnegative, hada_error *err);
void hada_fit_cropped_destroy(hada_fit_cropped **cropped);

/* Begins with the sums on the device, of `pairs` pairs; scene_energy: per channel, the mean over frequencies of their
 * Sxx. further: from what is there, else from `start` (coarse.h), [channel][plane] complex in rows, or (NULL) from
 * nothing. With a start, steps are not made longer: what comes slowly is there. */
hada_status hada_fit_cropped_begin(hada_fit_cropped *cropped, int64_t pairs, const double *scene_energy, int passes,
                                   int further, const float *start, hada_error *err);

/* Whether another pass is to come; if so it begins. */
hada_status hada_fit_cropped_next(hada_fit_cropped *cropped, int *more, hada_error *err);

/* A pair of this pass: pixels of the frame, their weights (NULL: all alike) and spectra of the scene, of all channels;
 * pair->raw_spectrum is overwritten. */
hada_status hada_fit_cropped_pair(hada_fit_cropped *cropped, cl_mem raw, cl_mem weights, cl_mem scene_spectrum,
                                  hada_error *err);

/* sum conj(X) F(crop F^-1(H X) - b) of the pairs that are given between the two, and nothing else, [channel][count] as
 * the device has them. */
hada_status hada_fit_cropped_gather(hada_fit_cropped *cropped, const float *transfers, hada_error *err);
hada_status hada_fit_cropped_gathered(hada_fit_cropped *cropped, float *sums, hada_error *err);

/* After the passes: the transfer functions of all channels, enqueued, [channel][layout.count]. raw_energy: per channel,
 * the mean over frequencies of Sbb; noise: per channel, receives |N|^2 of what is left of a frame, 0 where one pair
 * says nothing of it. */
hada_status hada_fit_cropped_end(hada_fit_cropped *cropped, const double *raw_energy, double *noise,
                                 const hada_buffer **transfers, hada_error *err);

/* After the end: the sum of squares that the transfer functions leave of a frame; and (unless NULL) all its pixels. */
hada_status hada_fit_cropped_explain(hada_fit_cropped *cropped, cl_mem raw, cl_mem weights, cl_mem scene_spectrum,
                                     double *left, float *rest, hada_error *err);

/* Of the last pass: the sum of squares of what the model left, over all pairs, per channel. */
const double *hada_fit_cropped_left(const hada_fit_cropped *cropped);

/* Transfer functions of all depths where the sensor crops, and those that the trial of refinement needs, which never
 * saw its pairs. */
/* In the place of what sums give. */
typedef struct hada_fit_transfers {
    float *otf;    /* as in a model; NULL: those of the sums */
    double *noise; /* [depth][channel]: |N|^2 of what is left of a frame */
} hada_fit_transfers;

/* Learns those of all depths in so many passes over their pairs (cropped.h), and those of each kept pair's depth
 * without it, into kept. Pairs stay on the device where there is room, else they are read in every pass. */
hada_status hada_fit_transfers_learn(hada_fit_transfers *out, hada_fit_sums *sums, hada_fit_reader *from,
                                     hada_fit_kept *kept, int passes, hada_error *err);
void hada_fit_transfers_free(hada_fit_transfers *transfers);

/* For a single depth: what is left of each frame of `held`, a sum of squares. Its pairs are not in the sums. coarse: 1:
 * the passes begin from coarse transfer functions (coarse.h). light (may
 * be NULL): how much light of the first channel's scenes reaches the grid, |H(0)|. rest (may be NULL): all that is
 * left, [frame][channel][pixel]. */
hada_status hada_fit_transfers_left(hada_fit_sums *sums, hada_fit_reader *from, int passes, int coarse,
                                    hada_fit_reader *held, double *left, double *light, float *rest, hada_error *err);

#endif
