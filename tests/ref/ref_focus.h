/* Reference of the focus step, by its definition (hadalens/focus.h), in double precision with exact medians. Internal.
 */
#ifndef HADA_REF_REF_FOCUS_H
#define HADA_REF_REF_FOCUS_H

#include <hadalens/focus.h>

/* `planes`: depths x channels x rows x cols. Writes channels x rows x cols (all_in_focus), rows x cols (distance, NaN
 * where not covered; lead: how far the pixel is above the nearer of its two limits, relative to the best measure, so
 * that tests can leave out pixels that rounding decides) and the report. */
hada_status hada_ref_focus(const float *planes, int channels, int rows, int cols, int depths,
                           const double *distances_mm, const unsigned char *competing,
                           const hada_focus_options *options, double *all_in_focus, double *distance, double *lead,
                           hada_focus_report *report, hada_error *err);

/* Distances become NaN where the all-in-focus image, the mean of its channels over 5 x 5 pixels with its edge pixels
 * repeated, is not above `light`. Returns how near any pixel is to that, relative to it. */
double hada_ref_focus_dark(const double *all_in_focus, int channels, int rows, int cols, double light,
                           double *distance);

#endif
