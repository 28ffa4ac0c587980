/* Point spread functions as people take them: cleaned before a model is made of them. Internal. */
#ifndef HADA_FILTER_PSF_H
#define HADA_FILTER_PSF_H

#include <hadalens/model.h>

/* What was found in a point spread function. Means over channels; values as they were in the image. */
typedef struct hada_psf_seen {
    double background; /* taken off */
    double uneven;     /* by how much more where it is largest; 0: the same everywhere */
    double noise;      /* standard deviation of the dark pixels */
    double peak;       /* of the brightest pixel, above the background */
    double dark;       /* share of the pixels that are 0 now */
    size_t hot;        /* pixels that were hot and became as their neighbours */
    double border;     /* light of a pixel at the border, over that of a mean pixel; before the taper */
} hada_psf_seen;

/* Takes the background off, sets what is no more than noise to 0 and lets the edges fade out, as the options say. */
hada_status hada_psf_clean(hada_image *psf, const hada_psf_options *options, hada_psf_seen *seen, hada_error *err);

/* The noise of a channel's dark parts. */
typedef struct hada_psf_dark {
    double noise;  /* standard deviation */
    float lowest;  /* value */
    double lifted; /* how much higher the mean of the dark pixels is because noise below `lowest` was cut off */
} hada_psf_dark;
/* room: two floats for each pixel, in what follows as well. */
hada_psf_dark hada_psf_find_dark(const float *pixels, int rows, int cols, float *room);
/* The level of the dark pixels. */
double hada_psf_background(const float *pixels, size_t count, double noise, float *room);
/* Takes off by how much the background is higher than where it is lowest, if it is clearly not even. The most that was
 * taken off. */
double hada_psf_take_uneven(float *pixels, int rows, int cols, double noise, float *room);

/* Exchanges its rows and columns. */
hada_status hada_psf_transpose(hada_image *psf, hada_error *err);

/* The shape of a clean one, means over channels: rows and columns between which 99 % of the light are, the width at
 * half height of its autocorrelation, which is that of its finest details, how much it is like another of its size, 0
 * to 1 (NULL: 0), and how far the middle of its light is from the axis, in pixels. */
typedef struct hada_psf_shape {
    int rows, cols;
    double detail, alike, row, col;
} hada_psf_shape;
hada_status hada_psf_measure(hada_psf_shape *out, const hada_image *psf, const hada_image *other, hada_error *err);

/* HADA_ERROR_ARGUMENT where PSFs of these positions, pixels from the axis, do not tell weights over the field. */
hada_status hada_psf_positions_check(const double *rows, const double *cols, int count, hada_error *err);

/* Shifts PSFs of a depth, each taken at its position, to the middle. What they have beyond their images then is that of
 * the others. */
hada_status hada_psf_register(hada_image *images, const double *rows, const double *cols, int count, hada_error *err);

/* Components of registered PSFs (psf_field.c). The positions stay the caller's. */
typedef struct hada_psf_field {
    const double *rows, *cols;
    int count;
    double *vectors;    /* [position][component] */
    double *singular;   /* descending */
    double lost_single; /* share of the energy that the mean PSF alone leaves */
} hada_psf_field;
hada_status hada_psf_field_of(hada_psf_field *out, const hada_image *images, const double *rows, const double *cols,
                              int count, hada_error *err);
void hada_psf_field_free(hada_psf_field *field);

/* The share of the energy that the first so many components leave. */
double hada_psf_field_lost(const hada_psf_field *field, int components);

/* A component of the registered PSFs, created by the call; -1: their mean. */
hada_status hada_psf_field_component(hada_image *out, const hada_psf_field *field, const hada_image *images,
                                     int component, hada_error *err);

/* Weights [component][rows][cols] of pixels of which the first is row0, col0 from the axis. */
hada_status hada_psf_field_weights(float *out, const hada_psf_field *field, int components, int rows, int cols,
                                   double row0, double col0, hada_error *err);

/* The sum of its values. */
double hada_psf_light(const hada_image *psf);

/* What a model with this grid makes use of: light farther from the axis never reaches a frame from a scene in the
 * window. Created by the call. */
hada_status hada_psf_reach(hada_image *out, const hada_image *psf, const hada_model_info *info, hada_error *err);

#endif
