/* References of the classic methods (docs/explanation/mathematics.md), one channel, in double precision, as their
 * papers have them: every image on the whole grid, every split and dual an array of its own. They share no shortcut
 * with lib/classic. Internal. */
#ifndef HADA_REF_CLASSIC_H
#define HADA_REF_CLASSIC_H

#include "ref/ref_rect.h"

typedef enum hada_ref_method { HADA_REF_WIENER, HADA_REF_RL, HADA_REF_FISTA, HADA_REF_ADMM } hada_ref_method;
typedef enum hada_ref_prior { HADA_REF_NONE, HADA_REF_TV, HADA_REF_WAVELET, HADA_REF_HAAR } hada_ref_prior;

typedef struct hada_ref_classic {
    hada_ref_method method;
    int rows, cols, depths;
    int padded;            /* 0: data everywhere (circular) */
    hada_ref_rect frame;   /* padded: where data is known */
    hada_ref_rect support; /* where planes may be bright */
    const double *otf;     /* [depth][rows][cols / 2 + 1] complex, row-major */
    const double *image;   /* [rows][cols]: the data, zero outside the frame */
    int iterations;
    hada_ref_prior prior;
    double weight;         /* FISTA, ADMM: of the prior's norm; RL: of the divergence */
    double step;           /* FISTA: of the gradient */
    int inner, levels;     /* FISTA: iterations of the TV step; levels of the wavelets */
    int accelerate;        /* RL */
    double sieve;          /* RL: the planes are Gaussians of this standard deviation with weights; 0: none */
    double beside;         /* RL: added to data and predictions, which are a tenth of it at least; 0: none */
    double flat;           /* RL: what planes start from */
    double floor, seen;    /* RL: smallest prediction of a pixel, smallest share of light that is seen */
    double mu1, mu2, mu3;  /* ADMM: weights of the splits of data, gradient, planes */
    double lambda;         /* Wiener: added to the sum of |H|^2 */
    const double *weights; /* of `image`, where it is known (not Wiener, `padded` alone but for RL): a value counts |w|
                              times; below 0: what predicts more than it is right. NULL: all 1 */
} hada_ref_classic;

/* planes[depth][rows][cols]: the whole grid, with negative values where the method leaves some. `change` (may be NULL):
 * |x - x before| / |x| of the last iteration. */
hada_status hada_ref_classic_run(const hada_ref_classic *problem, double *planes, double *change, hada_error *err);

/* The proximal steps alone, in place on one image: TV with non-negativity from the duals [2][rows][cols], which are
 * taken up where they were left; wavelets' soft threshold. */
hada_status hada_ref_tv(double *image, double *duals, int rows, int cols, double weight, int inner, hada_error *err);
hada_status hada_ref_haar(double *image, int rows, int cols, double weight, int levels, int plain, hada_error *err);

#endif
