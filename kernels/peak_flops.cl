/* The peak float32 rate of a device: chains of fused multiply-adds in registers, enough of them side by side to hide
 * their latency. Each work-item makes PEAK_WIDTH * HADA_PEAK_CHAINS chains of `rounds` steps v = v * factor + term from
 * small integers, and stores the sums of the chains: out[item * PEAK_WIDTH + lane]. */
#include "shared_peaks.h"

#ifndef PEAK_WIDTH
#define PEAK_WIDTH 8
#endif
#define PEAK_JOIN(name, width) name##width
#define PEAK_VECTOR(width)     PEAK_JOIN(float, width)
#define PEAK_STORE(width)      PEAK_JOIN(vstore, width)
typedef PEAK_VECTOR(PEAK_WIDTH) peak_vector;

__kernel void peak_flops(__global float *out, float factor, float term, int rounds)
{
    const int item = get_global_id(0);
    const peak_vector f = (peak_vector)factor, t = (peak_vector)term;
    peak_vector v[HADA_PEAK_CHAINS];
#pragma unroll
    for (int k = 0; k < HADA_PEAK_CHAINS; k++)
        v[k] = (peak_vector)((float)(k + item % 16));
    for (int round = 0; round < rounds; round++) {
#pragma unroll
        for (int k = 0; k < HADA_PEAK_CHAINS; k++)
            v[k] = fma(v[k], f, t);
    }
    peak_vector sum = (peak_vector)0.0f;
#pragma unroll
    for (int k = 0; k < HADA_PEAK_CHAINS; k++)
        sum += v[k];
    PEAK_STORE(PEAK_WIDTH)(sum, item, out);
}
