/* The planes near a surface that explain a frame, or the one texture that does at given depths. Internal.
 *
 * Accelerated proximal gradients (A. Beck and M. Teboulle, SIAM Journal on Imaging Sciences 2(1), 2009) on
 *     1/2 |P^(1/2) W M (b - sum_p PSF_p * x_p)|^2 + variation sum TV(x),   x >= 0 in the window and 0 outside,
 * M the sensor's frame (circular boundary: everything), W weights of its pixels and P = 1 / (mean_p |H_p|^2 + floor
 * |H(0)|^2) a weight at every frequency, which makes the steps of all frequencies alike (docs/explanation/surfaces.md).
 * The planes x_p are free within a mask, each with a total variation of its own; or they are shares a_p(d) t of one
 * texture t at depths d, counted in planes, linear between two planes.
 *
 * A volume belongs to one slot. Same bits at every run. */
#ifndef HADA_SURFACE_VOLUME_H
#define HADA_SURFACE_VOLUME_H

#include "refine/admm.h"

typedef struct hada_volume_shape {
    int rows, cols;        /* of the grid */
    hada_rectangle frame;  /* what the sensor sees; used with the padded boundary */
    hada_rectangle window; /* where the scene may be bright */
    hada_boundary boundary;
    int channels;
    int planes; /* with transfer functions of their own */
    int free;   /* 1: hada_volume_solve() will be called; 0: only textures */
    int weighs; /* 1: pixels may have weights; used with the padded boundary */
} hada_volume_shape;

typedef struct hada_volume_rule {
    int steps;
    double floor;     /* of the weight, in units of |H(0)|^2; > 0 */
    double variation; /* weight of total variation, in units of the scene (docs/explanation/surfaces.md); 0: none */
    double colour;    /* in it, weight of differences of colour over those of brightness, from 1; 0: 1 */
    double shrink,
        shrink_tv; /* of a texture, with variation: in the last steps the threshold of the shrinkage of its blocks
                      (refine/proximal.h), in units of variation, and the share of variation that stays */
    double bound;  /* the largest curvature, of which a step is the inverse; it is doubled where it was too small */
} hada_volume_rule;

typedef struct hada_volume hada_volume;

hada_status hada_volume_create(hada_volume **out, hada_slot *slot, const hada_volume_shape *shape, hada_error *err);
void hada_volume_destroy(hada_volume **volume); /* waits for its queue */

/* The transfer functions of a plane, [channel][count] complex in the layout of hada_fft_layout(context, rows, cols,
 * AUTO), `offset` complex numbers into the buffer. Enqueued; copied. */
hada_status hada_volume_set_camera(hada_volume *volume, int plane, cl_mem otf, size_t offset, hada_error *err);

/* The frame, dark level removed: its spectrum [channel][count] and, padded, its pixels [channel][frame] and the weights
 * of these in the data term, as hada_refine_data has them; NULL: all 1. They stay as they are meanwhile. Offsets in
 * complex numbers, in floats. */
void hada_volume_set_frame(hada_volume *volume, cl_mem spectrum, size_t spectrum_offset, cl_mem pixels,
                           size_t pixels_offset, cl_mem weights);

/* The planes, [plane][channel][window] floats: where hada_volume_solve() starts, and what it found. */
cl_mem hada_volume_planes(const hada_volume *volume);

/* Where planes may be bright. */
typedef struct hada_volume_band {
    cl_mem allowed;  /* [plane][channel][window] floats: 1, and 0 where they are dark */
    int first, last; /* planes with a 1: the others cost next to nothing */
} hada_volume_band;

/* band: NULL: everywhere. energy (may be NULL): of what the planes do not explain, before the last step, within the
 * frame. */
hada_status hada_volume_solve(hada_volume *volume, const hada_volume_rule *rule, const hada_volume_band *band,
                              double *energy, hada_error *err);

/* depth: [window] floats, 0 ... planes - 1. texture: [channel][window] floats, where it starts and what it found, with
 * room for HADA_VARIATION_ROOM more. first, last: the planes that any depth touches. */
hada_status hada_volume_texture(hada_volume *volume, const hada_volume_rule *rule, cl_mem depth, int first, int last,
                                cl_mem texture, double *energy, hada_error *err);

/* The shares of a texture at these depths, in `planes` planes, which need not be the volume's: [plane][channel][window]
 * floats. */
hada_status hada_volume_spread(hada_volume *volume, cl_mem depth, cl_mem texture, int planes, cl_mem out,
                               hada_error *err);

#endif
