/* Focus on the device, plane by plane: only the running best and its neighbours are kept. Internal. */
#ifndef HADA_FOCUS_FOCUS_H
#define HADA_FOCUS_FOCUS_H

#include <hadalens/focus.h>
#include <stdint.h>

#include "kernels/shared_focus.h"
#include "runtime/memory.h"

typedef struct hada_focus_desc {
    hada_focus_options options;
    int channels, rows, cols; /* of a plane */
    int depths;
    const double *distances_mm; /* near to far; read by create alone */
} hada_focus_desc;

typedef struct hada_focus hada_focus;

hada_status hada_focus_create(hada_focus **out, hada_slot *slot, const hada_focus_desc *desc, hada_error *err);
void hada_focus_destroy(hada_focus **focus);

/* Starts a frame. `competing`: one value a depth, 0 leaves it out; NULL: all compete. */
hada_status hada_focus_begin(hada_focus *focus, const unsigned char *competing, hada_error *err);

/* Enqueues planes of depths first .. first + count - 1, each channels x rows x cols floats, one after the other from
 * `offset` (in floats). Depths must come near to far; those that do not compete are passed over (and need not come). */
hada_status hada_focus_push(hada_focus *focus, int first, int count, cl_mem planes, size_t offset, hada_error *err);

/* The same for planes of the depths listed, near to far. */
hada_status hada_focus_push_list(hada_focus *focus, const int *depths, int count, cl_mem planes, hada_error *err);

/* Writes channels x rows x cols floats of the all-in-focus image and rows x cols floats of the distance map at the
 * given offsets (in floats). Waits for the queue, since the thresholds are taken from what was pushed. `light`: where
 * the all-in-focus image, its channels' mean over 5 x 5 pixels, is not above this, there is no distance; 0: not looked
 * at. `report` may be NULL; its coverage is left at NaN (it is known when the map is read). */
hada_status hada_focus_finish(hada_focus *focus, double light, cl_mem all_in_focus, size_t all_in_focus_offset,
                              cl_mem distance_map, size_t distance_offset, hada_focus_report *report, hada_error *err);

/* Parts of the rule that the reference shares no code with (focus_noise.c). */

/* Counts of non-negative floats by the upper 16 bits of their pattern: HADA_FOCUS_BINS, 128 an octave. */

/* Median of the values above 0 (0 when there is none); *total is their number. */
double hada_focus_bins_median_positive(const int64_t *bins, int64_t *total);
/* Median and 1.4826 x median absolute deviation of all values; 0, 0 when there is none. */
void hada_focus_bins_spread(const int64_t *bins, double *median, double *spread);
/* The value that a standard normal variable exceeds with probability p, 0 < p < 1. */
double hada_focus_normal_quantile(double p);
/* What the windowed measure of white noise with standard deviation 1 looks like: mean and standard deviation. */
void hada_focus_noise_moments(hada_focus_measure measure, const double *weights, int radius, double *mean,
                              double *deviation);

#endif
