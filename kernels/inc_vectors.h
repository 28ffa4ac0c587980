/* Stores of vectors of floats at any float. vstore8 and vstore16 would do, but PoCL implements them by halves of
 * halves, which LLVM does not join: four stores of 16 bytes instead of one, after shuffles. (It does join loads.) */
#ifndef INC_VECTORS_H
#define INC_VECTORS_H

typedef float8 vectors_8 __attribute__((aligned(4)));
typedef float16 vectors_16 __attribute__((aligned(4)));

/* `space`: __global, __local or __private, where p points. */
#define VECTORS_STORE8(space, v, p)  (*(space vectors_8 *)(p) = (v))
#define VECTORS_STORE16(space, v, p) (*(space vectors_16 *)(p) = (v))

#endif
