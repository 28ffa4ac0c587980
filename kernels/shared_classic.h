/* Constants and structs of the classic methods, for kernels and host. */
#ifndef SHARED_CLASSIC_H
#define SHARED_CLASSIC_H

#include "shared_spectrum.h"

/* A step on the pixels of a prediction y of the frame b, or of planes. */
typedef enum hada_classic_pixel_step {
    HADA_CLASSIC_NO_STEP = 0,
    HADA_CLASSIC_RATIO = 1,    /* y = max(b, 0) / max(y, number): Richardson-Lucy */
    HADA_CLASSIC_SPLIT = 2,    /* the split that meets the data: ADMM */
    HADA_CLASSIC_RESIDUAL = 3, /* y = b - y */
    HADA_CLASSIC_MOMENTUM = 4, /* of planes: gradient step, non-negativity and momentum of FISTA */
    HADA_CLASSIC_LEFT = 5,     /* y = b - y, where a value has a weight; else 0 */
    HADA_CLASSIC_WEIGH = 6     /* y = |weight| y */
} hada_classic_pixel_step;

/* Half spectra of a set of depths: OTFs as [depth][channel][count], the frame as [channel][count]. */
typedef struct hada_classic_problem {
    hada_ulong otf_offset, frame_offset; /* in complex numbers */
    hada_spectrum_shape spectrum;
    int depths;         /* of the set */
    unsigned int slice; /* frequencies of a work-group */
} hada_classic_problem;
HADA_SHARED_SIZE(hada_classic_problem, 40)

/* The least-squares step: weights of the data, of the planes' gradient and of the planes themselves. */
typedef struct hada_classic_weights {
    float data, gradient, planes;
    int cropped; /* the data are a split's */
    int first;   /* the planes are taken as 0 */
} hada_classic_weights;
HADA_SHARED_SIZE(hada_classic_weights, 20)

/* Images in bands of rows. */
typedef struct hada_classic_bands {
    int rows, cols, pitch;
    int band; /* rows of a work-group */
} hada_classic_bands;
HADA_SHARED_SIZE(hada_classic_bands, 16)

/* Images in slices of pixels; image number i belongs to channel i % channels. */
typedef struct hada_classic_slices {
    unsigned int channels, pixels;
    unsigned int slice; /* pixels of a work-group */
} hada_classic_slices;
HADA_SHARED_SIZE(hada_classic_slices, 12)

/* ADMM's splits of the planes. */
typedef struct hada_classic_splits {
    int row0, col0, row1, col1; /* the support */
    int has_tv;
    float gradient, planes; /* penalties: mu2, mu3 */
    float threshold;
} hada_classic_splits;
HADA_SHARED_SIZE(hada_classic_splits, 32)

/* A level of Haar wavelets; offsets in floats. */
typedef struct hada_classic_level {
    hada_ulong fine, coarse, result; /* where the level's means, the next one's and the result stand */
    int spacing;                     /* 2^level */
    int decimated;                   /* the orthonormal transform; else the translation-invariant one */
    int more;                        /* changes of the next level are given */
    int image;                       /* level 0: the image is added */
} hada_classic_level;
HADA_SHARED_SIZE(hada_classic_level, 40)

/* Columns of half spectra of image rows: where planes and frame are on the grid, in rows. */
typedef struct hada_classic_columns {
    hada_ulong otf_offset;
    int plane_row0, plane_rows, frame_row0, frame_rows;
    int depths, channels, blocks;
    int transpose; /* 0: frames from planes; 1: planes from frames */
} hada_classic_columns;
HADA_SHARED_SIZE(hada_classic_columns, 40)

/* Rows of images and of their half spectra. */
typedef struct hada_classic_rows {
    int blocks;
    int inverse, forward; /* pixels from half spectra; half spectra from pixels */
    int step;             /* hada_classic_pixel_step between them */
    int channels, rows, pitch;
    int col0, cols; /* on the grid */
    float number;   /* of the step */
    float scale;    /* of the inverse transform */
    int back_table; /* where the inverse transform's table begins in that of both, in numbers */
    int weighted;   /* 1: values of the frame have weights */
} hada_classic_rows;
HADA_SHARED_SIZE(hada_classic_rows, 52)

#endif
