/* For the kernels of focus.cl: pixels side by side, tiles, counts, and rows with an incomplete last vector. */
#ifndef INC_FOCUS_H
#define INC_FOCUS_H

#include "shared_focus.h"

#ifndef FOCUS_WIDTH
#define FOCUS_WIDTH 16
#endif
/* More than one only with FOCUS_WIDTH 1. */
#ifndef FOCUS_GROUP
#define FOCUS_GROUP 1
#endif
/* A tile of focus_measure. */
#ifndef FOCUS_ROWS
#define FOCUS_ROWS 8
#endif
#ifndef FOCUS_COLS
#define FOCUS_COLS 256
#endif
/* A tile of focus_select: rows, and vectors side by side, which are averaged together. */
#ifndef FOCUS_BAND
#define FOCUS_BAND 32
#endif
#ifndef FOCUS_SIDE
#define FOCUS_SIDE 4
#endif
#define FOCUS_INLINE static inline __attribute__((always_inline))
#define LIGHT_PITCH  HADA_FOCUS_LIGHT_PITCH(FOCUS_COLS, FOCUS_WIDTH)
#define EDGES_PITCH  HADA_FOCUS_EDGES_PITCH(FOCUS_COLS)
#define LIGHT_ROWS   (FOCUS_ROWS + 2)
#define CONTRAST     FOCUS_MEASURE_CONTRAST
#define ENERGY       FOCUS_MEASURE_ENERGY
#define COMBINED     FOCUS_MEASURE_COMBINED

/* Loops that store copy the members of struct arguments to variables first: the compiler would read the struct again
 * after every store that might have changed it. */
#define FOCUS_COPY(to, from)                                                                                           \
    for (int depth = 0; depth < HADA_FOCUS_DEPTHS; depth++)                                                            \
        to[depth] = from[depth];

#if FOCUS_WIDTH == 16
typedef float16 real;
typedef int16 whole;
#define LOAD(p)     vload16(0, p)
#define STORE(v, p) vstore16(v, 0, p)
#define BITS(v)     as_int16(v)
#define TO_WHOLE(v) convert_int16(v)
#else
typedef float real;
typedef int whole;
#define LOAD(p)     (*(p))
#define STORE(v, p) (*(p) = (v))
#define BITS(v)     as_int(v)
#define TO_WHOLE(v) convert_int(v)
#endif

#define EACH_SIDE __attribute__((opencl_unroll_hint(FOCUS_SIDE)))

/* In groups of one, a group takes many tiles, and counts into bins of its own. In groups of many it takes one tile, and
 * all count into the same bins: first into FOCUS_PLACES of local memory, where a place counts for the bin that came
 * there first, then all at once; the values of a tile are mostly alike, and the dark ones the same. The counts are
 * integers: their order does not matter. */
#if FOCUS_GROUP == 1
#define FOR_TILES(t, tiles) for (int t = get_group_id(0); t < tiles; t += get_num_groups(0))
#define WAIT
#define LOCAL_COUNTS
#define COUNT(bins, bin) (bins[bin] += 1)
#define BEGIN_COUNTS
#define END_COUNTS(bins)
#define OWN_BINS(bins) (bins + (size_t)get_group_id(0) * 2 * HADA_FOCUS_BINS)
typedef __global int *focus_bins;
#define BINS_OF(list) (list)
#else
#define FOCUS_PLACES        256
#define FOR_TILES(t, tiles) const int t = get_group_id(0);
#define WAIT                barrier(CLK_LOCAL_MEM_FENCE)
#define LOCAL_COUNTS        __local int place_bins[FOCUS_PLACES], place_counts[FOCUS_PLACES];
#define COUNT(bins, bin)    count_one(bins, bin)
#define BEGIN_COUNTS                                                                                                   \
    for (int place = get_local_id(0); place < FOCUS_PLACES; place += FOCUS_GROUP) {                                    \
        place_bins[place] = -1;                                                                                        \
        place_counts[place] = 0;                                                                                       \
    }                                                                                                                  \
    barrier(CLK_LOCAL_MEM_FENCE);
#define END_COUNTS(bins)                                                                                               \
    barrier(CLK_LOCAL_MEM_FENCE);                                                                                      \
    for (int place = get_local_id(0); place < FOCUS_PLACES; place += FOCUS_GROUP)                                      \
        if (place_counts[place])                                                                                       \
            atomic_add((bins) + place_bins[place], place_counts[place]);
#define OWN_BINS(bins) (bins)
typedef struct focus_bins {
    __global int *all;
    __local int *places, *counts;
} focus_bins;
#define BINS_OF(list)                                                                                                  \
    {                                                                                                                  \
        list, place_bins, place_counts                                                                                 \
    }

FOCUS_INLINE void count_one(focus_bins bins, int bin)
{
    const int place = bin % FOCUS_PLACES, there = atomic_cmpxchg(bins.places + place, -1, bin);
    if (there == -1 || there == bin)
        atomic_inc(bins.counts + place);
    else
        atomic_inc(bins.all + bin);
}
#endif

/* Counts values by the upper 16 bits of their float pattern without its sign, those at columns first <= x < end. */
FOCUS_INLINE void count_values(focus_bins bins, real value, int x, int first, int end)
{
    const whole bin = (BITS(value) & 0x7fffffff) >> 16;
#if FOCUS_WIDTH == 1
    if (x >= first && x < end)
        COUNT(bins, bin);
#else
    int list[FOCUS_WIDTH];
    vstore16(bin, 0, list);
    for (int k = max(first - x, 0); k < min(end - x, FOCUS_WIDTH); k++)
        COUNT(bins, list[k]);
#endif
}

/* Pixels x .. of a row of `cols`; beyond its ends the nearest pixel. */
FOCUS_INLINE real load_row(__global const float *row, int x, int cols)
{
#if FOCUS_WIDTH == 1
    return row[clamp(x, 0, cols - 1)];
#else
    float list[FOCUS_WIDTH];
    if (x >= 0 && x + FOCUS_WIDTH <= cols)
        return LOAD(row + x);
    for (int k = 0; k < FOCUS_WIDTH; k++)
        list[k] = row[clamp(x + k, 0, cols - 1)];
    return LOAD(list);
#endif
}

/* list[which], each in 0 .. */
FOCUS_INLINE real look_up(__global const float *list, whole which)
{
#if FOCUS_WIDTH == 1
    return list[which];
#else
    int from[FOCUS_WIDTH];
    float to[FOCUS_WIDTH];
    vstore16(which, 0, from);
    for (int k = 0; k < FOCUS_WIDTH; k++)
        to[k] = list[from[k]];
    return LOAD(to);
#endif
}

/* The first `count` pixels of a vector. */
FOCUS_INLINE void store_row(real value, __global float *to, int count)
{
#if FOCUS_WIDTH == 1
    *to = value;
#else
    float list[FOCUS_WIDTH];
    if (count >= FOCUS_WIDTH) {
        STORE(value, to);
        return;
    }
    STORE(value, list);
    for (int k = 0; k < count; k++)
        to[k] = list[k];
#endif
}

#endif
