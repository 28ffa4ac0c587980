/* Transfer functions of depths between those of a camera: PSFs of its depths magnified to the depth in between
 * (magnification.h), blended, and transformed again. Internal.
 *
 * They are made on demand, for any depth counted in depths of the camera; neighbouring depths one after the other cost
 * the least. An object belongs to one slot. Same bits whatever was made before. */
#ifndef HADA_SURFACE_BETWEEN_H
#define HADA_SURFACE_BETWEEN_H

#include "surface/measure.h"

typedef struct hada_between hada_between;

/* `camera` and `magnification` are copied but for the buffer and the arrays they refer to, which must stay. */
hada_status hada_between_create(hada_between **out, hada_slot *slot, const hada_surface_camera *camera,
                                const hada_magnification *magnification, hada_error *err);
void hada_between_destroy(hada_between **between);

/* The transfer functions of `count` depths, from hada_magnification_beyond() before the first to that behind the last,
 * where the nearest PSF is magnified alone: [count][channel][to->count] complex, from
 * `first` images of to->count on. to: the layout of a coarser grid, whose Nyquist row and column are 0; NULL: the
 * camera's. Enqueued. */
hada_status hada_between_make(hada_between *between, int count, const double *depth, cl_mem out, size_t first,
                              const hada_spectrum_layout *to, hada_error *err);

#endif
