/* Rays through a mask without lenses, all of them or those of a part of the mask. Internal. */
#ifndef HADA_OPTICS_PSF_RAYS_H
#define HADA_OPTICS_PSF_RAYS_H

#include "core/error.h"
#include "optics/mask.h"

#define HADA_RAYS_REACH 400

typedef struct hada_rays {
    const hada_mask_design *design;
    double distance, row0, col0, step; /* of the object; the axis on the screen; between rays */
    int half;                          /* rays on either side of the axis */
    double *sum, *line;                /* the screen: the image with a margin, from which light is blurred into it */
    int rows, cols, margin;
    int top, bottom, left, right; /* where light stands on the screen */
    double kernel[HADA_RAYS_REACH];
    int reach;
} hada_rays;

/* An image of rows x cols with the axis at (axis_row, axis_col). The design must outlive it. */
hada_status hada_rays_make(hada_rays *rays, const hada_mask_design *design, double distance_mm, int rows, int cols,
                           double axis_row, double axis_col, hada_error *err);
void hada_rays_free(hada_rays *rays);

/* Adds the rays through low <= x < high and so in y (mm); *light: theirs. The design's monitor is asked. Then blurs
 * what is on the screen. */
hada_status hada_rays_trace(hada_rays *rays, const double low[2], const double high[2], double *light, hada_error *err);
void hada_rays_blur(hada_rays *rays);
void hada_rays_clear(hada_rays *rays);

static inline double hada_rays_at(const hada_rays *rays, int row, int col)
{
    return rays->sum[(size_t)(row + rays->margin) * (size_t)rays->cols + (size_t)(col + rays->margin)];
}

/* PSF of a mask without lenses by rays: adds to `sum`, rows x cols, all rays making 1. */
hada_status hada_psf_rays(const hada_mask_design *design, double distance_mm, int rows, int cols, double *sum,
                          hada_error *err);

#endif
