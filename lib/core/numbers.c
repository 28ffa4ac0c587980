#include "core/numbers.h"

enum { BLOCK = 1024, LANES = 16 /* largest patterns side by side, of which compilers make vectors */ };

/* A float's bits without its sign: they rise with its magnitude, and of what is not finite they are INFINITE or more.
 */
static const int32_t INFINITE = 0x7f800000;

static int32_t pattern(const float *value)
{
    int32_t bits;
    memcpy(&bits, value, sizeof bits);
    return bits & 0x7fffffff;
}

static int32_t largest_pattern(const float *values, size_t count)
{
    int32_t lanes[LANES] = {0};
    size_t i = 0;
    for (; i + LANES <= count; i += LANES)
        for (size_t k = 0; k < LANES; k++)
            lanes[k] = hada_most(lanes[k], pattern(values + i + k));
    for (; i < count; i++)
        lanes[0] = hada_most(lanes[0], pattern(values + i));
    for (size_t k = 1; k < LANES; k++)
        lanes[0] = hada_most(lanes[0], lanes[k]);
    return lanes[0];
}

hada_status hada_distances_check(const double *distances_mm, int count, hada_error *err)
{
    for (int z = 0; distances_mm && z < count; z++)
        if (!(distances_mm[z] > (z ? distances_mm[z - 1] : 0.0) && isfinite(distances_mm[z])) &&
            !(count == 1 && distances_mm[z] == 0.0))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "distance %d is %g mm: distances must be above 0 and ascend from near to far", z,
                             distances_mm[z]);
    return HADA_OK;
}

size_t hada_not_finite(const float *values, size_t count, float *largest)
{
    size_t broken = 0;
    int32_t most = 0;
    for (size_t first = 0; first < count; first += BLOCK) {
        const size_t here = count - first < BLOCK ? count - first : BLOCK;
        const int32_t top = largest_pattern(values + first, here);
        if (top < INFINITE) {
            most = hada_most(most, top);
            continue;
        }
        for (size_t i = first; i < first + here; i++)
            if (pattern(values + i) >= INFINITE)
                broken++;
            else
                most = hada_most(most, pattern(values + i));
    }
    memcpy(largest, &most, sizeof *largest);
    return broken;
}

int hada_cholesky_factor(double *m, int n)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = m[i * n + j];
            for (int k = 0; k < j; k++)
                sum -= m[i * n + k] * m[j * n + k];
            if (i == j && !(sum > 0.0))
                return 0;
            m[i * n + j] = i == j ? sqrt(sum) : sum / m[j * n + j];
        }
    return 1;
}

void hada_cholesky_solve(const double *m, int n, double *x)
{
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            x[i] -= m[i * n + k] * x[k];
        x[i] /= m[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            x[i] -= m[k * n + i] * x[k];
        x[i] /= m[i * n + i];
    }
}
