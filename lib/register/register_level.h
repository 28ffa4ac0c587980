/* Pairs on a small grid, and how well a convolution explains them under a transform. Internal. */
#ifndef HADA_REGISTER_REGISTER_LEVEL_H
#define HADA_REGISTER_REGISTER_LEVEL_H

#include "image/small_fft.h"
#include "register/register_sample.h"

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

#endif
