/* What frequencies can do to the planes of a plan: from the filters and the energy of a frame to bounds of what leaving
 * some of it out changes, before any inverse transform. Internal; docs/skipping.md derives it.
 *
 * With the energy E of a frame's channel in a tile and the largest |W|^2 of a filter there, the tile's part of a plane
 * has a sum of squares over the grid's pixels of at most max |W|^2 E / (rows cols), by Parseval's theorem. */
#ifndef HADA_FILTER_GAINS_H
#define HADA_FILTER_GAINS_H

#include "filter/model.h"
#include "filter/tiles.h"

typedef struct hada_gains {
    hada_tiles tiles;
    int channels;
    double *most;  /* [channel][tile]: sum over depths of the largest |W|^2 */
    double *mean;  /* of the mean |W|^2 */
    double *half;  /* of the largest |W - half(W)|^2 */
    double *sharp; /* [channel]: sum over depths of the largest |W|^2 of all frequencies */
} hada_gains;

/* Whether half filters can be made of `count` depths of a model (indices; NULL: all). */
int hada_gains_fits_half(const hada_model *model, const int *depths, int count);

/* Of `count` depths. with_half: `half` is filled as well; the filters must fit. */
hada_status hada_gains_create(hada_gains **out, const hada_model *model, const hada_spectrum_layout *layout,
                              const int *depths, int count, int with_half, hada_error *err);
void hada_gains_destroy(hada_gains **gains);

/* All of the following are sums of squares over the pixels of all planes (channels and depths); `energy` is what a
 * hada_meter measured. */

/* At most what the planes change by leaving out what a band does not hold: dropped[i] for band i. */
void hada_gains_dropped(const hada_gains *gains, const float *energy, double dropped[HADA_BANDS]);

/* The same for any band. */
double hada_gains_outside(const hada_gains *gains, const float *energy, int band_rows, int band_cols);

/* At most what they change by filters in half precision. */
double hada_gains_half(const hada_gains *gains, const float *energy);

/* At most what they hold on the whole grid, and about what they hold. */
double hada_gains_most(const hada_gains *gains, const float *energy);
double hada_gains_about(const hada_gains *gains, const float *energy);

#endif
