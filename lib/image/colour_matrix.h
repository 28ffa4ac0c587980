/* Matrices that bring one camera's colours to another's, in linear light: m[3 * to + from]. Internal. */
#ifndef HADA_IMAGE_COLOUR_MATRIX_H
#define HADA_IMAGE_COLOUR_MATRIX_H

#include <hadalens/image.h>
#include <stddef.h>

enum { HADA_COLOURS = 3, HADA_COLOUR_MATRIX = HADA_COLOURS * HADA_COLOURS };

/* Three planes of `area` values, one after the other, in place. */
void hada_colours_mix(float *planes, size_t area, const double m[HADA_COLOUR_MATRIX]);

/* The same with the inverse; nothing where the matrix is none. */
void hada_colours_unmix(float *planes, size_t area, const double m[HADA_COLOUR_MATRIX]);

/* Weights of such values, 0 where nothing is known and below 0 where only a bound is, once these have been unmixed:
 * what one colour does not know, no colour does, and else the least weight counts. Of a mosaic, the weights of a
 * pixel's other colours are 0 already, and these came from its neighbours: it knows nothing where one of them knows
 * only a bound. Returns how many weights are above 0. */
size_t hada_colours_weigh(float *weights, int rows, int cols, hada_mosaic mosaic);

/* The inverse of a matrix; not finite where the matrix has none. */
void hada_colours_invert(const double m[HADA_COLOUR_MATRIX], double inverse[HADA_COLOUR_MATRIX]);

/* A matrix of zeros says that there is none. */
int hada_colours_known(const double m[HADA_COLOUR_MATRIX]);
/* Whether it is none, or one that can be inverted without making noise more than about ten times as strong. */
int hada_colours_usable(const double m[HADA_COLOUR_MATRIX]);

#endif
