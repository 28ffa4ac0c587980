/* Eight complex numbers between memory, where real and imaginary parts alternate in two vectors, and lanes: a vector of
 * their real parts and one of their imaginary parts. The lanes' order, 0 1 4 5 2 3 6 7, takes a single shuffle of two
 * registers. */
#ifndef INC_LANES_H
#define INC_LANES_H

#include "inc_vectors.h"

#define LANES_INLINE static inline __attribute__((always_inline))

/* Shuffles of two vectors by the compiler's builtin, where it has one: vectors made from components are loaded by LLVM
 * in eight pieces. */
#ifdef __has_builtin
#if __has_builtin(__builtin_shufflevector)
#define LANES_SHUFFLES
#endif
#endif

/* The number of each lane. */
#define LANES_ORDER (int8)(0, 1, 4, 5, 2, 3, 6, 7)

LANES_INLINE void lanes_apart(float8 low, float8 high, float8 *re, float8 *im)
{
#ifdef LANES_SHUFFLES
    *re = __builtin_shufflevector(low, high, 0, 2, 8, 10, 4, 6, 12, 14);
    *im = __builtin_shufflevector(low, high, 1, 3, 9, 11, 5, 7, 13, 15);
#else
    *re = (float8)(low.s02, high.s02, low.s46, high.s46);
    *im = (float8)(low.s13, high.s13, low.s57, high.s57);
#endif
}

/* The numbers of lanes 0 1 4 5, the first four; and those of lanes 2 3 6 7. */
LANES_INLINE float8 lanes_low(float8 re, float8 im)
{
#ifdef LANES_SHUFFLES
    return __builtin_shufflevector(re, im, 0, 8, 1, 9, 4, 12, 5, 13);
#else
    return (float8)(re.s0, im.s0, re.s1, im.s1, re.s4, im.s4, re.s5, im.s5);
#endif
}

LANES_INLINE float8 lanes_high(float8 re, float8 im)
{
#ifdef LANES_SHUFFLES
    return __builtin_shufflevector(re, im, 2, 10, 3, 11, 6, 14, 7, 15);
#else
    return (float8)(re.s2, im.s2, re.s3, im.s3, re.s6, im.s6, re.s7, im.s7);
#endif
}

/* Eight real numbers in the lanes' order. */
LANES_INLINE float8 lanes_real(float8 v)
{
    return v.s01452367;
}

#endif
