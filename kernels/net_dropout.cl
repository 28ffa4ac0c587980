/* Dropout on tensors in blocks of channels: y = x * scale where a random number of 24 bits is at least the threshold, 0
 * elsewhere.
 *
 * The numbers come from Philox4x32 with 7 rounds: the key is the seed (its upper half mixed with that of the step), the
 * counter (four pixels of a row, channel, image, step); the four words of a call are for the four pixels. */
#include "inc_layers.h"
#define PHILOX_BITS net_bits
#include "inc_philox.h"

__kernel void net_dropout(__global const float *x, __global float *y, hada_tensor_layout at_x, hada_tensor_layout at_y,
                          int span, hada_dropout_draw draw)
{
    const int rows = at_x.rows, cols = at_x.cols;
    const net_part part = net_part_of(at_x.blocks, rows, span);
    const int quads = (cols + 3) / 4;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        __global float *out = y + net_row(at_y, part.image, part.block, r);
        NET_EACH_PIXEL (quad, quads) {
            net_bits word[4];
            word[0] = (net_bits)(uint)(r * quads + quad);
            word[1] = NET_AS_BITS(NET_LANE_NUMBERS + part.block * NET_BLOCK);
            word[2] = (net_bits)(uint)part.image;
            word[3] = (net_bits)draw.step;
            philox(word, 7, draw.key0, draw.key1);
            for (int k = 0; k < min(4, cols - 4 * quad); k++) {
                const int at = (4 * quad + k) * NET_BLOCK;
                const net_vector v = draw.scale * net_get(in + at);
                net_put(select((net_vector)0.0f, v, (word[k] >> 8) >= draw.threshold), out + at);
            }
        }
    }
}
