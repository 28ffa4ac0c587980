/* Hadalens: the classic iterative methods, which others use where this library learns: docs/explanation/mathematics.md.
 *
 * All of them look for planes x that explain the frame, b = M sum_z PSF_z * x_z + noise, with the model's transfer
 * functions (measured or learned); M is the sensor's frame (circular boundary: everything), the sum over the depths
 * that are computed, or those that are listed as occupied. Each is a choice of hada_plan_options
 * (hadalens/reconstruct.h), so that frames, results, reports and jobs are the same for all.
 *
 * Threads: no state. Sources of each method: docs/explanation/mathematics.md. */
#ifndef HADALENS_CLASSIC_H
#define HADALENS_CLASSIC_H

#include <hadalens/status.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_method {
    HADA_METHOD_MODEL = 0,  /* the model's own filters, and refinement (hada_plan_options.refine) */
    HADA_METHOD_WIENER = 1, /* conj(H) B / (sum |H|^2 + noise), all depths jointly; no iterations */
    HADA_METHOD_RL = 2,     /* Richardson-Lucy */
    HADA_METHOD_FISTA = 3,
    HADA_METHOD_ADMM = 4
} hada_method;

typedef enum hada_prior {
    HADA_PRIOR_AUTO = 0,    /* ADMM: TV; the others: none */
    HADA_PRIOR_NONE = 1,    /* non-negativity alone */
    HADA_PRIOR_TV = 2,      /* total variation of each plane: of the differences of neighbours, |.|_1 */
    HADA_PRIOR_WAVELET = 3, /* FISTA: Haar wavelets, translation-invariant, |.|_1 */
    HADA_PRIOR_HAAR = 4     /* FISTA: Haar wavelets, orthonormal, |.|_1 */
} hada_prior;

/* Where planes may be bright while a method works; results are the window in any case. */
typedef enum hada_support {
    HADA_SUPPORT_AUTO = 0,   /* as in the literature: ADMM the grid, the others the window */
    HADA_SUPPORT_WINDOW = 1, /* outside it the scene is dark */
    HADA_SUPPORT_GRID = 2    /* light from outside the window is explained as well */
} hada_support;

typedef struct hada_classic_options {
    size_t size;        /* sizeof(hada_classic_options) */
    hada_method method; /* HADA_METHOD_MODEL by default: none of these */
    int iterations;     /* at most; 100 by default */
    double stop;        /* stop when |x - x before| < stop |x| twice running (all planes, L2); 0 (default): never */
    double seconds;     /* stop after so much time, which makes the result depend on it; 0 (default): never */
    hada_prior prior;
    double weight; /* of the prior, see docs/explanation/mathematics.md; HADA_AUTO (default): total variation of FISTA
                      and ADMM without a limit of seconds: found from each frame, in at most 2.5 times the iterations;
                      else the method's own */
    hada_support support;
    double lambda;  /* Wiener: noise in units of the mean |H|^2 of a depth, > 0; 0.1 by default */
    int accelerate; /* Richardson-Lucy: 1 (default): Biggs and Andrews' vector extrapolation */
    double step;    /* FISTA: of the gradient in units of 1 / the largest sum of |H|^2; 0 < step < 2, 1 by default */
    int inner;      /* FISTA: iterations of the TV step, 5 by default */
    int levels;     /* FISTA: levels of the wavelets, 1 to 8; 3 by default */
    double mu1, mu2, mu3; /* ADMM: weights of the splits of data (in units of the data's weight), gradient and planes
                             (these in units of mu1 times the largest |OTF(0)|^2), > 0 */
} hada_classic_options;
HADA_INIT(hada_classic_options, HADA_STRUCT_CLASSIC_OPTIONS)

#ifdef __cplusplus
}
#endif
#endif
