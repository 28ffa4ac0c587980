/* The inside of registration: images seen through a map, pairs on a small grid, and the search. Internal.
 *
 * With the right transform T every pair of a depth obeys raw = PSF * T(scene) with one and the same unknown PSF; with a
 * wrong one no convolution explains several pairs at once. So the transform is the one under which a convolution that
 * was learned from the other pairs explains each pair best (leave-one-out), judged at all spatial frequencies alike:
 * docs/explanation/learning-a-camera.md. A shift of the scenes is absorbed by the PSF and cannot be found from one
 * depth; hada_register_offset() finds it between depths. All is computed on the host, on reduced copies of the images.
 *
 * What a function here creates the caller destroys, also where creating it failed. */
#ifndef HADA_REGISTER_REGISTER_INSIDE_H
#define HADA_REGISTER_REGISTER_INSIDE_H

#include <hadalens/monitor.h>
#include <hadalens/register.h>

#include "image/small_fft.h"

/* Pairs of a depth that are used, at most. */
enum { HADA_REGISTER_PAIRS = 8 };

/* What is searched. */
typedef struct hada_register_options {
    double least_magnification, most_magnification; /* HADA_AUTO: 0.15 and 2.5 times the frame's longer side over that
                                                       of the scene */
    double most_rotation_deg;                       /* to either side of the quarter turns, at most 45 */
    const hada_monitor *monitor;                    /* asked before each transform that is tried */
} hada_register_options;

/* Finds the transform from the pairs of one depth, two or more: all raw frames of one size, of at least 32 pixels on
 * the longer side, all scenes of one size. The channel with the most structure is used. HADA_ERROR_DATASET where the
 * pairs do not tell; *out then has the best transform all the same. */
hada_status hada_register_pairs(hada_registration *out, const hada_image *raws, const hada_image *scenes, int count,
                                const hada_register_options *options, hada_error *err);

/* The PSF that explains the pairs under a transform (its offset included), about the middle of the frame: one channel
 * of the raw frames' size, reduced by *pitch (pixels of the sensor per pixel). */
hada_status hada_register_psf(hada_image *psf, double *pitch, const hada_image *raws, const hada_image *scenes,
                              int count, const hada_registration *registration, hada_error *err);

/* The shift between two depths. A mask without thickness casts PSFs that are scaled copies of each other about the
 * optical axis, which is in the middle of the frame: finds the scale and the shift (pixels of the sensor) that bring
 * the PSF of one depth on that of another, both of one size and pitch. *likeness: the correlation coefficient there, 0
 * to 1. The shift is that by which the scenes of the other depth have to be moved, if those of the first are right. */
hada_status hada_register_offset(const hada_image *psf, const hada_image *other, double pitch, double *scale,
                                 double *row, double *col, double *likeness, hada_error *err);

enum { HADA_REGISTER_HALVINGS = 12 };

/* One plane at full size and halved again and again (means of 2 x 2). */
typedef struct hada_register_plane {
    int levels;
    int rows[HADA_REGISTER_HALVINGS], cols[HADA_REGISTER_HALVINGS];
    float *data[HADA_REGISTER_HALVINGS];
} hada_register_plane;

hada_status hada_register_plane_create(hada_register_plane *plane, const float *data, int rows, int cols,
                                       hada_error *err);
void hada_register_plane_destroy(hada_register_plane *plane);

/* A plane as it is sampled every `step` of its pixels (1 or less: as it is): a halved copy, smoothed by a Gaussian that
 * makes pixels of one into pixels of the step. */
typedef struct hada_register_view {
    int rows, cols;
    double scale;            /* its pixels per pixel of the plane */
    double mid_row, mid_col; /* the middle of the plane, in its pixels */
    float *data;
    float *room; /* NULL where data is the plane's own */
} hada_register_view;
hada_status hada_register_view_create(hada_register_view *view, const hada_register_plane *plane, double step,
                                      hada_error *err);
void hada_register_view_destroy(hada_register_view *view);

/* The matrix of a registration without its offset and perspective: from the scene to the sensor, (row, column). */
void hada_register_matrix(const hada_registration *registration, double matrix[2][2]);

/* The farthest that the perspective moves a pixel of a scene of rows x cols, in pixels of the sensor. */
double hada_register_perspective(const hada_registration *registration, int rows, int cols);

/* The way back, from the sensor to the scene: with p less the offset, q = inverse * p / (1 - perspective . p). */
typedef struct hada_register_map {
    double inverse[2][2], perspective[2], offset[2];
} hada_register_map;
hada_register_map hada_register_map_of(const hada_registration *registration);

/* out[r * out_pitch + c * out_step] for r < rows, c < cols is what the plane holds where the map leads from p = `pitch`
 * times (row, column) from the middle of rows x cols; both middles are those of the images, between pixels where a size
 * is even. Zero outside. Cubic interpolation (Keys 1981, a = -1/2). */
void hada_register_sample(const hada_register_view *view, const hada_register_map *map, double pitch, int rows,
                          int cols, float *out, int out_pitch, int out_step);

enum { HADA_REGISTER_RINGS = 32 };

/* Pairs of one channel: frames with their mean taken off and their edges faded out, scenes as they are. */
typedef struct hada_register_set {
    int count;
    int frame_side; /* the longer one, in pixels */
    hada_register_plane raws[HADA_REGISTER_PAIRS], scenes[HADA_REGISTER_PAIRS];
} hada_register_set;
hada_status hada_register_set_create(hada_register_set *set, const hada_image *raws, const hada_image *scenes,
                                     int count, hada_error *err);
void hada_register_set_destroy(hada_register_set *set);

/* A grid of size x size over the frame's longer side; spatial frequencies in rings. */
typedef struct hada_register_level {
    const hada_register_set *set;
    int size;
    double pitch; /* pixels of the sensor per pixel of the grid */
    hada_small_fft fft;
    int bins;  /* frequencies looked at: half of the plane */
    short *at; /* per bin: row and column frequency, ring */
    float *b;  /* spectra of the frames: [bin][pair] complex */
    float *x;  /* of the scenes: [column frequency][row frequency][pair] complex */
    float *work;
    double frame_energy[HADA_REGISTER_RINGS], scene_energy[HADA_REGISTER_RINGS];
    int ring_bins[HADA_REGISTER_RINGS];
} hada_register_level;
hada_status hada_register_level_create(hada_register_level *level, const hada_register_set *set, int size,
                                       hada_error *err);
void hada_register_level_destroy(hada_register_level *level);

/* Takes the scenes through a transform; its offset counts. */
hada_status hada_register_level_take(hada_register_level *level, const hada_registration *transform, hada_error *err);

/* How badly a convolution explains the frames by the scenes taken last, turned and mirrored once more: the mean over
 * the frequencies of the logarithm of what leave-one-out leaves unexplained, ring by ring; 0: nothing is explained,
 * smaller is better. */
double hada_register_level_score(const hada_register_level *level, int quarter_turns, int mirrored);

/* The PSF by least squares over all pairs, from the frequencies looked at: size - 1 pixels a side, so that the optical
 * axis is the middle one. Replaces level->work. */
void hada_register_level_psf(hada_register_level *level, float *psf);

/* What the search tries next to each other on a grid of HADA_REGISTER_COARSE: half of what spoils a match. */
#define HADA_REGISTER_STEP     0.05 /* of log magnification */
#define HADA_REGISTER_TURN_DEG 3.0
enum { HADA_REGISTER_COARSE = 64, HADA_REGISTER_FINEST = 256 };

#endif
