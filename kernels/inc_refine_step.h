/* The linear step of the refinement at a frequency, and how badly a set explains what the channels have in common: the
 * formulas, wherever planes and spectra stand (refine.cl has them in words). */
#ifndef INC_REFINE_STEP_H
#define INC_REFINE_STEP_H

#include "inc_refine.h"
#include "shared_refine.h"

/* Sums over the depths of a set: |H|^2, H U and H V. */
typedef struct refine_joint {
    refine_real square, hu_re, hu_im, hv_re, hv_im;
} refine_joint;

/* Adds a depth; w: where the step is a further one. */
REFINE_INLINE void refine_add_depth(refine_joint *joint, const hada_refine_step *now, refine_real h_re,
                                    refine_real h_im, refine_real u_re, refine_real u_im, refine_real w_re,
                                    refine_real w_im)
{
    refine_real v_re = u_re, v_im = u_im;
    joint->square = fma(h_re, h_re, fma(h_im, h_im, joint->square));
    if (now->start == HADA_REFINE_COLD)
        return;
    if (now->start == HADA_REFINE_CONTINUE) {
        v_re = fma(-now->keep, w_re - u_re, u_re);
        v_im = fma(-now->keep, w_im - u_im, u_im);
    }
    joint->hu_re = fma(h_re, u_re, fma(-h_im, u_im, joint->hu_re));
    joint->hu_im = fma(h_re, u_im, fma(h_im, u_re, joint->hu_im));
    joint->hv_re = fma(h_re, v_re, fma(-h_im, v_im, joint->hv_re));
    joint->hv_im = fma(h_re, v_im, fma(h_im, v_re, joint->hv_im));
}

/* The data Y: the frame's spectrum B, or a further step's A - 2 E where a sensor crops. */
REFINE_INLINE void refine_data(const hada_refine_step *now, __global const float *b, __global const float *a, size_t i,
                               refine_real e_re, refine_real e_im, refine_real *y_re, refine_real *y_im)
{
    if (now->padded && now->start == HADA_REFINE_CONTINUE) {
        refine_get(a, i, y_re, y_im);
        *y_re -= 2.0f * e_re;
        *y_im -= 2.0f * e_im;
    } else {
        refine_get(b, i, y_re, y_im);
    }
}

/* The next A where a sensor crops: sum H X = Y - f; relaxed against v = Y + E; then A = that + E. */
REFINE_INLINE void refine_next_split(const hada_refine_step *now, refine_real y_re, refine_real y_im, refine_real e_re,
                                     refine_real e_im, refine_real f_re, refine_real f_im, refine_real *a_re,
                                     refine_real *a_im)
{
    const refine_real v_re = y_re + e_re, v_im = y_im + e_im;
    const float over = now->relaxation;
    *a_re = v_re + e_re + over * (y_re - f_re - v_re);
    *a_im = v_im + e_im + over * (y_im - f_im - v_im);
}

/* f = g e, of the data y, and 1 / g. */
REFINE_INLINE refine_real refine_share_out(const refine_joint *joint, const hada_refine_step *now, refine_real g,
                                           refine_real y_re, refine_real y_im, refine_real *f_re, refine_real *f_im)
{
    const refine_real per_all = 1.0f / (g + joint->square);
    *f_re = (g * y_re - now->rho * joint->hv_re) * per_all;
    *f_im = (g * y_im - now->rho * joint->hv_im) * per_all;
    return 1.0f / g;
}

/* The next W of a depth, from U and the last W. */
REFINE_INLINE void refine_next(const hada_refine_step *now, refine_real per_g, refine_real f_re, refine_real f_im,
                               refine_real h_re, refine_real h_im, refine_real u_re, refine_real u_im,
                               refine_real *w_re, refine_real *w_im)
{
    const float rho = now->rho, over = now->relaxation;
    refine_real d_re = (refine_real)0.0f, d_im = d_re;
    if (now->start == HADA_REFINE_CONTINUE) {
        d_re = now->keep * (*w_re - u_re);
        d_im = now->keep * (*w_im - u_im);
    }
    const refine_real x_re = fma(h_re, f_re, fma(h_im, f_im, rho * (u_re - d_re))) * per_g;
    const refine_real x_im = fma(h_re, f_im, fma(-h_im, f_re, rho * (u_im - d_im))) * per_g;
    *w_re = fma((refine_real)over, x_re - u_re, u_re + d_re);
    *w_im = fma((refine_real)over, x_im - u_im, u_im + d_im);
}

/* What a set leaves: sums over channels of the residual, of the prior's terms and of the spread of its OTFs. */
typedef struct refine_left {
    refine_real re, im, cost, spread;
} refine_left;

/* Takes a depth's light off what is left of the frame. */
REFINE_INLINE void refine_take_off(refine_real *r_re, refine_real *r_im, refine_real h_re, refine_real h_im,
                                   refine_real u_re, refine_real u_im)
{
    *r_re = fma(-h_re, u_re, fma(h_im, u_im, *r_re));
    *r_im = fma(-h_re, u_im, fma(-h_im, u_re, *r_im));
}

/* The same in the sums; *power: sum of |U|^2 of the channel; variance: where the band has one. */
REFINE_INLINE void refine_left_by(refine_left *left, refine_real *power, hada_refine_band band, refine_real h_re,
                                  refine_real h_im, refine_real u_re, refine_real u_im, refine_real variance)
{
    const refine_real square = fma(u_re, u_re, u_im * u_im);
    refine_take_off(&left->re, &left->im, h_re, h_im, u_re, u_im);
    *power += square;
    if (band.has_variance)
        left->spread = fma(variance, square, left->spread);
}

REFINE_INLINE refine_real refine_badness(const refine_left *left, uint channels)
{
    const float share = 1.0f / (float)channels;
    return (fma(left->re, left->re, left->im * left->im) + left->cost) * (share * share) /
           fma(left->spread, share, 1.0f);
}

#endif
