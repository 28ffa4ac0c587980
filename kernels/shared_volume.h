/* What the kernels of volumes (planes near a surface) and the host agree on. */
#ifndef SHARED_VOLUME_H
#define SHARED_VOLUME_H

#include "shared_spectrum.h"

/* Values that a work-group takes: fixes the order of sums on every device. */
#define HADA_VOLUME_SLICE 2048

/* Some of the planes, those of a batch, among all of them. OTFs and spectra stand as [plane][channel][count]. */
typedef struct hada_volume_batch {
    hada_spectrum_shape spectrum;
    unsigned int channels;
    unsigned int first;  /* plane of the batch, among all */
    unsigned int planes; /* of the batch */
    int add;             /* to what stands there already */
} hada_volume_batch;
HADA_SHARED_SIZE(hada_volume_batch, 32)

/* Planes of the window that a texture makes at continuous depths. */
typedef struct hada_volume_splat {
    unsigned int area, channels;
    unsigned int first, planes; /* of the batch */
    int add;
} hada_volume_splat;
HADA_SHARED_SIZE(hada_volume_splat, 20)

#endif
