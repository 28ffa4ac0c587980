/* What becomes of a finished sum in work-groups: four channels of a pixel at a time, 128 bits wide. */
#ifndef INC_CONV_GROUPS_H
#define INC_CONV_GROUPS_H

#include "inc_conv.h"

/* The biases of four channels, of which `present` are there, zero beyond the last one. */
static inline float4 conv_bias_four(__global const float *bias, int flags, int present)
{
    float4 b = (float4)(0.0f);
    if (flags & HADA_CONV_HAS_BIAS) {
        b.x = present > 0 ? bias[0] : 0.0f;
        b.y = present > 1 ? bias[1] : 0.0f;
        b.z = present > 2 ? bias[2] : 0.0f;
        b.w = present > 3 ? bias[3] : 0.0f;
    }
    return b;
}

/* Four channels of an output: `mask` and `y` are their places. */
static inline void conv_put_four(float4 v, hada_conv_epilogue epilogue, int present, __global const float *mask,
                                 __global float *y)
{
    if (epilogue.activation == HADA_ACTIVATION_SIGMOID)
        v = (float4)(1.0f) / ((float4)(1.0f) + exp(-v));
    else if (epilogue.activation != HADA_ACTIVATION_NONE)
        v = max(v, (float4)(0.0f)) +
            (epilogue.activation == HADA_ACTIVATION_RELU ? 0.0f : epilogue.slope) * min(v, (float4)(0.0f));
    if (epilogue.flags & HADA_CONV_HAS_MASK)
        v = select((float4)(0.0f), v, *(__global const float4 *)mask > (float4)(0.0f));
    if (epilogue.flags & HADA_CONV_ACCUMULATES)
        v += *(__global const float4 *)y;
    *(__global float4 *)y = select((float4)(0.0f), v, (int4)(0, 1, 2, 3) < (int4)(present));
}

#endif
