/* Parts of planar images [channel][row][col] to parts of others: tiles and what they are cut from. */

#ifndef NET_PART_COLS
#define NET_PART_COLS 64 /* of a work-item */
#endif

/* Work-item (run of columns, row and channel). Offsets, rows and channels of each side as distances in floats. */
__kernel void net_part(__global const float *from, ulong from_offset, ulong from_row, ulong from_channel,
                       __global float *to, ulong to_offset, ulong to_row, ulong to_channel, int rows, int cols)
{
    const int first = get_global_id(0) * NET_PART_COLS, last = min(first + NET_PART_COLS, cols);
    const ulong row = get_global_id(1) % rows, channel = get_global_id(1) / rows;
    __global const float *a = from + from_offset + row * from_row + channel * from_channel;
    __global float *b = to + to_offset + row * to_row + channel * to_channel;
    int x = first;
    for (; x + 8 <= last; x += 8)
        vstore8(vload8(0, a + x), 0, b + x);
    for (; x < last; x++)
        b[x] = a[x];
}
