/* Intensities are not negative: values below zero become zero. Planes of two ways, blended. */

/* One work-item takes eight floats from `offset` on; the last one what is left of `count`. */
__kernel void filter_clip(__global float *values, ulong offset, ulong count)
{
    const size_t at = get_global_id(0) * 8;
    __global float *p = values + offset + at;
    if (at + 8 <= count) {
        vstore8(max(vload8(0, p), 0.0f), 0, p);
    } else {
        for (size_t i = 0; at + i < count; i++)
            p[i] = max(p[i], 0.0f);
    }
}

/* values = share * values + (1 - share) * others, both clipped: light is not negative. */
__kernel void filter_blend(__global float *values, ulong offset, __global const float *others, ulong count, float share)
{
    const size_t at = get_global_id(0) * 8;
    __global float *p = values + offset + at;
    if (at + 8 <= count) {
        const float8 blended = share * max(vload8(0, p), 0.0f) + (1.0f - share) * max(vload8(0, others + at), 0.0f);
        vstore8(blended, 0, p);
    } else {
        for (size_t i = 0; at + i < count; i++)
            p[i] = share * max(p[i], 0.0f) + (1.0f - share) * max(others[at + i], 0.0f);
    }
}
