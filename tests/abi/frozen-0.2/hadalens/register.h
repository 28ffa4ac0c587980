/* Hadalens: registration of pairs: how the scenes of a data set have to be turned, mirrored, scaled and moved so that
 * they stand on the sensor's grid, found from the pairs alone.
 *
 * With the right transform T every pair of a depth obeys raw = PSF * T(scene) with one and the same unknown PSF; with a
 * wrong one no convolution explains several pairs at once. So the transform is the one under which a convolution that
 * was learned from the other pairs explains each pair best (leave-one-out), judged at all spatial frequencies alike:
 * docs/explanation/learning-a-camera.md. A shift of the scenes is absorbed by the PSF and cannot be found from one
 * depth; hada_register_offset() finds it between depths.
 *
 * All is computed on the host, on reduced copies of the images. Thread-safe: no state. */
#ifndef HADALENS_REGISTER_H
#define HADALENS_REGISTER_H

#include <hadalens/image.h>
#include <hadalens/monitor.h>
#include <hadalens/status.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Where the pixels of a scene file stand on the sensor's grid. With p and q as (row, column) from the middles of the
 * registered scene and of the file, in pixels:
 *
 *     p = magnification * R(rotation) * Q^quarter_turns * M^mirrored * q + offset
 *
 * M exchanges left and right (column to -column), Q is a quarter turn and R a turn to the left (counter-clockwise as
 * seen on a screen, rows downwards). Mirrored with two quarter turns is upside down. */
typedef struct hada_registration {
    size_t size;                   /* sizeof(hada_registration), set by the caller */
    int mirrored;                  /* 0 or 1 */
    int quarter_turns;             /* 0 to 3 */
    double magnification;          /* pixels of the sensor per pixel of the file */
    double rotation_deg;           /* the rest of the turn, -45 to 45 */
    double offset_row, offset_col; /* pixels of the sensor; 0 from hada_register_pairs() */
    /* How sure: the share of the raw frames' structure that a convolution learned from the other pairs explains, with
     * this transform and with the best one of another orientation (0 to 1, all frequencies alike). */
    double explained, explained_otherwise;
} hada_registration;
/* As the file stands: nothing turned, mirrored, scaled or moved. */
HADA_INIT(hada_registration, HADA_STRUCT_REGISTRATION)

typedef struct hada_register_options {
    size_t size;                                    /* sizeof(hada_register_options) */
    double least_magnification, most_magnification; /* searched; HADA_AUTO (default): what makes the scene's longer side
 0.15 and 2.5 times that of the frame */
    double most_rotation_deg;                       /* to either side of the quarter turns: 15 by default, at most 45 */
    const hada_monitor *monitor; /* asked before each transform that is tried; NULL (default): nobody */
} hada_register_options;
HADA_INIT(hada_register_options, HADA_STRUCT_REGISTER_OPTIONS)

/* Pairs used at most; further ones are not looked at. */
#define HADA_REGISTER_PAIRS 8

/* Finds the transform from the pairs of one depth, two or more: all raw frames of one size, of at least 32 pixels on
 * the longer side, all scenes of one size. The channel with the most structure is used. `options` may be NULL.
 * HADA_ERROR_DATASET when the pairs cannot tell: a single one, scenes without structure, or no transform explains them
 * clearly better than those of other orientations do. */
HADA_API hada_status hada_register_pairs(hada_registration *out, const hada_image *raws, const hada_image *scenes,
                                         int count, const hada_register_options *options, hada_error *err);

/* The PSF that explains the pairs under a transform (its offset included), about the middle of the frame: one channel
 * of the raw frames' size, reduced by *pitch (pixels of the sensor per pixel). */
HADA_API hada_status hada_register_psf(hada_image *psf, double *pitch, const hada_image *raws, const hada_image *scenes,
                                       int count, const hada_registration *registration, hada_error *err);

/* The shift between two depths. A mask without thickness casts PSFs that are scaled copies of each other about the
 * optical axis, which stands in the middle of the frame: finds the scale and the shift (pixels of the sensor) that
 * bring the PSF of one depth on that of another, both of one size and pitch. *likeness: the correlation coefficient
 * there, 0 to 1. Where the scenes of both depths stand right, the shift is 0; otherwise the scenes of the other depth
 * have to be moved by it, if those of the first stand right. */
HADA_API hada_status hada_register_offset(const hada_image *psf, const hada_image *other, double pitch, double *scale,
                                          double *row, double *col, double *likeness, hada_error *err);

/* The size of registered scenes: that of the file, magnified, with rows and columns exchanged by odd quarter turns. */
HADA_API void hada_register_size(const hada_registration *registration, int scene_rows, int scene_cols, int *rows,
                                 int *cols);

/* A scene on the sensor's grid: rows x cols about the same middle, zero where the file has nothing. Where the transform
 * is a matter of flips and quarter turns alone, pixels are moved as they are; else they are interpolated (cubic, with
 * smoothing where the scene shrinks). */
HADA_API hada_status hada_register_apply(hada_image *out, const hada_image *scene,
                                         const hada_registration *registration, int rows, int cols, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
