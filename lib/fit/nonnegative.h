/* Transfer functions whose point spread functions are nowhere negative, as those of light are. Internal.
 *
 * Per channel, with S = conj(Sxb) / m, w = Sxx / m and m the mean of Sxx over all frequencies: the image u >= 0 of
 *     min_u  sum over frequencies of  w |S / w - F(u)|^2
 * by ADMM, a fixed number of steps whose weight falls (Boyd et al., sections 3.1, 3.4.1 and 3.4.3, as in
 * refine/admm.h), and then H = (S + q F(u)) / (w + q): the pairs where they say something, elsewhere the image.
 * docs/explanation/learning-a-camera.md tells what was measured. Results are the same bits at every run. */
#ifndef HADA_FIT_NONNEGATIVE_H
#define HADA_FIT_NONNEGATIVE_H

#include "fft/fft.h"

typedef struct hada_nonnegative_rule {
    int steps;          /* at least 1 */
    double first, last; /* > 0: the weight of the constraint at the first step and the last, a geometric series */
    double relaxation;  /* 1 <= relaxation < 2 */
} hada_nonnegative_rule;

/* q: the image's weight against the pairs, which is the less the more exact they are; at most 1. noise: of a channel,
 * |N|^2 (0: not known); raw_energy: mean over frequencies of Sbb. */
double hada_nonnegative_trust(double noise, double raw_energy);

/* What did best (docs/explanation/learning-a-camera.md). */
void hada_nonnegative_rule_init(hada_nonnegative_rule *rule);

typedef struct hada_nonnegative hada_nonnegative;

/* For grids of rows x cols, `channels` at once. Spectra in the layout of hada_fft_layout(context, rows, cols, AUTO). */
hada_status hada_nonnegative_create(hada_nonnegative **out, hada_slot *slot, int rows, int cols, int channels,
                                    hada_error *err);
void hada_nonnegative_destroy(hada_nonnegative **plan);

/* Enqueues the transfer functions of `channels` (<= the plan's) channels, to out[channel][count] from complex number
 * `at` on. sums: per channel, as kernels/inc_fit.h has them; mean and trust: per channel, m and q > 0. */
hada_status hada_nonnegative_solve(hada_nonnegative *plan, const hada_nonnegative_rule *rule, int channels,
                                   const hada_buffer *sums, size_t stride, const double *mean, const double *trust,
                                   cl_mem out, size_t at, hada_error *err);

/* The same step by step, for data that change on the way (cropped.h).
 *
 * What the pairs say: Sxx, and in the place of conj(Sxb) `filled`, [channel][count] complex, or (NULL) the sums' own.
 */
typedef struct hada_nonnegative_data {
    const hada_buffer *sums; /* per channel */
    size_t stride;
    const double *mean; /* per channel, m */
    cl_mem filled;
} hada_nonnegative_data;

/* weight: of the constraint; dual_scale: it over that of the step which follows; start: the first step, u = d = 0;
 * last: the next guess is u, not u - d. */
typedef struct hada_nonnegative_weights {
    double weight, relaxation, dual_scale;
    int start, last;
} hada_nonnegative_weights;

/* Enqueues the beginning from transfer functions, [channel][count]: u is their image where it is not negative, d = 0.
 */
hada_status hada_nonnegative_begin(hada_nonnegative *plan, int channels, cl_mem transfers, hada_error *err);

/* Enqueues a step. out: NULL, or takes the transfer functions between data and image, [channel][count]. */
hada_status hada_nonnegative_step(hada_nonnegative *plan, int channels, const hada_nonnegative_data *data,
                                  const hada_nonnegative_weights *at, cl_mem out, hada_error *err);

/* Enqueues H = (S + q F(u)) / (w + q) of the image as it is. Steps may follow, with `filled` data. */
hada_status hada_nonnegative_end(hada_nonnegative *plan, int channels, const hada_nonnegative_data *data,
                                 const double *trust, cl_mem out, hada_error *err);

#endif
