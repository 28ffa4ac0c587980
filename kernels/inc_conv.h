/* For all kernels of convolutions: vectors of one block of channels, and the end of a sum. */
#ifndef INC_CONV_H
#define INC_CONV_H

#include "inc_vectors.h"
#include "shared_conv.h"

/* Channels in a block: 8 or 16 (lib/net/tensor.h). */
#ifndef NET_BLOCK
#define NET_BLOCK 8
#endif
#if NET_BLOCK == 16
typedef float16 conv_v;
typedef int16 conv_iv;
#define CONV_LOAD(p)  vload16(0, p)
#define CONV_STORE_IN VECTORS_STORE16
#define CONV_LANES    (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
#else
typedef float8 conv_v;
typedef int8 conv_iv;
#define CONV_LOAD(p)  vload8(0, p)
#define CONV_STORE_IN VECTORS_STORE8
#define CONV_LANES    (int8)(0, 1, 2, 3, 4, 5, 6, 7)
#endif
/* To global memory; CONV_STORE_IN(space, v, p) to any. */
#define CONV_STORE(v, p) CONV_STORE_IN(__global, v, p)

/* Prefetches the cache line at p, which may be anywhere. Compilers for the host's own processor have the builtin and
 * one address space; with others this does nothing. */
#if defined(__x86_64__) || defined(__aarch64__)
#define CONV_FETCH(p) __builtin_prefetch((const void *)(size_t)(p), 0, 2)
#else
#define CONV_FETCH(p) ((void)(p))
#endif

/* Stores a whole block of channels past the caches, which a large tensor would only flush, and without reading the line
 * first. Other compilers take the ordinary store. */
#ifdef __has_builtin
#if __has_builtin(__builtin_nontemporal_store)
#define CONV_STREAM(v, p) __builtin_nontemporal_store(v, (__global conv_v *)(p))
#endif
#endif
#ifndef CONV_STREAM
#define CONV_STREAM(v, p) CONV_STORE(v, p)
#endif

/* A finished sum (bias and all) to y, zero in lanes beyond the first `present` channels. Returns what it stored. */
static inline conv_v conv_put(conv_v v, int flags, int activation, float slope, int present, __global const float *mask,
                              __global float *y)
{
    if (activation == HADA_ACTIVATION_LEAKY_RELU)
        v = select(v * slope, v, v > (conv_v)(0.0f));
    else if (activation == HADA_ACTIVATION_SIGMOID)
        v = (conv_v)(1.0f) / ((conv_v)(1.0f) + exp(-v));
    v = max(v, (conv_v)(activation == HADA_ACTIVATION_RELU ? 0.0f : -INFINITY));
    if (flags & HADA_CONV_HAS_MASK)
        v = select((conv_v)(0.0f), v, CONV_LOAD(mask) > (conv_v)(0.0f));
    if (flags & HADA_CONV_ACCUMULATES)
        v += CONV_LOAD(y);
    if (present < NET_BLOCK)
        v = select((conv_v)(0.0f), v, CONV_LANES < (conv_iv)(present));
    if (flags & HADA_CONV_STREAMS)
        CONV_STREAM(v, y);
    else
        CONV_STORE(v, y);
    return v;
}

/* The biases of a block of channels, zero beyond the last of `present`, and where there are none. */
static inline conv_v conv_bias(__global const float *bias, int flags, int present)
{
    float lanes[NET_BLOCK];
    if (!(flags & HADA_CONV_HAS_BIAS))
        return (conv_v)(0.0f);
    for (int k = 0; k < NET_BLOCK; ++k)
        lanes[k] = k < present ? bias[k] : 0.0f;
    return CONV_LOAD(lanes);
}

#endif
