/* The linear step by work-groups, of columns that stand in local memory: what refine_group_columns.cl and
 * refine_odd_columns.cl share. */
#ifndef INC_REFINE_GROUPS_H
#define INC_REFINE_GROUPS_H

#include "inc_refine_step.h"

#ifndef REFINE_CROPPED
#define REFINE_CROPPED 0
#endif

/* The linear step at one frequency, number i of a spectrum; arguments as in refine_columns.cl. `scratch`: U of the
 * first depth there, those of the others every `each` values on, and behind them E; it takes the next W and A, parts
 * changed over. */
REFINE_INLINE float solve(const hada_refine_step *now, __global const float *h, size_t h_step, __global const int *z,
                          __global const float *b, __global float *a, __global const float *prior, __global float *w,
                          size_t w_step, size_t i, __local float2 *scratch, int each)
{
    const int depths = now->problem.depths, cold = now->start == HADA_REFINE_COLD;
    const int further = now->start == HADA_REFINE_CONTINUE;
    refine_joint joint = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    for (int s = 0; s < depths; ++s) {
        const float2 h_s = vload2(i, h + z[s] * h_step), u = cold ? (float2)0.0f : scratch[s * each];
        const float2 last = further ? vload2(i, w + s * w_step) : (float2)0.0f;
        refine_add_depth(&joint, now, h_s.x, h_s.y, u.x, u.y, last.x, last.y);
    }
    const float2 e = REFINE_CROPPED && further ? scratch[depths * each] : (float2)0.0f;
    float y_re, y_im;
    refine_data(now, b, a, i, e.x, e.y, &y_re, &y_im);
    const float r_re = y_re - joint.hu_re, r_im = y_im - joint.hu_im;
    const float g = now->has_prior ? now->rho + prior[i] : now->rho;
    float f_re, f_im;
    const float per_g = refine_share_out(&joint, now, g, y_re, y_im, &f_re, &f_im);
    if (REFINE_CROPPED) {
        float a_re, a_im;
        refine_next_split(now, y_re, y_im, e.x, e.y, f_re, f_im, &a_re, &a_im);
        refine_put(a, i, a_re, a_im);
        scratch[depths * each] = (float2)(a_im, a_re);
    }
    for (int s = 0; s < depths; ++s) {
        const float2 h_s = vload2(i, h + z[s] * h_step), u = cold ? (float2)0.0f : scratch[s * each];
        float w_re = 0.0f, w_im = 0.0f;
        if (further)
            refine_get(w + s * w_step, i, &w_re, &w_im);
        refine_next(now, per_g, f_re, f_im, h_s.x, h_s.y, u.x, u.y, &w_re, &w_im);
        refine_put(w + s * w_step, i, w_re, w_im);
        scratch[s * each] = (float2)(w_im, w_re);
    }
    return fma(r_re, r_re, r_im * r_im);
}

#endif
