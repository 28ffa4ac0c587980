/* Statistics of a frame, from the frame itself: a rank, the dark level, the noise. Internal. */
#ifndef HADA_IMAGE_STATISTICS_H
#define HADA_IMAGE_STATISTICS_H

#include "image/mosaic.h"

/* The value of rank k (0: the least) of `count` values, which are reordered; k < count, no NaN. */
float hada_select_rank(float *values, size_t count, size_t k);

/* Of `count` values 1 % lie below it. `room` holds count floats, or is the values themselves. */
double hada_first_percentile(const float *values, size_t count, float *room);
/* The dark level of `count` pixels, row by row: the first percentile of means of up to 16 pixels, so that noise hardly
 * lowers it. A few dead pixels do not either, and light that covers less than 99 % of a frame does not raise it. */
double hada_dark_estimate(const float *pixels, size_t count, float *room);
/* That of each channel of a frame; mosaic: of one channel of floats, that of each of its three colours. */
hada_status hada_dark_levels(const hada_pixels *pixels, hada_mosaic mosaic, double *levels, hada_error *err);

/* Values are cut off where the largest one occurs `equal` times and values in the 1024th part below it `near` times:
 * noise spreads light that is not cut off, and in a smooth frame much light is as bright within a hundredth. Where
 * there are none, for the steps of values are coarser than that, those in the 1024th part from the next smaller value
 * down count instead. */
#define HADA_NEAR_LARGEST (1.0f - 0x1p-10f)
static inline int hada_is_cut_off(size_t equal, size_t near)
{
    return equal >= 16 && equal > 4 * near;
}
/* The value at which they are; infinite: they are not. */
float hada_cut_off_value(const float *values, size_t count);
/* Weights of a frame's values, as its sensor gave it: -1 where those of a channel, or of a mosaic of one channel those
 * of a colour, are cut off, else 1; empty where none are. Created by the call. */
hada_status hada_saturated_weigh(const hada_image *frame, hada_mosaic mosaic, hada_image *weights, hada_error *err);
/* Means of such weights become weights: of a mean of some values that are cut off, no more is known than of these. */
void hada_weights_bound(hada_image *weights);

/* Standard deviation of a frame's noise, assumed to be white; over channels the root mean square. From the median of
 * fine diagonal coefficients, which an image hardly reaches (D. Donoho and I. Johnstone, Biometrika 81(3), 1994,
 * section 4.1; here third differences along rows and columns, so that sharp frames reach them less), of some thousand
 * blocks of 4 x 4 pixels spread over the frame. 0 where there are no such blocks. mosaic: of one channel or of all, the
 * pixels that hold each; the blocks are of these. */
double hada_noise_estimate(const hada_pixels *pixels, hada_mosaic mosaic);

/* The usual noise: its standard deviation over the root mean square of a frame, 0: not known; and over a frame's
 * largest value, where that was measured on frames, else 0. */
typedef struct hada_noise_share {
    double of_light, of_largest;
} hada_noise_share;

/* The shares of one frame. */
hada_noise_share hada_noise_share_of(const hada_pixels *pixels, hada_mosaic mosaic, double mean_square, double largest);

/* The square of the unit of weights that are proportional to noise: the frame's mean square, as long as its noise has
 * the usual share; 1/64 to 64 times that otherwise (docs/explanation/refinement.md). */
double hada_noise_unit(const hada_pixels *pixels, hada_mosaic mosaic, const hada_noise_share *usual, double mean_square,
                       double largest);

#endif
