#include "bench_stats.h"

#include <math.h>
#include <stdlib.h>

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double quantile(const double *sorted, int count, double share)
{
    const double at = share * (count - 1);
    const int below = (int)floor(at), above = below + 1 < count ? below + 1 : below;
    return sorted[below] + (at - below) * (sorted[above] - sorted[below]);
}

hada_bench_figure hada_bench_figure_of(double *values, int count)
{
    if (count < 1)
        return (hada_bench_figure){NAN, NAN, NAN, 0};
    qsort(values, (size_t)count, sizeof *values, by_value);
    return (hada_bench_figure){quantile(values, count, 0.5), quantile(values, count, 0.25),
                               quantile(values, count, 0.75), count};
}

hada_bench_figure hada_bench_scaled(hada_bench_figure figure, double factor)
{
    return (hada_bench_figure){figure.median * factor, figure.q1 * factor, figure.q3 * factor, figure.count};
}

int hada_bench_apart(const hada_bench_figure *a, const hada_bench_figure *b)
{
    return a->q3 < b->q1 || b->q3 < a->q1;
}

static int beats(double cost_a, double loss_a, double cost_b, double loss_b)
{
    return cost_a <= cost_b && loss_a <= loss_b && (cost_a < cost_b || loss_a < loss_b);
}

void hada_bench_pareto(const double *cost, const double *loss, int count, int *front)
{
    for (int i = 0; i < count; i++) {
        front[i] = !isnan(cost[i]) && !isnan(loss[i]);
        for (int k = 0; front[i] && k < count; k++)
            if (beats(cost[k], loss[k], cost[i], loss[i]))
                front[i] = 0;
    }
}

void hada_bench_likeness_add(hada_bench_likeness *s, const float *values, const float *truth, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const double x = values[i], y = truth[i];
        s->xx += x * x;
        s->xy += x * y;
        s->yy += y * y;
    }
    s->count += (double)count;
}

double hada_bench_psnr(const hada_bench_likeness *s)
{
    const double left = s->xx > 0 ? s->yy - s->xy * s->xy / s->xx : s->yy;
    return s->count > 0 && left > 0 ? 10 * log10(s->count / left) : NAN;
}
