/* Copies channels and pixels of x to another place in y. Channel y_first + k of y takes channel x_first + k of x, for
 * k below `count`; pixel (r, c) of y takes (r - row, c - col) of x, or 0 where x has none. Blocks of y are counted from
 * the one that holds y_first. Other channels of y stay as they are; where the copy reaches y's last channel, the lanes
 * behind it become 0. */
#include "inc_layers.h"

__kernel void net_place(__global const float *x, __global float *y, hada_tensor_layout at_x, hada_tensor_layout at_y,
                        int blocks, int span, hada_placing to)
{
    const int x_rows = at_x.rows, x_cols = at_x.cols, rows = at_y.rows, cols = at_y.cols;
    const int row = to.row, col = to.col, x_first = to.x_first, y_first = to.y_first, count = to.count;
    const int accumulate = to.accumulate;
    net_part part = net_part_of(blocks, rows, span);
    part.block += y_first / NET_BLOCK;
    /* the lanes that this block of y takes; its first lane is channel `shift` of x from block `low` on */
    const net_lanes k = NET_LANE_NUMBERS + (part.block * NET_BLOCK - y_first);
    const int end = y_first + count == at_y.channels ? (y_first + count + NET_BLOCK - 1) / NET_BLOCK * NET_BLOCK : 0;
    const net_lanes copied = (k >= 0) & (k < count);
    const net_lanes written = copied | ((k >= count) & (k < end - y_first));
    const int from = part.block * NET_BLOCK - y_first + x_first, x_blocks = (at_x.channels + NET_BLOCK - 1) / NET_BLOCK;
    const int low = (from + NET_BLOCK) / NET_BLOCK - 1, shift = from - low * NET_BLOCK;
    const net_lanes from_low = NET_LANE_NUMBERS < NET_BLOCK - shift;
    const int whole = y_first <= part.block * NET_BLOCK && (part.block + 1) * NET_BLOCK <= max(y_first + count, end);
    const net_vector none = 0.0f;
    for (int r = part.first; r < part.last; r++) {
        const int x_row = r - row, inside = x_row >= 0 && x_row < x_rows;
        /* rows and blocks that x does not have are not copied; these places are inside it all the same */
        const int safe = clamp(x_row, 0, x_rows - 1), high = min(low + 1, x_blocks - 1);
        __global const float *a = x + net_row(at_x, part.image, max(low, 0), safe);
        __global const float *b = x + net_row(at_x, part.image, high, safe);
        __global float *out = y + net_row(at_y, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            const int x_col = c - col;
            net_vector v = none;
            if (inside && x_col >= 0 && x_col < x_cols) {
                v = net_get(a + x_col * NET_BLOCK + shift);
                if (shift) /* lanes of other pixels are not used; the halo makes them safe to read */
                    v = select(net_get(b + x_col * NET_BLOCK + shift - NET_BLOCK), v, from_low);
                v = select(none, v, copied);
            }
            if (accumulate)
                v += net_get(out + c * NET_BLOCK);
            else if (!whole)
                v = select(net_get(out + c * NET_BLOCK), v, written);
            net_put(v, out + c * NET_BLOCK);
        }
    }
}
