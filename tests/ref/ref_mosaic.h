/* Bilinear interpolation of a colour filter mosaic: of each colour the known values, spread by [1 2 1; 2 4 2; 1 2 1],
 * over the weights spread in the same way; in double precision. */
#ifndef HADA_REF_MOSAIC_H
#define HADA_REF_MOSAIC_H

/* pattern: the colours of the first two rows and columns, such as "rggb". out: [3][rows][cols]. */
void hada_ref_mosaic(const char *pattern, int rows, int cols, const float *values, double *out);

/* The channel of a pixel. */
int hada_ref_mosaic_channel(const char *pattern, int row, int col);

#endif
