/* How much light stands where: the largest magnitude over all channels in cells of one row by `cell` columns of planar
 * images [channel][row][col], so that parts of an image without any can be left out. */

/* Work-item (cell, row); out[row][cell], `cells` in a row. */
__kernel void net_content(__global const float *image, ulong offset, int channels, int rows, int cols, int cell,
                          int cells, __global float *out)
{
    const int which = get_global_id(0), row = get_global_id(1);
    if (which < cells) {
        const int first = which * cell, last = min(first + cell, cols);
        float8 most = 0.0f;
        for (int c = 0; c < channels; c++) {
            __global const float *p = image + offset + ((size_t)c * rows + row) * cols;
            int x = first;
            for (; x + 8 <= last; x += 8)
                most = max(most, fabs(vload8(0, p + x)));
            for (; x < last; x++)
                most.s0 = max(most.s0, fabs(p[x]));
        }
        const float4 four = max(most.lo, most.hi);
        const float2 two = max(four.lo, four.hi);
        out[(size_t)row * cells + which] = max(two.x, two.y);
    }
}
