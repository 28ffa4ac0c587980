/* For the kernels of layers: pixels as vectors of one block of channels (lib/net/tensor.h) and a work-item's part of a
 * tensor.
 *
 * Dimension 2 counts blocks and images, dimension 1 runs of `span` rows, dimension 0 the work-items that share a row,
 * each taking every get_global_size(0)-th vector: one on CPUs, which go through whole rows, many on GPUs. A tensor is
 * given as memory and layout. */
#ifndef INC_LAYERS_H
#define INC_LAYERS_H

#include "inc_vectors.h"
#include "shared_net.h"

/* Channels in a block: 8 or 16. */
#ifndef NET_BLOCK
#define NET_BLOCK 8
#endif
/* Vectors are a block or (NET_FOURS, for work-groups) four channels of it, an aligned access of 128 bits: work-items
 * side by side then take the vectors of a pixel, and after them those of the next one. */
#ifndef NET_FOURS
#define NET_FOURS 0
#endif
#if NET_FOURS
#define NET_WIDTH 4
#else
#define NET_WIDTH NET_BLOCK
#endif
#define NET_SHARES (NET_BLOCK / NET_WIDTH)
#if NET_SHARES > 1
#define NET_FIRST_LANE ((int)get_global_id(0) % NET_SHARES * NET_WIDTH)
#else
#define NET_FIRST_LANE 0
#endif
/* The work-item's number among those of a row, and how many share it. */
#define NET_ITEM  ((int)get_global_id(0) / NET_SHARES)
#define NET_ITEMS ((int)get_global_size(0) / NET_SHARES)

#define NET_INLINE static inline __attribute__((always_inline))

#if NET_WIDTH == 4
typedef float4 net_vector;
typedef int4 net_lanes;
typedef uint4 net_bits;
#define NET_LANE_NUMBERS      ((int4)(0, 1, 2, 3) + NET_FIRST_LANE)
#define NET_AS_BITS(integers) as_uint4(integers)
#elif NET_WIDTH == 16
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
#if NET_WIDTH == 4
    return *(__global const float4 *)p;
#elif NET_WIDTH == 16
    return vload16(0, p);
#else
    return vload8(0, p);
#endif
}

NET_INLINE void net_put(net_vector v, __global float *p)
{
#if NET_WIDTH == 4
    *(__global float4 *)p = v;
#elif NET_WIDTH == 16
    VECTORS_STORE16(__global, v, p);
#else
    VECTORS_STORE8(__global, v, p);
#endif
}

NET_INLINE float net_sum(net_vector v)
{
#if NET_WIDTH == 4
    const float4 a = v;
#elif NET_WIDTH == 16
    const float8 h = v.lo + v.hi;
    const float4 a = h.lo + h.hi;
#else
    const float4 a = v.lo + v.hi;
#endif
    const float2 b = a.lo + a.hi;
    return b.x + b.y;
}

/* The first pixel of a row, as a place in floats: of its first channel that the work-item takes. */
NET_INLINE size_t net_row(hada_tensor_layout at, int image, int block, int row)
{
    return at.offset + image * at.image + (((size_t)block * (at.rows + 2) + row + 1) * (at.cols + 2) + 1) * NET_BLOCK +
           NET_FIRST_LANE;
}

/* Of a value per channel in a plain array: those of a block, `fill` in the lanes that have no channel. */
NET_INLINE net_vector net_per_channel(__global const float *values, int block, int channels, float fill)
{
#if NET_WIDTH == 4 /* which may begin anywhere */
    const int first = block * NET_BLOCK + NET_FIRST_LANE;
    return (float4)(first < channels ? values[first] : fill, first + 1 < channels ? values[first + 1] : fill,
                    first + 2 < channels ? values[first + 2] : fill, first + 3 < channels ? values[first + 3] : fill);
#else
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
#define NET_EACH_PIXEL(x, cols) for (int x = NET_ITEM; x < (cols); x += NET_ITEMS)

/* Sums: a group of HADA_NET_GROUP work-items makes one of its own, in a tree; on CPUs each work-item does. */
#if NET_SHARES > 1
#define NET_GROUP HADA_NET_GROUP
/* Joins what stands in local memory, work-items of the same channels: `join` adds that of `from` to that of `to`. */
#define NET_TREE(join)                                                                                                 \
    for (int half_left = NET_GROUP / 2; half_left >= NET_SHARES; half_left /= 2) {                                     \
        barrier(CLK_LOCAL_MEM_FENCE);                                                                                  \
        if ((int)get_local_id(0) < half_left)                                                                          \
            join((int)get_local_id(0), (int)get_local_id(0) + half_left);                                              \
    }
#else
#define NET_GROUP 1
#endif

#endif
