/* Reference of the refinement's proximal step of total variation, in double precision. Internal. */
#ifndef HADA_REF_TV_H
#define HADA_REF_TV_H

#include "core/base.h"

/* Towards the minimum over u >= 0 of
 *     1/2 |u - w|^2 + theta sum over pixels of sqrt(|mean|^2 + colour^2 |rest|^2),
 * mean: what the differences of u at a pixel, over channels and directions, have in common over the channels, rest:
 * what they have beside (colour 1: plain total variation of coupled channels),
 * differences forward, 0 at the far edges: `steps` projected gradients on the dual (A. Chambolle, "Total variation
 * minimization and a class of binary MRF models", 2005; channels coupled as in X. Bresson and T. Chan, 2008), each of
 * length `length`, below 1/4, from `duals` on, which are kept. w and u are [channel][rows][cols], duals
 * [channel][2][rows][cols] (along columns, along rows), |mean|^2 + |rest|^2 / colour^2 at most 1 at a pixel. */
hada_status hada_ref_tv_coupled(const double *w, int channels, int rows, int cols, double theta, double colour,
                                double length, int steps, double *duals, double *u, hada_error *err);

#endif
