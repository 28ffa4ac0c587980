/* Takes the dark level, and a dark frame where there is one, off the pixels of a channel, which begin at `offset`. An
 * item takes eight pixels. */
__kernel void filter_dark(__global float *raw, __global const float *dark, ulong offset, int framed, float level,
                          ulong count)
{
    __global float *pixels = raw + offset;
    __global const float *background = dark + offset;
    const size_t first = get_global_id(0) * 8;
    if (first + 8 <= count) {
        float8 value = vload8(0, pixels + first) - level;
        if (framed)
            value -= vload8(0, background + first);
        vstore8(value, 0, pixels + first);
    } else {
        for (size_t i = first; i < count; i++)
            pixels[i] = pixels[i] - level - (framed ? background[i] : 0.0f);
    }
}
