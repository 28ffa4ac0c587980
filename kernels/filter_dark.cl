/* Takes the dark level, and a dark frame where there is one, off every pixel. An item takes eight pixels. */
__kernel void filter_dark(__global float *raw, __global const float *dark, int framed, float level, ulong count)
{
    const size_t first = get_global_id(0) * 8;
    if (first + 8 <= count) {
        float8 value = vload8(0, raw + first) - level;
        if (framed)
            value -= vload8(0, dark + first);
        vstore8(value, 0, raw + first);
    } else {
        for (size_t i = first; i < count; i++)
            raw[i] = raw[i] - level - (framed ? dark[i] : 0.0f);
    }
}
