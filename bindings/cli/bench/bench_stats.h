/* Statistics of measurements. */
#ifndef HADA_CLI_BENCH_STATS_H
#define HADA_CLI_BENCH_STATS_H

#include <stddef.h>

/* Median and quartiles: linear between order statistics (the definition 7 of R. J. Hyndman, Y. Fan, The American
 * Statistician 50(4), 361 (1996), which R and NumPy take). NaN without values. */
typedef struct hada_bench_figure {
    double median, q1, q3;
    int count;
} hada_bench_figure;

/* Sorts the values. */
hada_bench_figure hada_bench_figure_of(double *values, int count);

/* Every value times a factor above 0. */
hada_bench_figure hada_bench_scaled(hada_bench_figure figure, double factor);

/* Whether the ranges between the quartiles have nothing in common. */
int hada_bench_apart(const hada_bench_figure *a, const hada_bench_figure *b);

/* Marks the Pareto front: front[i] is 1 where no other point is at most as dear and at least as good, and better in
 * one of both. `cost` and `loss`: less is better. Points with a NaN are never on it; of equal points all are. */
void hada_bench_pareto(const double *cost, const double *loss, int count, int *front);

/* Sums over values and their truth, for a PSNR after the factor that fits best: models made from a PSF cannot know the
 * scale of a scene. Peak 1; NaN where nothing was added, or nothing differs. */
typedef struct hada_bench_likeness {
    double xx, xy, yy, count;
} hada_bench_likeness;
void hada_bench_likeness_add(hada_bench_likeness *likeness, const float *values, const float *truth, size_t count);
double hada_bench_psnr(const hada_bench_likeness *likeness);

#endif
