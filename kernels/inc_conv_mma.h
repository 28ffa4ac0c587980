/* A warp's product of small matrices, C + A B with A of 16 x 8 and B of 8 x 8 values in TF32 (a float's 8 bits of
 * exponent and 10 of the fraction), sums in floats: one instruction of tensor cores, or the same in plain OpenCL C.
 *
 * How a warp's 32 items hold the matrices stands in NVIDIA's "Parallel Thread Execution ISA", section "Matrix Fragments
 * for mma.m16n8k8", type .tf32. With row = item / 4 and col = item % 4 within the warp an item has
 *     A[row][col], A[row + 8][col], A[row][col + 4], A[row + 8][col + 4]
 *     B[col][row], B[col + 4][row]
 *     C[row][2 col], C[row][2 col + 1], C[row + 8][2 col], C[row + 8][2 col + 1]. */
#ifndef INC_CONV_MMA_H
#define INC_CONV_MMA_H

#include "shared_conv.h"

/* 1: the instruction, as PTX in assembly, which compilers for NVIDIA's GPUs from compute capability 8.0 on take. */
#ifndef CONV_MMA
#define CONV_MMA 0
#endif

/* The bits of TF32; instructions leave out the others. */
#define CONV_TF32_BITS 0xffffe000u
/* Half of the last bit that is kept. */
#define CONV_TF32_HALF 0x1000u

/* The values that an item shares with the others of its warp. */
typedef struct conv_fragments {
    uint4 a;
    uint2 b;
} conv_fragments;

#if CONV_MMA
/* the compilers that know the instruction: NVIDIA's, and clang for the same devices */
#if !defined(__NV_CL_C_VERSION) && !defined(__NVPTX__) && !defined(cl_nv_pragma_unroll) &&                             \
    !defined(cl_nv_compiler_options) && !defined(cl_nv_device_attribute_query)
#error "CONV_MMA=1 is PTX in assembly, for NVIDIA's compilers"
#endif
#define CONV_EXCHANGE
#define CONV_EXCHANGED 0
#define CONV_UNROLL    _Pragma("unroll")

static inline float4 conv_mma(float4 c, uint4 a, uint2 b, __local conv_fragments *exchange)
{
    float4 d;
    __asm__("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, "
            "{%10,%11,%12,%13};"
            : "=f"(d.x), "=f"(d.y), "=f"(d.z), "=f"(d.w)
            : "r"(a.x), "r"(a.y), "r"(a.z), "r"(a.w), "r"(b.x), "r"(b.y), "f"(c.x), "f"(c.y), "f"(c.z), "f"(c.w));
    return d;
}
#else
#define CONV_EXCHANGE  __local conv_fragments exchange[HADA_CONV_GROUP_ITEMS];
#define CONV_EXCHANGED exchange
/* barriers in loops that stay loops: quicker to compile */
#define CONV_UNROLL    _Pragma("unroll 1")

/* Every item of a group must call this. */
static inline float4 conv_mma(float4 c, uint4 a, uint2 b, __local conv_fragments *exchange)
{
    const int item = get_local_id(0), row = item % 32 / 4, col = item % 4;
    __local const conv_fragments *warp = exchange + item / 32 * 32;
    float4 d = c;
    exchange[item].a = a & CONV_TF32_BITS;
    exchange[item].b = b & CONV_TF32_BITS;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = 0; k < 8; ++k) {
        const uint4 rows = warp[row * 4 + k % 4].a;
        const uint2 left = warp[2 * col * 4 + k % 4].b, right = warp[(2 * col + 1) * 4 + k % 4].b;
        const float upper = as_float(k < 4 ? rows.x : rows.z), lower = as_float(k < 4 ? rows.y : rows.w);
        const float first = as_float(k < 4 ? left.x : left.y), second = as_float(k < 4 ? right.x : right.y);
        d = fma((float4)(upper, upper, lower, lower), (float4)(first, second, first, second), d);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    return d;
}
#endif

/* A float as the sum of two values of TF32: the nearest, and what is left of the rest, 2^-23 of the float at most being
 * lost. */
static inline uint conv_tf32_large(float v)
{
    return (as_uint(v) + CONV_TF32_HALF) & CONV_TF32_BITS;
}

static inline uint conv_tf32_small(float v, uint large)
{
    return as_uint(v - as_float(large)) & CONV_TF32_BITS;
}

#endif
