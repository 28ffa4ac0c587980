/* Reference of the refinement: textbook ADMM on the whole grid with explicit dual images, in double precision. It
 * shares no shortcut with lib/refine. Internal. */
#ifndef HADA_REF_REFINE_H
#define HADA_REF_REFINE_H

#include "ref/ref_rect.h"

typedef struct hada_ref_refine {
    int rows, cols;       /* grid */
    hada_ref_rect window; /* where planes may be bright */
    int padded;           /* 0: data everywhere (circular) */
    hada_ref_rect frame;  /* padded: where data is known */
    int depths, channels;
    const double *otf;     /* [depth][channel][rows][cols / 2 + 1] complex, row-major */
    const double *prior;   /* [channel][rows][cols / 2 + 1], or NULL */
    const double *image;   /* [channel][rows][cols]: the data, zero outside the frame */
    const double *weights; /* padded: as the image, of squared errors; below zero: of a pixel whose value may be larger;
                              NULL: 1 each */
    double rho, relaxation, mu;
    double first_rho, growth; /* rho of step k: the smaller of rho and first_rho growth^k; first_rho 0: rho */
    double first_relaxation;  /* of the first first_steps steps */
    int first_steps, steps;
    double tv;        /* weight of total variation, the channels coupled; 0: none */
    double tv_colour; /* how much heavier differences of colour are; 1: no heavier */
    double tv_length;
    int tv_steps; /* of its proximal step (ref_tv.h), whose duals go on from step to step */
    /* Last steps, after the others: rho is ridge_rho, the planes have no duals, and the learned regulariser for noise
     * of this standard deviation (ref_ridge.h) is the proximal step. */
    int ridge_steps;
    double ridge_rho, ridge_noise;
} hada_ref_refine;

/* planes[depth][channel][window_rows][window_cols]; residual (may be NULL) takes steps + ridge_steps + 1 energies of b
 * - sum PSF * u within the frame, split (padded, may be NULL) as many of b - v; place 0 is that of b. */
hada_status hada_ref_refine_run(const hada_ref_refine *problem, double *planes, double *residual, double *split,
                                hada_error *err);

#endif
