/* Frames as cameras and files store them: what host and kernels agree on. */
#ifndef SHARED_PIXELS_H
#define SHARED_PIXELS_H

#include "shared_types.h"

/* Where the samples of a frame are, in samples from the first one of the memory; strides count modulo 2^64, so they may
 * be negative. A sample has `bytes` bytes: 1 or 2, a whole number over `scale`; 4, a float. */
typedef struct hada_stored_form {
    hada_ulong first, channel_stride, row_stride, col_stride;
    int channels, rows, cols;
    int bytes;
    float scale, inverse; /* inverse: 1 / scale */
} hada_stored_form;
HADA_SHARED_SIZE(hada_stored_form, 56)

#endif
