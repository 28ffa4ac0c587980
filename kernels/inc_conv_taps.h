/* Taps of a convolution, for the device and the host alike. */
#ifndef INC_CONV_TAPS_H
#define INC_CONV_TAPS_H

/* Which of a kernel's taps meet the pixels of one phase. Output pixel R = step * r + phase takes input r + first + t
 * with taps t = 0 ... count - 1; of the kernel that is place u = u0 - step * t, where `pad` is counted as for a
 * transposed convolution. */
typedef struct conv_taps {
    int count, first, u0;
} conv_taps;

static inline conv_taps conv_taps_of(int kernel_size, int pad, int step, int phase)
{
    const int over = (kernel_size - 1 - phase - pad) % step;
    conv_taps taps;
    taps.u0 = kernel_size - 1 - (over < 0 ? over + step : over);
    taps.count = taps.u0 < 0 ? 0 : taps.u0 / step + 1;
    taps.first = (phase + pad - taps.u0) / step;
    return taps;
}

#endif
