/* Reference: the energy of filtered spectra in tiles, in double precision. Half spectra are row-major. Internal. */
#ifndef HADA_REF_LIGHT_H
#define HADA_REF_LIGHT_H

/* The energy of a half spectrum in strips of rows by groups of `wide` columns, [strip][group]: a value adds gain
 * |in|^2, twice where its mirror image is not in the half spectrum, to the first strip with min(ky, rows - ky) <=
 * last[strip]. */
void hada_ref_light(const float *in, const float *gain, int rows, int cols, int strips, const int *last, int wide,
                    double *out);

#endif
