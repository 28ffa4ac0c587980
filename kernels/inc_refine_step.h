/* The linear step of the refinement at a frequency, and how badly a set explains what the channels have in common: the
 * formulas in one place for all kernels (refine.cl has them in words). */
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

/* Where the arrays of one channel of a set begin. */
typedef struct refine_channel {
    __global const int *z;   /* the set's depths */
    __global const float *h; /* OTFs, of depth 0 */
    size_t step;             /* floats from a depth's spectrum to the next one's, in OTFs and planes */
    size_t first;            /* the first depth's plane, counted in planes */
    __global const float *b; /* the frame's spectrum */
    __global const float *prior;
    __global float *w, *a; /* of the first depth; of the set */
} refine_channel;

REFINE_INLINE refine_channel refine_channel_of(const hada_refine_problem *problem, uint set, uint channel,
                                               uint channels, __global const float *otf, __global const int *list,
                                               __global const float *frame)
{
    const size_t count = problem->spectrum.count;
    refine_channel at;
    at.z = list + set * (uint)problem->depths;
    at.h = otf + 2 * (problem->otf_offset + channel * count);
    at.step = 2 * (size_t)channels * count;
    at.first = (size_t)set * (size_t)problem->depths * channels + channel;
    at.b = frame + 2 * (problem->frame_offset + channel * count);
    return at;
}

/* The same with what a linear step needs besides. */
REFINE_INLINE refine_channel refine_channel_step(const hada_refine_step *now, uint set, uint channel, uint channels,
                                                 __global const float *otf, __global const int *list,
                                                 __global const float *frame, __global const float *prior,
                                                 __global float *now_w)
{
    const size_t count = now->problem.spectrum.count;
    refine_channel at = refine_channel_of(&now->problem, set, channel, channels, otf, list, frame);
    at.prior = prior + (now->has_prior ? channel * count : 0);
    at.w = now_w + 2 * at.first * count;
    at.a = now_w + 2 * (now->split + ((size_t)set * channels + channel) * count);
    return at;
}

/* Spectra U of a channel's planes and E, which a step reads: in local memory between transforms, from where the next W
 * and A go back to pixels (REFINE_FUSED), or else in global memory.
 *
 * In local memory U of the set's depth number s is at[s * each], and E is behind the last depth. The next W and A take
 * these places with real and imaginary parts swapped, so that a forward transform of them is an inverse one. */
#ifndef REFINE_FUSED
#define REFINE_FUSED 0
#endif
#if !REFINE_FUSED
typedef struct refine_held {
    __global const float *u, *e;
    size_t step;
} refine_held;

REFINE_INLINE void refine_get_u(refine_held held, int s, size_t i, refine_real *re, refine_real *im)
{
    refine_get(held.u + s * held.step, i, re, im);
}

REFINE_INLINE void refine_get_e(refine_held held, int depths, size_t i, refine_real *re, refine_real *im)
{
    refine_get(held.e, i, re, im);
}

REFINE_INLINE void refine_keep(refine_held held, int s, refine_real re, refine_real im)
{
}
#else
#if REFINE_WIDTH == 8
typedef struct refine_held {
    __local float8 *at;
    int each;
} refine_held;

REFINE_INLINE void refine_get_u(refine_held held, int s, size_t i, refine_real *re, refine_real *im)
{
    *re = held.at[s * held.each];
    *im = held.at[s * held.each + 1];
}

REFINE_INLINE void refine_keep(refine_held held, int s, refine_real re, refine_real im)
{
    held.at[s * held.each] = im;
    held.at[s * held.each + 1] = re;
}
#else
typedef struct refine_held {
    __local float2 *at;
    int each;
} refine_held;

REFINE_INLINE void refine_get_u(refine_held held, int s, size_t i, refine_real *re, refine_real *im)
{
    const float2 u = held.at[s * held.each];
    *re = u.x;
    *im = u.y;
}

REFINE_INLINE void refine_keep(refine_held held, int s, refine_real re, refine_real im)
{
    held.at[s * held.each] = (float2)(im, re);
}
#endif

REFINE_INLINE void refine_get_e(refine_held held, int depths, size_t i, refine_real *re, refine_real *im)
{
    refine_get_u(held, depths, i, re, im);
}
#endif

/* The linear step at frequency number i of the spectra; crops: whether the sensor does. Returns |Y - sum H U|^2. */
REFINE_INLINE refine_real refine_step_at(const hada_refine_step *now, const refine_channel *at, int crops, size_t i,
                                         refine_held held)
{
    const int depths = now->problem.depths, cold = now->start == HADA_REFINE_COLD;
    const int further = now->start == HADA_REFINE_CONTINUE;
    const refine_real none = (refine_real)0.0f;
    refine_joint joint = {none, none, none, none, none};
    refine_real y_re, y_im, e_re = none, e_im = none, f_re, f_im;
    for (int s = 0; s < depths; ++s) {
        refine_real h_re, h_im, u_re = none, u_im = none, w_re = none, w_im = none;
        refine_get(at->h + (size_t)at->z[s] * at->step, i, &h_re, &h_im);
        if (!cold)
            refine_get_u(held, s, i, &u_re, &u_im);
        if (further)
            refine_get(at->w + (size_t)s * at->step, i, &w_re, &w_im);
        refine_add_depth(&joint, now, h_re, h_im, u_re, u_im, w_re, w_im);
    }
    if (crops && further) {
        refine_get_e(held, depths, i, &e_re, &e_im);
        refine_get(at->a, i, &y_re, &y_im);
        y_re -= 2.0f * e_re;
        y_im -= 2.0f * e_im;
    } else {
        refine_get(at->b, i, &y_re, &y_im);
    }
    const refine_real r_re = y_re - joint.hu_re, r_im = y_im - joint.hu_im;
    const refine_real g = now->has_prior ? now->rho + refine_get_real(at->prior, i) : (refine_real)now->rho;
    const refine_real per_g = refine_share_out(&joint, now, g, y_re, y_im, &f_re, &f_im);
    if (crops) {
        refine_real a_re, a_im;
        refine_next_split(now, y_re, y_im, e_re, e_im, f_re, f_im, &a_re, &a_im);
        refine_put(at->a, i, a_re, a_im);
        refine_keep(held, depths, a_re, a_im);
    }
    for (int s = 0; s < depths; ++s) {
        refine_real h_re, h_im, u_re = none, u_im = none, w_re = none, w_im = none;
        refine_get(at->h + (size_t)at->z[s] * at->step, i, &h_re, &h_im);
        if (!cold)
            refine_get_u(held, s, i, &u_re, &u_im);
        if (further)
            refine_get(at->w + (size_t)s * at->step, i, &w_re, &w_im);
        refine_next(now, per_g, f_re, f_im, h_re, h_im, u_re, u_im, &w_re, &w_im);
        refine_put(at->w + (size_t)s * at->step, i, w_re, w_im);
        refine_keep(held, s, w_re, w_im);
    }
    return fma(r_re, r_re, r_im * r_im);
}

/* The residual of a set: sums over channels of the residual, of the prior's terms and of the spread of its OTFs. */
typedef struct refine_left {
    refine_real re, im, cost, spread;
} refine_left;

/* Subtracts a depth's light from the residual. */
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

/* Adds channel c at frequency i; arrays as in refine_score, `held`: U of the set's planes of this channel. */
REFINE_INLINE void refine_add_channel(refine_left *left, const hada_refine_problem *problem, hada_refine_band band,
                                      __global const int *z, uint c, size_t i, __global const float *otf,
                                      __global const float *frame, __global const float *prior,
                                      __global const float *variance, refine_held held)
{
    const size_t count = problem->spectrum.count;
    refine_real b_re, b_im, power = (refine_real)0.0f;
    refine_get(frame + 2 * (problem->frame_offset + c * count), i, &b_re, &b_im);
    left->re += b_re;
    left->im += b_im;
    for (int s = 0; s < problem->depths; ++s) {
        const size_t at = ((size_t)z[s] * problem->channels + c) * count;
        refine_real h_re, h_im, u_re, u_im;
        refine_get(otf + 2 * (problem->otf_offset + at), i, &h_re, &h_im);
        refine_get_u(held, s, i, &u_re, &u_im);
        refine_left_by(left, &power, band, h_re, h_im, u_re, u_im,
                       band.has_variance ? refine_get_real(variance + at, i) : (refine_real)0.0f);
    }
    if (band.has_prior)
        left->cost = fma(refine_get_real(prior + c * count, i), power, left->cost);
}

REFINE_INLINE refine_real refine_badness(const refine_left *left, uint channels)
{
    const float share = 1.0f / (float)channels;
    return (fma(left->re, left->re, left->im * left->im) + left->cost) * (share * share) /
           fma(left->spread, share, 1.0f);
}

#endif
