/* The layout of a half spectrum: hada_spectrum_layout of lib/fft/fft.h, for kernels. */
#ifndef SHARED_SPECTRUM_H
#define SHARED_SPECTRUM_H

#include "shared_types.h"

typedef struct hada_spectrum_shape {
    unsigned int count; /* complex numbers of an image */
    unsigned int rows;
    unsigned int block; /* columns in a block */
    unsigned int cols;  /* of the real image */
} hada_spectrum_shape;
HADA_SHARED_SIZE(hada_spectrum_shape, 16)

#endif
