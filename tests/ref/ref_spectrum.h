/* References of what is done to half spectra between transforms, in double precision. Half spectra are row-major,
 * (rows, cols/2 + 1) complex numbers, re and im interleaved. Internal. */
#ifndef HADA_REF_SPECTRUM_H
#define HADA_REF_SPECTRUM_H

/* The spectrum of a coarse grid of rows x cols from that of a grid of in_rows x in_cols: out = factor * taper^tapers *
 * mean over channels of in, taper = 2^-(fy^2 + fx^2) with f = 1 at the coarse grid's last frequency; the coarse grid's
 * Nyquist row and column are 0. `in`: [channel][values][parts], `out`: [values][parts]; parts 2: complex, 1: real.
 * invert: 1 / out where that is above 0. */
void hada_ref_crop(const float *in, int in_rows, int in_cols, int channels, int rows, int cols, int parts,
                   double factor, double tapers, int invert, double *out);

/* out = in * filter within the band |ky| <= band_rows, kx <= band_cols, made to fit a real image where a value is its
 * own mirror image: columns 0 and cols/2. product: 0 none, 1 complex, 2 split (re * re, im * im). */
void hada_ref_product(const float *in, const float *filter, int product, int rows, int cols, int band_rows,
                      int band_cols, double *out);

/* What the planes with spectra u do not explain of b at a frequency: rest = b - sum over depths of h u (2 values);
 * returns |rest|^2. `h`, `u`: [depth][2]. */
double hada_ref_explain(int depths, const double *h, const double *u, const double *b, double *rest);

/* The same for what the channels have in common: (|mean rest|^2 + mean(prior sum |u|^2) / channels) / (1 + mean(sum
 * variance |u|^2)), means over channels, sums over depths. `h`, `u`: [channel][depth][2], `b`: [channel][2], `prior`:
 * [channel] or NULL, `variance`: [channel][depth] or NULL. */
double hada_ref_score(int channels, int depths, const double *h, const double *u, const double *b, const double *prior,
                      const double *variance);

#endif
