/* Eight complex numbers between memory, where they stand one after the other in two vectors, and lanes: a vector of
 * their real parts and one of their imaginary parts. The lanes' order, 0 1 4 5 2 3 6 7, is one that a single shuffle of
 * two registers makes. */
#ifndef INC_LANES_H
#define INC_LANES_H

#define LANES_INLINE static inline __attribute__((always_inline))

/* The number of each lane. */
#define LANES_ORDER (int8)(0, 1, 4, 5, 2, 3, 6, 7)

LANES_INLINE void lanes_apart(float8 low, float8 high, float8 *re, float8 *im)
{
    *re = (float8)(low.s02, high.s02, low.s46, high.s46);
    *im = (float8)(low.s13, high.s13, low.s57, high.s57);
}

/* The numbers of lanes 0 1 4 5, the first four; and those of lanes 2 3 6 7. */
LANES_INLINE float8 lanes_low(float8 re, float8 im)
{
    return (float8)(re.s0, im.s0, re.s1, im.s1, re.s4, im.s4, re.s5, im.s5);
}

LANES_INLINE float8 lanes_high(float8 re, float8 im)
{
    return (float8)(re.s2, im.s2, re.s3, im.s3, re.s6, im.s6, re.s7, im.s7);
}

/* Eight real numbers in the lanes' order. */
LANES_INLINE float8 lanes_real(float8 v)
{
    return v.s01452367;
}

#endif
