#include "mpi_sum.h"

/* Values whose sums stand in the nearest cache while those of all ranks are added. */
enum { RUN = 512 };

/* Sums of all ranks in the order of their numbers, in double precision. */
/* NOLINTBEGIN(bugprone-macro-parentheses): a type cannot stand in parentheses */
#define DEFINE_ADD(type)                                                                                               \
    static void add_##type(type *out, const void *const *parts, size_t first, int ranks, size_t count)                 \
    {                                                                                                                  \
        double sums[RUN];                                                                                              \
        const type *part = (const type *)parts[0] + first;                                                             \
        for (size_t i = 0; i < count; i++)                                                                             \
            sums[i] = part[i];                                                                                         \
        for (int r = 1; r < ranks; r++) {                                                                              \
            part = (const type *)parts[r] + first;                                                                     \
            for (size_t i = 0; i < count; i++)                                                                         \
                sums[i] += part[i];                                                                                    \
        }                                                                                                              \
        for (size_t i = 0; i < count; i++)                                                                             \
            out[i] = (type)sums[i];                                                                                    \
    }
/* NOLINTEND(bugprone-macro-parentheses) */
DEFINE_ADD(double)
DEFINE_ADD(float)

void hada_mpi_add(size_t size, void *out, const void *const *parts, size_t first, int ranks, size_t count)
{
    for (size_t at = 0; at < count; at += RUN) {
        const size_t run = count - at < RUN ? count - at : RUN;
        if (size == sizeof(double))
            add_double((double *)out + at, parts, first + at, ranks, run);
        else
            add_float((float *)out + at, parts, first + at, ranks, run);
    }
}
