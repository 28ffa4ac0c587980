/* Butterflies of radix 6, 12, 16 and 43 for inc_fft_sized.h. */
#ifndef INC_FFT_RADIX_LARGE_H
#define INC_FFT_RADIX_LARGE_H

#include "inc_fft_radix.h"
#include "shared_fft_sizes.h"

/* 2 x 3 by the Chinese remainder theorem (Good 1958): no twiddle factors between. */
FFT_INLINE void fft_radix6(FFT_V *re, FFT_V *im)
{
    FFT_V a_re[3] = {re[0], re[2], re[4]}, a_im[3] = {im[0], im[2], im[4]};
    FFT_V b_re[3] = {re[3], re[5], re[1]}, b_im[3] = {im[3], im[5], im[1]};
    fft_radix3(a_re, a_im);
    fft_radix3(b_re, b_im);
#pragma unroll
    for (int k = 0; k < 3; ++k) { /* output 3 j + 4 k mod 6 */
        re[4 * k % 6] = a_re[k] + b_re[k];
        im[4 * k % 6] = a_im[k] + b_im[k];
        re[(4 * k + 3) % 6] = a_re[k] - b_re[k];
        im[(4 * k + 3) % 6] = a_im[k] - b_im[k];
    }
}

/* 4 x 3, likewise. */
FFT_INLINE void fft_radix12(FFT_V *re, FFT_V *im)
{
    FFT_V x[12], y[12];
#pragma unroll
    for (int j = 0; j < 3; ++j) { /* inputs 3 i + 4 j mod 12 */
        FFT_V a[4] = {re[4 * j], re[(3 + 4 * j) % 12], re[(6 + 4 * j) % 12], re[(9 + 4 * j) % 12]};
        FFT_V b[4] = {im[4 * j], im[(3 + 4 * j) % 12], im[(6 + 4 * j) % 12], im[(9 + 4 * j) % 12]};
        fft_radix4(a, b);
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            x[3 * k + j] = a[k];
            y[3 * k + j] = b[k];
        }
    }
#pragma unroll
    for (int k = 0; k < 4; ++k) {
        fft_radix3(x + 3 * k, y + 3 * k);
#pragma unroll
        for (int j = 0; j < 3; ++j) { /* output 9 k + 4 j mod 12 */
            re[(9 * k + 4 * j) % 12] = x[3 * k + j];
            im[(9 * k + 4 * j) % 12] = y[3 * k + j];
        }
    }
}

/* 4 x 4; c + i s: the twiddle factors exp(-2 pi i t / 16). */
FFT_INLINE void fft_radix16(FFT_V *re, FFT_V *im)
{
    const float a1 = 0.923879532511286756f, a2 = 0.707106781186547524f, a3 = 0.382683432365089772f;
    const float c[10] = {1.0f, a1, a2, a3, 0.0f, 0.0f, -a2, 0.0f, 0.0f, -a1};
    const float s[10] = {0.0f, -a3, -a2, -a1, -1.0f, 0.0f, -a2, 0.0f, 0.0f, a3};
    FFT_V x[16], y[16];
#pragma unroll
    for (int j = 0; j < 4; ++j) {
        FFT_V a[4] = {re[j], re[j + 4], re[j + 8], re[j + 12]}, b[4] = {im[j], im[j + 4], im[j + 8], im[j + 12]};
        fft_radix4(a, b);
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            const int t = j * k;
            if (t == 4) { /* times -i */
                x[4 * k + j] = b[k];
                y[4 * k + j] = -a[k];
            } else {
                if (t)
                    fft_times_twiddle(&a[k], &b[k], c[t], s[t]);
                x[4 * k + j] = a[k];
                y[4 * k + j] = b[k];
            }
        }
    }
#pragma unroll
    for (int k = 0; k < 4; ++k) {
        fft_radix4(x + 4 * k, y + 4 * k);
#pragma unroll
        for (int j = 0; j < 4; ++j) {
            re[k + 4 * j] = x[4 * k + j];
            im[k + 4 * j] = y[4 * k + j];
        }
    }
}

/* Radix 43 by its definition, with the symmetry of cosine and sine: 41 multiply-adds a point, which a convolution of 42
 * points (Rader 1968) with two transforms of 2 x 3 x 7 would need as well, and order its points beside. In two halves:
 * sums a[k] = x[k] + x[43 - k] in the place of x[k] and differences b[k] = x[k] - x[43 - k] in that of x[43 - k]; then
 *     X[m], X[43 - m] = x[0] + sum a[k] cos(2 pi m k / 43)  -+  i sum b[k] sin(2 pi m k / 43). */
#define FFT_ODD_PAIRS 21

__constant float fft_odd_cosine[FFT_ODD_PAIRS + 1] = {
    1.0f,
    0.989343368075110252f,
    0.957600599908405958f,
    0.905448237493146624f,
    0.833997817889877924f,
    0.744772182743781874f,
    0.639673021558891275f,
    0.520940340487930253f,
    0.391104720490155988f,
    0.252933382391680672f,
    0.109371208377874521f,
    -0.0365220230576585037f,
    -0.181636850979436354f,
    -0.322880404771446361f,
    -0.457242323304638487f,
    -0.581858915557952661f,
    -0.69407419522063396f,
    -0.791496488429254019f,
    -0.872049408143807714f,
    -0.934016108732547923f,
    -0.976075877555927063f,
    -0.997332283663551644f,
};
__constant float fft_odd_sine[FFT_ODD_PAIRS + 1] = {
    0.0f,
    0.145601167735004866f,
    0.288099099365237588f,
    0.424456698875815053f,
    0.55176774077044588f,
    0.66731881122223935f,
    0.768647139778532051f,
    0.853593089037346431f,
    0.920346183569159426f,
    0.967483697057425318f,
    0.994000975239945905f,
    0.999332848370239391f,
    0.983365676829466184f,
    0.946439773157609299f,
    0.889342148882518946f,
    0.813289740735565481f,
    0.719903473757995793f,
    0.611173714097849374f,
    0.489417847811085438f,
    0.357230889801132878f,
    0.21743017558155725f,
    0.0729953146609075565f,
};

FFT_INLINE void fft_odd_fold(FFT_V *re, FFT_V *im)
{
#pragma unroll
    for (int k = 1; k <= FFT_ODD_PAIRS; ++k) {
        const FFT_V x = re[k], y = im[k];
        re[k] = x + re[FFT_ODD_RADIX - k];
        im[k] = y + im[FFT_ODD_RADIX - k];
        re[FFT_ODD_RADIX - k] = x - re[FFT_ODD_RADIX - k];
        im[FFT_ODD_RADIX - k] = y - im[FFT_ODD_RADIX - k];
    }
}

/* The real parts of X[m] and X[43 - m] from the real parts of sums and the imaginary ones of differences; with parts
 * changed over, the imaginary parts of X[43 - m] and X[m]. m = 0: both are X[0]. */
FFT_INLINE float2 fft_odd_part(const float *sums, const float *differences, int m)
{
    float p = sums[0], q = 0.0f;
#pragma unroll
    for (int k = 1; k <= FFT_ODD_PAIRS; ++k) {
        const int t = m * k % FFT_ODD_RADIX, u = t <= FFT_ODD_PAIRS ? t : FFT_ODD_RADIX - t;
        p = fma(sums[k], fft_odd_cosine[u], p);
        if (m)
            q = fma(differences[FFT_ODD_RADIX - k], t == u ? fft_odd_sine[u] : -fft_odd_sine[u], q);
    }
    return (float2)(p + q, p - q);
}

#endif
