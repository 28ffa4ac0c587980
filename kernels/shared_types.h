/* For headers that the host (C11) and the kernels (OpenCL C) both include.
 *
 * Such a header holds constants, enums and structs that kernels take by value. Members are int, unsigned int, float and
 * hada_ulong, those of 8 bytes first; HADA_SHARED_SIZE gives the size, which the host checks when compiling and OpenCL
 * when an argument is set. */
#ifndef SHARED_TYPES_H
#define SHARED_TYPES_H

#if defined(__OPENCL_VERSION__) || defined(__OPENCL_C_VERSION__)
typedef ulong hada_ulong;
#define HADA_SHARED_SIZE(type, bytes)
#else
#include <stdint.h>
typedef uint64_t hada_ulong;
#define HADA_SHARED_SIZE(type, bytes) _Static_assert(sizeof(type) == (bytes), "kernels see this struct with this size");
#endif

#endif
