/* What the layers' kernels share: pixels as vectors of one block of channels (lib/net/tensor.h) and the part of a
 * tensor that a work-item takes.
 *
 * Dimension 2 counts blocks and images, dimension 1 runs of `span` rows, dimension 0 the work-items that share a row,
 * each taking every get_global_size(0)-th pixel: one on CPUs, which walk through whole rows, many on GPUs. A tensor is
 * given as memory and layout. */
#ifndef INC_LAYERS_H
#define INC_LAYERS_H

#include "shared_net.h"

/* Channels in a block: 8 or 16. */
#ifndef NET_BLOCK
#define NET_BLOCK 8
#endif

#define NET_INLINE static inline __attribute__((always_inline))

#if NET_BLOCK == 16
typedef float16 net_vector;
typedef int16 net_lanes;
typedef uint16 net_bits;
#define NET_LANE_NUMBERS      (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
#define NET_AS_BITS(integers) as_uint16(integers)
#else
typedef float8 net_vector;
typedef int8 net_lanes;
typedef uint8 net_bits;
#define NET_LANE_NUMBERS      (int8)(0, 1, 2, 3, 4, 5, 6, 7)
#define NET_AS_BITS(integers) as_uint8(integers)
#endif

NET_INLINE net_vector net_get(__global const float *p)
{
#if NET_BLOCK == 16
    return vload16(0, p);
#else
    return vload8(0, p);
#endif
}

NET_INLINE void net_put(net_vector v, __global float *p)
{
#if NET_BLOCK == 16
    vstore16(v, 0, p);
#else
    vstore8(v, 0, p);
#endif
}

NET_INLINE float net_sum(net_vector v)
{
#if NET_BLOCK == 16
    const float8 h = v.lo + v.hi;
#else
    const float8 h = v;
#endif
    const float4 a = h.lo + h.hi;
    const float2 b = a.lo + a.hi;
    return b.x + b.y;
}

/* The first pixel of a row, as a place in floats. */
NET_INLINE size_t net_row(hada_tensor_layout at, int image, int block, int row)
{
    return at.offset + image * at.image + (((size_t)block * (at.rows + 2) + row + 1) * (at.cols + 2) + 1) * NET_BLOCK;
}

/* Of a value per channel in a plain array: those of a block, `fill` in the lanes that have no channel. */
NET_INLINE net_vector net_per_channel(__global const float *values, int block, int channels, float fill)
{
    if ((block + 1) * NET_BLOCK <= channels)
        return net_get(values + block * NET_BLOCK);
    float lane[NET_BLOCK];
    for (int i = 0; i < NET_BLOCK; i++)
        lane[i] = block * NET_BLOCK + i < channels ? values[block * NET_BLOCK + i] : fill;
#if NET_BLOCK == 16
    return vload16(0, lane);
#else
    return vload8(0, lane);
#endif
}

/* v in the lanes that have a channel, 0 in the others. */
NET_INLINE net_vector net_present(net_vector v, int block, int channels)
{
    return select((net_vector)0.0f, v, NET_LANE_NUMBERS < channels - block * NET_BLOCK);
}

/* Of the launch: which block of which image, which rows. */
typedef struct net_part {
    int block, image, first, last;
} net_part;

NET_INLINE net_part net_part_of(int blocks, int rows, int span)
{
    net_part part;
    part.block = get_global_id(2) % blocks;
    part.image = get_global_id(2) / blocks;
    part.first = get_global_id(1) * span;
    part.last = min(part.first + span, rows);
    return part;
}

/* Walks over the pixels of a row that belong to the work-item. */
#define NET_EACH_PIXEL(x, cols) for (int x = get_global_id(0); x < (cols); x += get_global_size(0))

#endif
