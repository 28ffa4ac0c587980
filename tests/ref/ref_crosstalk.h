/* Reference of crosstalk between planes, taken back, in double precision. Internal. */
#ifndef HADA_REF_CROSSTALK_H
#define HADA_REF_CROSSTALK_H

/* Planes [depth][channel][rows][cols], in place: with m the sum of a plane's channels over the 5 x 5 pixels around one,
 * as far as they are there, and r = m / max over depths of m, x becomes w x, w = (1 + k^4) r^4 / (r^4 + k^4), k =
 * share, and what planes lose at a pixel goes to the one of the largest m (of equals the first). */
void hada_ref_crosstalk(double *planes, int depths, int channels, int rows, int cols, double share);

#endif
