/* Vectors of floats that stand at any float, stored whole. vstore8 and vstore16 say no more than these do, but PoCL has
 * written them as halves of halves, which LLVM leaves apart: four stores of 16 bytes for one, after the shuffles that
 * part them. Loads it puts together again. */
#ifndef INC_VECTORS_H
#define INC_VECTORS_H

typedef float8 vectors_8 __attribute__((aligned(4)));
typedef float16 vectors_16 __attribute__((aligned(4)));

/* `space`: __global, __local or __private, where p points. */
#define VECTORS_STORE8(space, v, p)  (*(space vectors_8 *)(p) = (v))
#define VECTORS_STORE16(space, v, p) (*(space vectors_16 *)(p) = (v))

#endif
