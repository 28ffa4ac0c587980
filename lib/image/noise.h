/* The noise of a frame, from the frame itself. Internal. */
#ifndef HADA_IMAGE_NOISE_H
#define HADA_IMAGE_NOISE_H

/* Standard deviation of a frame's noise, taken to be white; over channels the root mean square. By the median of the
 * finest diagonal wavelet coefficients, which an image hardly reaches (D. Donoho and I. Johnstone, Biometrika 81(3),
 * 1994, section 4.1, with Haar's wavelet), of some thousand blocks of 2 x 2 pixels spread over the frame. 0 where
 * there are no such blocks. */
double hada_noise_estimate(const float *pixels, int channels, int rows, int cols);

/* What weights that go with noise are in units of: the mean square that a frame with its noise would have, were that
 * the usual `share` of it (deviation over root mean square). The frame's own mean square where share is 0, and where
 * noise is not far from usual; from 1/64 to 64 times that. */
double hada_noise_unit(const float *pixels, int channels, int rows, int cols, double share, double mean_square);

#endif
