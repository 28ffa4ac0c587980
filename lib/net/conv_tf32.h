/* Whether tensor cores serve convolutions: tried on the device first. Internal. */
#ifndef HADA_NET_CONV_TF32_H
#define HADA_NET_CONV_TF32_H

#include "net/conv_plan.h"

/* Relative rms from the plain convolution: what docs/explanation/speed-and-accuracy.md states against double precision,
 * and as much for the plain one itself. */
#define HADA_CONV_TF32_MOST 2e-6

/* Where the slot's device says that it has tensor cores and nobody has tried them on this context: computes small
 * convolutions by them and holds these against the plain one. From then on they serve (HADA_CONV_AUTO), or a warning in
 * the log says why not. Errors are those of a comparison that could not be made. */
hada_status hada_conv_tf32_try(hada_slot *slot, hada_error *err);

/* The comparison alone: the larger of the relative differences of both sizes of tiles. */
hada_status hada_conv_tf32_apart(hada_slot *slot, double *apart, hada_error *err);

#endif
