/* Hadalens: cameras by design, and their point spread functions.
 *
 * A camera is a mask in front of a bare sensor. Coordinates: millimetres, x to the right, y down, the optical axis at
 * the origin; on the sensor the axis stands at pixel (rows/2, cols/2), rounding down. A scene is given on the
 * sensor's grid (one scene pixel moves the pattern by one sensor pixel), in a window at the middle of the sensor
 * (offset (rows - window_rows) / 2, rounding down); outside the window it is dark. The frame is b = sum_z PSF_z * x_z +
 * noise.
 *
 * Every mask is thin: at its point q it lets light through or not, and turns a ray by the slope of its optical path. A
 * ray from the axis at distance z reaches the sensor, at distance d behind the mask, at q (1 + d/z) + d grad path(q).
 * For the lens centred on p, path = -|q - p|^2 / 2f, that is p (1 + d/z) + (q - p) (1 + d/z - d/f): every lens makes a
 * spot at p (1 + d/z), the magnification, blurred by its own outline scaled by 1 + d/z - d/f, the defocus: zero where
 * 1/z + 1/d = 1/f. Where lenses overlap, a point of the mask belongs to the nearest lens centre.
 *
 * Sources: the thin lens equation; the microlens mask of Tian and Yang, Optics Express 30(19), 34479 (2022), Table 1;
 * the diffuser of Antipa et al., Optica 5(1), 1 (2018); the contour pattern of Boominathan et al., IEEE TPAMI 42(7),
 * 1618 (2020). docs/explanation/simulation.md describes the masks.
 *
 * Threads: cameras are plain values. */
#ifndef HADALENS_CAMERA_H
#define HADALENS_CAMERA_H

#include <hadalens/device.h>
#include <hadalens/image.h>
#include <hadalens/model.h>
#include <hadalens/status.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_mask {
    HADA_MASK_MLA = 1,      /* microlenses at random places inside a round aperture */
    HADA_MASK_GRID = 2,     /* microlenses on a square grid: those nearest to the axis */
    HADA_MASK_DIFFUSER = 3, /* a smooth random surface */
    HADA_MASK_CONTOUR = 4,  /* a phase mask that gathers light along the contour lines of a random landscape */
    HADA_MASK_APERTURE = 5  /* open holes in an opaque plate: round ones, or random cells */
} hada_mask;

/* How PSFs are made (hadalens/optics.h). */
typedef enum hada_optics {
    HADA_OPTICS_GEOMETRY = 0, /* rays; the same for all colours */
    HADA_OPTICS_WAVE = 1      /* scalar waves, a wavelength for each colour */
} hada_optics;

#define HADA_CAMERA_DEPTHS 256 /* most depths of a camera */

/* A camera. Start from hada_camera_init() or a preset, then change what differs. Lengths in millimetres. */
typedef struct hada_camera {
    size_t size; /* sizeof(hada_camera) */
    hada_mask mask;
    hada_boundary boundary;       /* light beyond the sensor comes back in (circular), or is lost (padded) */
    int rows, cols;               /* of the sensor */
    int channels;                 /* 1 or 3; the pattern is the same for all */
    int window_rows, window_cols; /* field of view */
    double pixel_pitch_mm;
    double distance_mm; /* from the mask to the sensor */

    double aperture_mm; /* diameter of the round aperture; it holds the half spacing round every lens's centre */
    uint64_t seed;      /* of all that is random in the mask */
    double blur_pixels; /* geometry: standard deviation of the Gaussian for diffraction, aberration and crosstalk */
    hada_optics optics;

    /* lenses (mla, grid), round holes (aperture) */
    int lenses;
    double lens_diameter_mm;   /* of one outline; overlapping lenses share the ground between their centres. contour:
                                  how wide the strip round a line is that lets light through */
    double focal_length_mm;    /* at 587.6 nm; lenses and contour */
    double minimum_spacing_mm; /* between centres; grid: the period */
    double maximum_spacing_mm; /* mla, holes: every centre has another at most so far away; 0: no bound */

    /* the material, at 587.6 nm; the radius of curvature of a plano-convex lens is f (n - 1) */
    double refractive_index;
    double abbe_number; /* (n_d - 1) / (n_F - n_C); 0: no dispersion */

    double correlation_mm;  /* diffuser, contour: where the autocorrelation of the random surface falls to 1/e */
    double deflection_mrad; /* diffuser: root mean square of the angle that it turns rays by, along each axis */
    double cell_mm;         /* aperture: side of the square cells; 0: round holes */
    double open_fraction;   /* of the cells */

    double wavelengths_nm[3]; /* of red, green, blue; a camera of one channel sees green. For wave optics */

    /* distances from the mask, near to far */
    int depths;
    double distances_mm[HADA_CAMERA_DEPTHS];
} hada_camera;

/* Presets by workload; camera->size must be set, by hada_camera_init() or by hand:
 *   "sim512"     512 x 512 RGB, window 192 x 192, 14 depths from 100 to 600 mm, 37 lenses
 *   "sim300"     300 x 400 RGB, window 120 x 120, 4 depths from 100 to 600 mm, 29 lenses
 *   "crop300"    as sim300 with 14 depths, lenses over 20 mm at 15 mm, padded: 2 to 4 % of the light leaves the sensor
 *   "paper2022"  1376 x 2064 RGB (24 x 36 mm), window 383 x 383, 14 depths from 100 to 600 mm, 37 lenses of 3 mm,
 *                f = 15 mm, in a 12 mm aperture 15 mm before the sensor (Table 1 of the paper)
 * HADA_ERROR_ARGUMENT with the list of names for any other. */
HADA_API hada_status hada_camera_preset(hada_camera *camera, const char *name, hada_error *err);

/* A camera with the values of the preset "sim512". */
static inline void hada_camera_init(hada_camera *camera)
{
    camera->size = sizeof *camera;
    (void)hada_camera_preset(camera, "sim512", NULL);
}

/* Sets `count` distances from near to far with equal steps in 1/z. A single depth stands at near. */
HADA_API hada_status hada_camera_set_depths(hada_camera *camera, double near_mm, double far_mm, int count,
                                            hada_error *err);

/* Adapts size-bound lengths to another sensor: sets rows and cols, and scales the pixel pitch such that the shorter
 * side of the sensor keeps its length. The window keeps its share of the shorter side (and stays square when it was),
 * unless window_rows and window_cols are given (0, 0: keep the share). */
HADA_API hada_status hada_camera_resize(hada_camera *camera, int rows, int cols, int window_rows, int window_cols,
                                        hada_error *err);

/* Another kind of mask in this camera, with dimensions that suit it: grid: a period with which the lenses fill the
 * aperture; diffuser: correlation length aperture/40 and the deflection that puts its caustics near the sensor;
 * contour: correlation length aperture/12; aperture: holes of the sharpest pinhole's diameter, sqrt(2.44 lambda d). The
 * kind that the camera has is left as it is. */
HADA_API hada_status hada_camera_set_mask(hada_camera *camera, hada_mask mask, hada_error *err);

/* The share of the aperture that lets light through. */
HADA_API hada_status hada_camera_fill_factor(const hada_camera *camera, double *fill, hada_error *err);

/* Sets the lens diameter (of lenses, holes, strips) with which the mask lets this share of the aperture's light
 * through, within 0.001. HADA_ERROR_ARGUMENT where no diameter does. */
HADA_API hada_status hada_camera_set_fill_factor(hada_camera *camera, double fill, hada_error *err);

/* What follows from a camera's design at a distance and a wavelength. */
typedef struct hada_camera_numbers {
    size_t size;             /* sizeof(hada_camera_numbers), set by the caller */
    double magnification;    /* 1 + d/z */
    double defocus_pixels;   /* diameter of the defocus disc of a whole lens (or hole, or the width of a strip); 0 for
                                diffusers */
    double refractive_index; /* of the mask's material, by Cauchy's n = A + B / lambda^2 with the camera's n_d and Abbe
                                number */
    double focal_length_mm;  /* f (n_d - 1) / (n - 1) */
} hada_camera_numbers;
HADA_API hada_status hada_camera_get_numbers(const hada_camera *camera, double distance_mm, double wavelength_nm,
                                             hada_camera_numbers *out, hada_error *err);

/* Checks every value; the message names the first that is impossible and says what would do. */
HADA_API hada_status hada_camera_check(const hada_camera *camera, hada_error *err);

/* The centres of lenses or round holes: camera->lenses values each. The same seed gives the same bits everywhere.
 * HADA_ERROR_ARGUMENT when they do not fit into the aperture at the spacing asked for, or the mask has none. */
HADA_API hada_status hada_camera_lenses(const hada_camera *camera, double *x_mm, double *y_mm, hada_error *err);

/* The mask's thickness in millimetres (relative; for apertures 0) and its transmission (0 to 1), each of rows x cols
 * points over the aperture's square: for pictures, and for making the mask. Created by the call; either may be NULL. */
HADA_API hada_status hada_camera_mask_map(const hada_camera *camera, int rows, int cols, hada_image *thickness_mm,
                                          hada_image *transmission, hada_error *err);

/* The point spread function at a distance by geometry: one channel of rows x cols about the axis, at (rows/2, cols/2);
 * 0, 0: of the sensor's size. Created by the call. All light of the mask sums to 1; what falls beyond the grid is
 * missing from the image. */
HADA_API hada_status hada_camera_psf(const hada_camera *camera, double distance_mm, int rows, int cols, hada_image *psf,
                                     hada_error *err);

/* First row (or column) of a window of `window` pixels in a frame of `full` pixels: (full - window) / 2, rounding down.
 */
static inline int hada_window_origin(int full, int window)
{
    return (full - window) / 2;
}

/* Writes the camera as JSON (readable by a person; unknown keys are ignored on reading), beside the file and renamed.
 * Reading needs camera->size alone, starts from hada_camera_init(), and checks the result. */
HADA_API hada_status hada_camera_save(const hada_camera *camera, const char *path, hada_error *err);
HADA_API hada_status hada_camera_load(hada_camera *camera, const char *path, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
