#include "mpi_sum.h"

/* Values whose sums stand in the nearest cache while those of all ranks are added. */
enum { RUN = 512 };

static void add_doubles(double *out, const void *const *parts, size_t first, int ranks, size_t count)
{
    double sums[RUN];
    const double *part = (const double *)parts[0] + first;
    for (size_t i = 0; i < count; i++)
        sums[i] = part[i];
    for (int r = 1; r < ranks; r++) {
        part = (const double *)parts[r] + first;
        for (size_t i = 0; i < count; i++)
            sums[i] += part[i];
    }
    for (size_t i = 0; i < count; i++)
        out[i] = sums[i];
}

static void add_floats(float *out, const void *const *parts, size_t first, int ranks, size_t count)
{
    double sums[RUN];
    const float *part = (const float *)parts[0] + first;
    for (size_t i = 0; i < count; i++)
        sums[i] = part[i];
    for (int r = 1; r < ranks; r++) {
        part = (const float *)parts[r] + first;
        for (size_t i = 0; i < count; i++)
            sums[i] += part[i];
    }
    for (size_t i = 0; i < count; i++)
        out[i] = (float)sums[i];
}

void hada_mpi_add(size_t size, void *out, const void *const *parts, size_t first, int ranks, size_t count)
{
    for (size_t at = 0; at < count; at += RUN) {
        const size_t run = count - at < RUN ? count - at : RUN;
        if (size == sizeof(double))
            add_doubles((double *)out + at, parts, first + at, ranks, run);
        else
            add_floats((float *)out + at, parts, first + at, ranks, run);
    }
}
