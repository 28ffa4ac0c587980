/* Integers of 8 or 16 bits over a full scale, as cameras and files store pixels, to floats: the correctly rounded
 * quotient, as the host computes it. The product with the rounded inverse is close, and one correction by its residual,
 * in fused multiply-adds, makes it exact (P. W. Markstein, "Computation of elementary functions on the IBM RISC
 * System/6000 processor", IBM Journal of Research and Development 34(1), 1990); a test checks every number.
 *
 * filter_unpack takes dense samples, filter_gather samples with any strides: a work-item a sample. */
#include "shared_pixels.h"

#define UNPACK_NUMBERS 8 /* of a work-item: 128 bits of 16 each */

float8 unpack_quotients(float8 numbers, float scale, float inverse);
float8 unpack_quotients(float8 numbers, float scale, float inverse)
{
    const float8 near = numbers * inverse;
    return fma(fma(-near, (float8)(scale), numbers), (float8)(inverse), near);
}

__kernel void filter_unpack(__global const uchar *stored, int bytes, float scale, float inverse, __global float *raw,
                            ulong count)
{
    const ulong first = get_global_id(0) * UNPACK_NUMBERS;
    __global const ushort *wide = (__global const ushort *)stored;
    float8 numbers = (float8)(0.0f);
    if (first + UNPACK_NUMBERS <= count) {
        numbers = bytes == 1 ? convert_float8(*(__global const uchar8 *)(stored + first))
                             : convert_float8(*(__global const ushort8 *)(wide + first));
        const float8 values = unpack_quotients(numbers, scale, inverse);
        __global float4 *out = (__global float4 *)(raw + first);
        out[0] = values.lo;
        out[1] = values.hi;
    } else {
        for (ulong i = first; i < count; i++) {
            numbers.s0 = bytes == 1 ? stored[i] : wide[i];
            raw[i] = unpack_quotients(numbers, scale, inverse).s0;
        }
    }
}

__kernel void filter_gather(__global const uchar *stored, hada_stored_form form, __global float *raw)
{
    const int col = (int)get_global_id(0), row = (int)get_global_id(1), channel = (int)get_global_id(2);
    if (col < form.cols) {
        const ulong at = form.first + (ulong)channel * form.channel_stride + (ulong)row * form.row_stride +
                         (ulong)col * form.col_stride;
        const ulong to = ((ulong)channel * (ulong)form.rows + (ulong)row) * (ulong)form.cols + (ulong)col;
        if (form.bytes == 4) {
            raw[to] = ((__global const float *)stored)[at];
        } else {
            const float number = form.bytes == 1 ? stored[at] : ((__global const ushort *)stored)[at];
            raw[to] = unpack_quotients((float8)(number), form.scale, form.inverse).s0;
        }
    }
}
