/* Dropout: y = x * scale where a random number of 24 bits is at least `threshold`, 0 elsewhere.
 *
 * The numbers come from Philox4x32 with 7 rounds: the key is the seed (its upper half mixed with that of the
 * step), the counter (four pixels of a row, channel, image, step); the four words that it makes serve the pixels. */
#include "inc_layers.h"
#define PHILOX_BITS net_bits
#include "inc_philox.h"

__kernel void net_dropout(__global const float *x, ulong x_offset, ulong x_image, __global float *y, ulong y_offset,
                          ulong y_image, int rows, int cols, int blocks, int span, uint key0, uint key1, uint step,
                          uint threshold, float scale)
{
    const net_part part = net_part_of(blocks, rows, span);
    const int quads = (cols + 3) / 4;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(x_offset, x_image, part.image, part.block, r, rows, cols);
        __global float *out = y + net_row(y_offset, y_image, part.image, part.block, r, rows, cols);
        NET_EACH_PIXEL (quad, quads) {
            net_bits word[4];
            word[0] = (net_bits)(uint)(r * quads + quad);
            word[1] = NET_AS_BITS(NET_LANE_NUMBERS + part.block * NET_BLOCK);
            word[2] = (net_bits)(uint)part.image;
            word[3] = (net_bits)step;
            philox(word, 7, key0, key1);
            for (int k = 0; k < min(4, cols - 4 * quad); k++) {
                const int at = (4 * quad + k) * NET_BLOCK;
                const net_vector v = scale * net_get(in + at);
                net_put(select((net_vector)0.0f, v, (word[k] >> 8) >= threshold), out + at);
            }
        }
    }
}
