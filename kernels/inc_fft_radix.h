/* Butterflies: forward discrete Fourier transforms of 2, 3, 4, 5, 7 and 8 values in registers, in place and in
 * natural order. re[] and im[] hold FFT_V: float8 where a work-item carries eight transforms side by side, float where
 * work-items share one. Odd lengths use the symmetry of cosine and sine: sums and differences of x[k] and x[p-k]. */
#ifndef INC_FFT_RADIX_H
#define INC_FFT_RADIX_H

#ifndef FFT_V
#define FFT_V float8
#endif
#define FFT_INLINE static inline __attribute__((always_inline))

/* Written-out loops over the values of a butterfly of radix R, M(0) M(1) ..., and over those with twiddle factors:
 * compilers do not reliably unroll loops, and re[] and im[] must live in registers. */
#define FFT_AFTER_FIRST_1(M)
#define FFT_AFTER_FIRST_2(M) M(1)
#define FFT_AFTER_FIRST_3(M) FFT_AFTER_FIRST_2(M) M(2)
#define FFT_AFTER_FIRST_4(M) FFT_AFTER_FIRST_3(M) M(3)
#define FFT_AFTER_FIRST_5(M) FFT_AFTER_FIRST_4(M) M(4)
#define FFT_AFTER_FIRST_7(M) FFT_AFTER_FIRST_5(M) M(5) M(6)
#define FFT_AFTER_FIRST_8(M) FFT_AFTER_FIRST_7(M) M(7)
#define FFT_EACH(R, M)       M(0) FFT_AFTER_FIRST_##R(M)

/* Radices of the stages that a table may ask for: functions NAME2 ... NAME8 made by M, and their cases in a switch. */
#define FFT_EACH_RADIX(M) M(2) M(3) M(4) M(5) M(7) M(8)
#define FFT_CASE(name, radix, arguments)                                                                               \
    case radix:                                                                                                        \
        name##radix arguments;                                                                                         \
        break;
#define FFT_CASES(name, arguments)                                                                                     \
    FFT_CASE(name, 2, arguments)                                                                                       \
    FFT_CASE(name, 3, arguments)                                                                                       \
    FFT_CASE(name, 4, arguments)                                                                                       \
    FFT_CASE(name, 5, arguments)                                                                                       \
    FFT_CASE(name, 7, arguments)                                                                                       \
    FFT_CASE(name, 8, arguments)

/* (re, im) *= c + i d */
FFT_INLINE void fft_times_twiddle(FFT_V *re, FFT_V *im, float c, float d)
{
    const FFT_V a = *re;
    *re = fma(a, (FFT_V)c, -(*im * d));
    *im = fma(a, (FFT_V)d, *im * c);
}

FFT_INLINE void fft_radix2(FFT_V *re, FFT_V *im)
{
    const FFT_V a = re[0], b = im[0];
    re[0] = a + re[1];
    im[0] = b + im[1];
    re[1] = a - re[1];
    im[1] = b - im[1];
}

FFT_INLINE void fft_radix3(FFT_V *re, FFT_V *im)
{
    const FFT_V s = 0.866025403784438647f;
    const FFT_V ar = re[1] + re[2], ai = im[1] + im[2], br = re[1] - re[2], bi = im[1] - im[2];
    const FFT_V cr = fma(ar, (FFT_V)-0.5f, re[0]), ci = fma(ai, (FFT_V)-0.5f, im[0]);
    re[0] += ar;
    im[0] += ai;
    re[1] = fma(bi, s, cr);
    im[1] = fma(br, -s, ci);
    re[2] = fma(bi, -s, cr);
    im[2] = fma(br, s, ci);
}

/* A butterfly of radix 4 on any numbers or vectors V. */
#define FFT_RADIX4(name, V)                                                                                            \
    FFT_INLINE void name(V *re, V *im)                                                                                 \
    {                                                                                                                  \
        const V ar = re[0] + re[2], ai = im[0] + im[2], br = re[0] - re[2], bi = im[0] - im[2];                        \
        const V cr = re[1] + re[3], ci = im[1] + im[3], dr = re[1] - re[3], di = im[1] - im[3];                        \
        re[0] = ar + cr;                                                                                               \
        im[0] = ai + ci;                                                                                               \
        re[1] = br + di;                                                                                               \
        im[1] = bi - dr;                                                                                               \
        re[2] = ar - cr;                                                                                               \
        im[2] = ai - ci;                                                                                               \
        re[3] = br - di;                                                                                               \
        im[3] = bi + dr;                                                                                               \
    }

FFT_RADIX4(fft_radix4, FFT_V)

FFT_INLINE void fft_radix5(FFT_V *re, FFT_V *im)
{
    const FFT_V c1 = 0.309016994374947424f, c2 = -0.809016994374947424f;
    const FFT_V s1 = 0.951056516295153572f, s2 = 0.587785252292473129f;
    const FFT_V a1r = re[1] + re[4], a1i = im[1] + im[4], b1r = re[1] - re[4], b1i = im[1] - im[4];
    const FFT_V a2r = re[2] + re[3], a2i = im[2] + im[3], b2r = re[2] - re[3], b2i = im[2] - im[3];
    const FFT_V p1r = fma(a2r, c2, fma(a1r, c1, re[0])), p1i = fma(a2i, c2, fma(a1i, c1, im[0]));
    const FFT_V p2r = fma(a2r, c1, fma(a1r, c2, re[0])), p2i = fma(a2i, c1, fma(a1i, c2, im[0]));
    const FFT_V q1r = fma(b2r, s2, b1r * s1), q1i = fma(b2i, s2, b1i * s1);
    const FFT_V q2r = fma(b2r, -s1, b1r * s2), q2i = fma(b2i, -s1, b1i * s2);
    re[0] += a1r + a2r;
    im[0] += a1i + a2i;
    re[1] = p1r + q1i;
    im[1] = p1i - q1r;
    re[4] = p1r - q1i;
    im[4] = p1i + q1r;
    re[2] = p2r + q2i;
    im[2] = p2i - q2r;
    re[3] = p2r - q2i;
    im[3] = p2i + q2r;
}

FFT_INLINE void fft_radix7(FFT_V *re, FFT_V *im)
{
    const float c[3] = {0.623489801858733531f, -0.222520933956314404f, -0.900968867902419126f};
    const float s[3] = {0.781831482468029809f, 0.974927912181823607f, 0.433883739117558120f};
    FFT_V ar[3], ai[3], br[3], bi[3];
#pragma unroll
    for (int k = 0; k < 3; ++k) {
        ar[k] = re[1 + k] + re[6 - k];
        ai[k] = im[1 + k] + im[6 - k];
        br[k] = re[1 + k] - re[6 - k];
        bi[k] = im[1 + k] - im[6 - k];
    }
    const FFT_V x = re[0], y = im[0];
    re[0] += ar[0] + ar[1] + ar[2];
    im[0] += ai[0] + ai[1] + ai[2];
#pragma unroll
    for (int m = 1; m <= 3; ++m) {
        FFT_V pr = x, pi = y, qr = (FFT_V)0.0f, qi = (FFT_V)0.0f;
#pragma unroll
        for (int k = 1; k <= 3; ++k) {
            const int t = m * k % 7;
            const FFT_V cosine = c[(t < 4 ? t : 7 - t) - 1], sine = t < 4 ? s[t - 1] : -s[6 - t];
            pr = fma(ar[k - 1], cosine, pr);
            pi = fma(ai[k - 1], cosine, pi);
            qr = fma(br[k - 1], sine, qr);
            qi = fma(bi[k - 1], sine, qi);
        }
        re[m] = pr + qi;
        im[m] = pi - qr;
        re[7 - m] = pr - qi;
        im[7 - m] = pi + qr;
    }
}

FFT_INLINE void fft_radix8(FFT_V *re, FFT_V *im)
{
    const FFT_V h = 0.707106781186547524f;
    FFT_V even_re[4] = {re[0], re[2], re[4], re[6]}, even_im[4] = {im[0], im[2], im[4], im[6]};
    FFT_V odd_re[4] = {re[1], re[3], re[5], re[7]}, odd_im[4] = {im[1], im[3], im[5], im[7]};
    fft_radix4(even_re, even_im);
    fft_radix4(odd_re, odd_im);
    const FFT_V ur = (odd_re[1] + odd_im[1]) * h, ui = (odd_im[1] - odd_re[1]) * h;
    const FFT_V vr = (odd_im[3] - odd_re[3]) * h, vi = (odd_re[3] + odd_im[3]) * h; /* minus vi */
    re[0] = even_re[0] + odd_re[0];
    im[0] = even_im[0] + odd_im[0];
    re[4] = even_re[0] - odd_re[0];
    im[4] = even_im[0] - odd_im[0];
    re[1] = even_re[1] + ur;
    im[1] = even_im[1] + ui;
    re[5] = even_re[1] - ur;
    im[5] = even_im[1] - ui;
    re[2] = even_re[2] + odd_im[2];
    im[2] = even_im[2] - odd_re[2];
    re[6] = even_re[2] - odd_im[2];
    im[6] = even_im[2] + odd_re[2];
    re[3] = even_re[3] + vr;
    im[3] = even_im[3] - vi;
    re[7] = even_re[3] - vr;
    im[7] = even_im[3] + vi;
}

#endif
