/* What a mask does to light at a point. Internal.
 *
 * What a function here makes the caller frees, also where making it failed. */
#ifndef HADA_OPTICS_MASK_H
#define HADA_OPTICS_MASK_H

#include <hadalens/camera.h>
#include <hadalens/monitor.h>

/* Sequences of the random generator (core/random.h), one a purpose. */
enum { HADA_SEQUENCE_LENSES = 1, HADA_SEQUENCE_SURFACE = 2, HADA_SEQUENCE_CELLS = 3 };

/* A caller's camera, which may be of another version, taken over and checked. */
hada_status hada_camera_take(hada_camera *own, const hada_camera *callers, hada_error *err);

/* The members of hada_camera_numbers, one by one. */
double hada_camera_magnification(const hada_camera *camera, double distance_mm);
double hada_camera_defocus_pixels(const hada_camera *camera, double distance_mm);
double hada_camera_refractive_index(const hada_camera *camera, double wavelength_nm);
double hada_camera_focal_length(const hada_camera *camera, double wavelength_nm);

/* How far the shadow of a plane at the nearer of two depths moves on one at the farther, in pixels, for a lens at
 * (x_mm, y_mm): p d (1/near - 1/far) / pitch. Column first, as x. */
void hada_camera_parallax(const hada_camera *camera, double near_mm, double far_mm, double x_mm, double y_mm,
                          double *cols, double *rows);

/* Whether the mask is made of lenses or round holes, each with a centre. */
static inline int hada_mask_has_lenses(const hada_camera *camera)
{
    return camera->mask == HADA_MASK_MLA || camera->mask == HADA_MASK_GRID ||
           (camera->mask == HADA_MASK_APERTURE && !(camera->cell_mm > 0.0));
}

/* Bending power of a lens, 1/f, at 587.6 nm: 0 for a hole. */
static inline double hada_mask_power(const hada_camera *camera)
{
    return camera->mask == HADA_MASK_APERTURE ? 0.0 : 1.0 / camera->focal_length_mm;
}

/* A smooth random surface on a lattice, between whose nodes are cubic B-splines: twice differentiable, of mean 0 and
 * variance 1 at the nodes, with an autocorrelation of nearly exp(-r^2 / l^2). Made with IEEE operations only, so a seed
 * gives the same bits everywhere. */
typedef struct hada_surface {
    double *node; /* count x count */
    int count;
    double origin, step; /* node i is at origin + i step, on both axes */
} hada_surface;

hada_status hada_surface_make(hada_surface *surface, uint64_t seed, double correlation, double half_width,
                              hada_error *err);
void hada_surface_free(hada_surface *surface);
/* The value, and the gradient where asked for (NULL: not); |x|, |y| <= half_width. */
double hada_surface_at(const hada_surface *surface, double x, double y, double gradient[2]);

/* Points of a plane, found by place. */
typedef struct hada_sites {
    double *x, *y;
    int count;
    int *first, *order; /* of each bucket: the sites that are nearest to some point of it, perhaps; buckets lie row by
                           row over a square */
    int buckets;        /* a side */
    double half, size;  /* of the square; of a bucket */
} hada_sites;

/* Takes over x and y (malloc), also on failure; they lie within |x|, |y| <= half_width. */
hada_status hada_sites_make(hada_sites *sites, double *x, double *y, int count, double half_width, hada_error *err);
void hada_sites_free(hada_sites *sites);
/* The site nearest to a point (the first of equals), and the square of its distance. */
int hada_sites_nearest(const hada_sites *sites, double x, double y, double *square);

/* Points along level lines. */
typedef struct hada_contour {
    double *x, *y; /* malloc'ed */
    int count;
} hada_contour;

typedef struct hada_mask_design {
    hada_camera camera;
    hada_surface surface;        /* diffuser */
    double height;               /* diffuser: optical path of one unit of the surface */
    hada_sites sites;            /* lenses, holes, contour points */
    unsigned char *open;         /* aperture of cells: 1 where open */
    int cells;                   /* a side */
    double slope;                /* a bound of the path's slope, once hada_mask_find_bounds() has looked */
    double reach;                /* lenses, holes: from a centre to the farthest point that belongs to it; likewise */
    double feature;              /* width of the smallest opening; 0: the aperture alone */
    double bend;                 /* a typical large value of its second derivative: how far neighbouring rays part */
    const hada_monitor *monitor; /* asked whether to stop, by whatever goes through the mask; NULL: nobody */
} hada_mask_design;

typedef struct hada_mask_point {
    double edge;     /* distance to where the mask turns opaque: positive where it is open */
    double path;     /* optical path at 587.6 nm, relative; the mask is thin */
    double slope[2]; /* its gradient, along x and y */
    double square;   /* lenses, holes, contours: squared distance to the nearest centre or line */
} hada_mask_point;

hada_status hada_mask_make(hada_mask_design *design, const hada_camera *camera, hada_error *err);
/* The same, asking a monitor, which the design keeps. */
hada_status hada_mask_make_watched(hada_mask_design *design, const hada_camera *camera, const hada_monitor *monitor,
                                   hada_error *err);
void hada_mask_free(hada_mask_design *design);
/* The steepest slope where light passes, and how far the ground of a lens reaches: a scan of the whole mask, which
 * waves need and rays do not. */
void hada_mask_find_bounds(hada_mask_design *design);
void hada_mask_at(const hada_mask_design *design, double x, double y, hada_mask_point *point);

/* How much of a sample of width `step` is open, by the distance to the edge. */
static inline double hada_mask_open(double edge, double step)
{
    const double share = 0.5 + edge / step;
    return share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
}

/* hada_camera_mask_map() of a mask that is made. */
hada_status hada_mask_map(const hada_mask_design *design, int rows, int cols, hada_image *thickness_mm,
                          hada_image *transmission, hada_error *err);

/* hada_camera_psf(), asking a monitor. */
hada_status hada_camera_psf_watched(const hada_camera *camera, double distance_mm, int rows, int cols,
                                    const hada_monitor *monitor, hada_image *psf, hada_error *err);

/* Rays through a mask without lenses, all of them or those of a part of the mask. Internal. */

#define HADA_RAYS_REACH 400

typedef struct hada_rays {
    const hada_mask_design *design;
    double distance, row0, col0, step; /* of the object; the axis on the screen; between rays */
    int half;                          /* rays on either side of the axis */
    double *sum, *line;                /* the screen: the image with a margin, from which light is blurred into it */
    int rows, cols, margin;
    int top, bottom, left, right; /* where light is on the screen */
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

#endif
