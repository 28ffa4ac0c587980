#include "ref/ref_light.h"

void hada_ref_light(const float *in, const float *gain, int rows, int cols, int strips, const int *last, int wide,
                    double *out)
{
    const int groups = cols / 2 / wide + 1;
    for (int i = 0; i < strips * groups; i++)
        out[i] = 0.0;
    for (int ky = 0; ky < rows; ky++)
        for (int kx = 0; kx <= cols / 2; kx++, in += 2, gain++) {
            const int distance = ky < rows - ky ? ky : rows - ky, once = kx == 0 || 2 * kx == cols;
            int strip = 0;
            while (last[strip] < distance)
                strip++;
            out[strip * groups + kx / wide] +=
                (once ? 1.0 : 2.0) * *gain * ((double)in[0] * in[0] + (double)in[1] * in[1]);
        }
}
