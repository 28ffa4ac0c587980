/* Weights in the order in which the kernels of convolutions read them. */
#define CONV_MEM __global
#include "inc_conv_winograd.h"

/* Output and input channels of a work-item: 1, or 8 where a CPU's vectors hold them (shape lanes). */
#ifndef CONV_PACK
#define CONV_PACK 1
#endif
#if CONV_PACK == 8
typedef float8 conv_pack_v;
#define CONV_PACK_STORE(v, p) VECTORS_STORE8(__global, v, p)
#else
typedef float conv_pack_v;
#define CONV_PACK_STORE(v, p) (*(p) = (v))
#endif

/* Where the kernels of a work-item's pairs of channels stand: CONV_PACK output channels, `out_step` floats apart. Those
 * beyond the last of `present` are read as the last, and then made zero. */
typedef struct conv_kernels {
    __global const float *first;
    size_t out_step;
    int present;
} conv_kernels;

static inline conv_kernels conv_kernels_of(__global const float *w, int in, int in_channels, int out_channels,
                                           int to_coarse, int places)
{
    const int out = get_global_id(0) * CONV_PACK;
    conv_kernels kernels;
    kernels.out_step = (size_t)(to_coarse ? in_channels : 1) * places;
    kernels.present = in < in_channels ? clamp(out_channels - out, 0, CONV_PACK) : 0;
    kernels.first = w;
    if (kernels.present)
        kernels.first += out * kernels.out_step + (size_t)in * (to_coarse ? 1 : out_channels) * places;
    return kernels;
}

/* One place of all of them. */
static inline conv_pack_v conv_kernels_at(const conv_kernels *kernels, int place)
{
#if CONV_PACK == 8
    const __global float *at = kernels->first + place;
    const size_t step = kernels->out_step;
    const int last = kernels->present - 1;
    if (last == 7)
        return (float8)(at[0], at[step], at[2 * step], at[3 * step], at[4 * step], at[5 * step], at[6 * step],
                        at[7 * step]);
    float lanes[8];
    for (int k = 0; k < 8; ++k)
        lanes[k] = k <= last ? at[k * step] : 0.0f;
    return vload8(0, lanes);
#else
    return kernels->present ? kernels->first[place] : 0.0f;
#endif
}

#if CONV_PACK == 8
/* The rows i and i + 4 interleaved: three times this transposes 8 rows of 8. */
static inline void conv_interleave(const float8 *from, float8 *to)
{
#pragma unroll
    for (int i = 0; i < 4; ++i) {
        const float8 a = from[i], b = from[i + 4];
        to[2 * i] = (float8)(a.s0, b.s0, a.s1, b.s1, a.s2, b.s2, a.s3, b.s3);
        to[2 * i + 1] = (float8)(a.s4, b.s4, a.s5, b.s5, a.s6, b.s6, a.s7, b.s7);
    }
}
#endif

/* All nine places of kernels of 3 x 3. */
static inline void conv_kernels_nine(const conv_kernels *kernels, conv_pack_v *nine)
{
#if CONV_PACK == 8
    if (kernels->present == 8) {
        float8 rows[8], columns[8];
#pragma unroll
        for (int k = 0; k < 8; ++k)
            rows[k] = vload8(0, kernels->first + k * kernels->out_step);
        conv_interleave(rows, columns);
        conv_interleave(columns, rows);
        conv_interleave(rows, nine);
        nine[8] = conv_kernels_at(kernels, 8);
        return;
    }
#endif
#pragma unroll
    for (int i = 0; i < 9; ++i)
        nine[i] = conv_kernels_at(kernels, i);
}

/* Weights for direct convolutions, from w[coarse][fine][kernel row][kernel column]
 * (lib/net/conv.h): [phase][group][input block][tap row][tap column][input channel of the block][output channel of the
 * group], zero where there is no such channel. Phases and taps: inc_conv.h. Dimensions: output channels of all groups,
 * input channels of all blocks, CONV_PACK of each to a work-item. */
__kernel void conv_pack(__global const float *w, __global float *packed, hada_conv_problem problem, ulong w_offset,
                        int block, int lanes)
{
    const int in_channels = problem.in.channels, out_channels = problem.out.channels;
    const int to_coarse = problem.to_coarse, kernel_rows = problem.kernel_rows, kernel_cols = problem.kernel_cols;
    const int pad_rows = problem.pad_rows, pad_cols = problem.pad_cols, step = problem.step;
    const int out = get_global_id(0) * CONV_PACK, first = get_global_id(1) * CONV_PACK;
    const int in_blocks = (in_channels + block - 1) / block, groups = get_global_size(0) * CONV_PACK / lanes;
    const int places = kernel_rows * kernel_cols;
    const size_t tap_floats = (size_t)block * lanes, taps_rows = (kernel_rows + step - 1) / step;
    const size_t group_floats = taps_rows * ((kernel_cols + step - 1) / step) * in_blocks * tap_floats;
    for (int in = first; in < first + CONV_PACK; ++in) {
        const conv_kernels kernels = conv_kernels_of(w + w_offset, in, in_channels, out_channels, to_coarse, places);
        __global float *at = packed + (size_t)(in % block) * lanes + out % lanes;
        /* a convolution's taps run in the order of its kernel, those of a transposed one in the opposite order */
        if (places == 9 && step == 1) {
            conv_pack_v nine[9];
            __global float *to = at + out / lanes * group_floats + in / block * 9 * tap_floats;
            conv_kernels_nine(&kernels, nine);
#pragma unroll
            for (int i = 0; i < 9; ++i)
                CONV_PACK_STORE(nine[i], to + (to_coarse ? i : 8 - i) * tap_floats);
            continue;
        }
        for (int phase = 0; phase < step * step; ++phase) {
            const hada_conv_taps rows = hada_conv_taps_of(kernel_rows, pad_rows, step, phase / step);
            const hada_conv_taps cols = hada_conv_taps_of(kernel_cols, pad_cols, step, phase % step);
            __global float *to = at + ((size_t)phase * groups + out / lanes) * group_floats +
                                 (size_t)(in / block) * rows.count * cols.count * tap_floats;
            for (int r = 0; r < rows.count; ++r)
                for (int c = 0; c < cols.count; ++c) {
                    const int u = to_coarse ? r : rows.u0 - step * r, v = to_coarse ? c : cols.u0 - step * c;
                    CONV_PACK_STORE(conv_kernels_at(&kernels, u * kernel_cols + v),
                                    to + (r * cols.count + c) * tap_floats);
                }
        }
    }
}

/* Whether to build the packing for Winograd's products, which groups do not use. */
#ifndef CONV_WINOGRAD
#define CONV_WINOGRAD 1
#endif
#if CONV_WINOGRAD
/* One dimension of the weights' transform: o = G g. */
static inline void conv_weights_1d(const conv_pack_v *g, int step, conv_pack_v *o)
{
    const conv_pack_v a = g[0], b = g[step], c = g[2 * step];
    const conv_pack_v s = (a + c) * (1.0f / 6.0f), q = fma(c, (conv_pack_v)(1.0f / 6.0f), a * (1.0f / 24.0f));
    o[0] = 0.25f * a;
    o[1] = -s - b * (1.0f / 6.0f);
    o[2] = -s + b * (1.0f / 6.0f);
    o[3] = q + b * (1.0f / 12.0f);
    o[4] = q - b * (1.0f / 12.0f);
    o[5] = c;
}

/* Weights for Winograd's F(4 x 4, 3 x 3): G g G^T for each pair of channels, [place][group][input channel of all
 * blocks] [output channel of the group], zero where there is no such channel. Arguments as in conv_pack; the way to
 * fine takes the kernel mirrored. Dimensions as in conv_pack. */
__kernel void conv_winograd_pack(__global const float *w, __global float *packed, ulong w_offset, int in_channels,
                                 int out_channels, int to_coarse, int lanes)
{
    const int out = get_global_id(0) * CONV_PACK, first = get_global_id(1) * CONV_PACK;
    const size_t ins = get_global_size(1) * CONV_PACK, place = get_global_size(0) * CONV_PACK * ins;
    for (int in = first; in < first + CONV_PACK; ++in) {
        const conv_kernels kernels = conv_kernels_of(w + w_offset, in, in_channels, out_channels, to_coarse, 9);
        __global float *to = packed + (out / lanes * ins + in) * lanes + out % lanes;
        conv_pack_v g[9], across[3 * CONV_REACH];
        conv_kernels_nine(&kernels, g);
        for (int r = 0; r < 3; ++r)
            conv_weights_1d(to_coarse ? g + 3 * r : g + 8 - 3 * r, to_coarse ? 1 : -1, across + CONV_REACH * r);
        for (int c = 0; c < CONV_REACH; ++c) {
            conv_pack_v down[CONV_REACH];
            conv_weights_1d(across + c, CONV_REACH, down);
            for (int r = 0; r < CONV_REACH; ++r)
                CONV_PACK_STORE(down[r], to + (r * CONV_REACH + c) * place);
        }
    }
}
#endif
