#include "check_fit.h"

static void make_room(check_state *state, check_fit *fit)
{
    fit->x = check_room(state, 16 * fit->vectors * sizeof(float));
    fit->b = check_room(state, 16 * fit->vectors * sizeof(float));
    fit->sums = check_room(state, HADA_REF_FIT_SUMS * fit->count * sizeof(double));
    fit->other = check_room(state, 2 * fit->count * sizeof(double));
    fit->device_sums = check_room(state, (2 * (size_t)fit->kept * fit->stride) * sizeof(float));
    fit->device_pool = check_room(state, 5 * fit->stride * sizeof(float));
}

/* The device's arrays, and the double ones brought to what these hold. */
static void to_device(check_fit *fit, int pairs)
{
    const size_t n = fit->count;
    static const int pooled[5] = {2, 2, 3, 5, 5};
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < (size_t)fit->kept; k++) {
            float *to = fit->device_sums + 2 * k * fit->stride + i;
            to[0] = (float)fit->sums[k * n + i];
            to[fit->stride] = (float)(fit->sums[k * n + i] - to[0]);
            fit->sums[k * n + i] = (double)to[0] + to[fit->stride];
        }
        for (size_t k = 0; k < 5; k++) {
            const double both = fit->sums[(size_t)pooled[k] * n + i] + fit->other[(k > 2 ? n : 0) + i];
            fit->device_pool[k * fit->stride + i] = (float)(k == 0 || k == 3 ? both : both / pairs);
        }
    }
}

void check_fit_make(check_fit *fit, check_state *state, size_t count, int pairs, int split)
{
    const size_t vectors = (count + 7) / 8;
    *fit = (check_fit){.count = count,
                       .vectors = vectors,
                       .stride = (vectors + 63) / 64 * 64 * 8,
                       .split = split,
                       .kept = split ? 6 : 4};
    make_room(state, fit);
    double *values = check_room(state, 4 * count * sizeof *values);
    double *rest = check_room(state, HADA_REF_FIT_SUMS * count * sizeof *rest);
    for (int p = 0; p < 2 * pairs; p++) { /* those of the other depth come first */
        check_fill_normal(state, 100 + 2 * (uint64_t)p, fit->x, 2 * count);
        check_fill_normal(state, 101 + 2 * (uint64_t)p, fit->b, 2 * count);
        for (size_t i = 0; i < 2 * count; i++) {
            values[i] = fit->x[i];
            values[2 * count + i] = fit->b[i] += 0.5f * fit->x[i];
        }
        hada_ref_fit_pair(values, values + 2 * count, count, 1.0, p < pairs ? rest : fit->sums);
    }
    for (size_t i = 0; i < count; i++) {
        fit->other[i] = rest[2 * count + i];
        fit->other[count + i] = rest[5 * count + i];
    }
    to_device(fit, pairs);
}

hada_fit_image check_fit_image(const check_fit *fit, size_t n)
{
    const size_t chunks = hada_divide_up(fit->vectors, HADA_FIT_CHUNK);
    return (hada_fit_image){.first = n * fit->count,
                            .count = fit->count,
                            .vectors = fit->vectors,
                            .stride = fit->stride,
                            .chunks = chunks,
                            .partial = n * chunks};
}
