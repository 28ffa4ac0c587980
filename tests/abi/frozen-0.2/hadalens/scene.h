/* Hadalens: scenes to show to a camera: drawn from a seed, cut from photographs, parted over depths.
 *
 * All functions create *out. Thread-safe: no state. */
#ifndef HADALENS_SCENE_H
#define HADALENS_SCENE_H

#include <hadalens/image.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A seeded scene without photographs: a coloured 1/f background, and shapes with sharp edges and textures before it.
 * Values 0 to 1. Its spectrum is broad, so a few such scenes suffice to fit a model. */
HADA_API hada_status hada_scene_procedural(hada_image *out, uint64_t seed, int channels, int rows, int cols,
                                           hada_error *err);

/* Cuts the largest centred part of an image with the aspect ratio rows:cols and scales it: mean over area where it
 * shrinks, bilinear where it grows. Use for photographs of any size. */
HADA_API hada_status hada_scene_fit(hada_image *out, const hada_image *image, int rows, int cols, hada_error *err);

/* Scales a whole image to rows x cols in the same way. */
HADA_API hada_status hada_image_resize(hada_image *out, const hada_image *image, int rows, int cols, hada_error *err);

/* Cuts a rectangle out; parts outside the image are zero. */
HADA_API hada_status hada_image_crop(hada_image *out, const hada_image *image, int row0, int col0, int rows, int cols,
                                     hada_error *err);

/* Labels 0 .. regions-1 for every pixel: seeded, compact regions with smooth outlines, none of them empty (where
 * rows * cols allows), for scenes that occupy several depths. `labels` holds rows * cols values. */
HADA_API hada_status hada_scene_regions(int *labels, uint64_t seed, int regions, int rows, int cols, hada_error *err);

/* The part of an image whose label is `label`; the rest is zero. */
HADA_API hada_status hada_scene_part(hada_image *out, const hada_image *image, const int *labels, int label,
                                     hada_error *err);

/* Shapes of surfaces that a scene may stand on. */
typedef enum hada_relief_kind {
    HADA_RELIEF_SLANT = 1, /* a plane that leans from the nearest to the farthest depth */
    HADA_RELIEF_HALF = 2,  /* another that leans from one quarter to three quarters */
    HADA_RELIEF_HILL = 3,  /* smooth random hills */
    HADA_RELIEF_BALL = 4,  /* a ball before a wall */
    HADA_RELIEF_STEPS = 5, /* stairs */
    HADA_RELIEF_BARS = 6   /* thin bars before a wall */
} hada_relief_kind;

/* Depth over a window, one channel: 0 (nearest) to 1 (farthest), to be taken linear in 1/z. Seed 0 gives the plain
 * shape; others turn it, move it, and change its proportions. */
HADA_API hada_status hada_scene_relief(hada_image *out, hada_relief_kind kind, uint64_t seed, int rows, int cols,
                                       hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
