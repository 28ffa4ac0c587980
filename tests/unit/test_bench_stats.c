/* Medians, quartiles and Pareto fronts on known numbers. */
#include "bench_stats.h"

#include "testing.h"

static void is_figure(hada_bench_figure f, double q1, double median, double q3, int count)
{
    assert_float_equal(f.q1, q1, 1e-12);
    assert_float_equal(f.median, median, 1e-12);
    assert_float_equal(f.q3, q3, 1e-12);
    assert_int_equal(f.count, count);
}

/* As numpy.percentile(values, [25, 50, 75]) has them. */
TEST(quartiles_of_known_numbers)
{
    double one[] = {3}, two[] = {5, 1}, three[] = {9, 1, 2}, four[] = {4, 1, 3, 2}, five[] = {10, 50, 20, 40, 30};
    double equal[] = {7, 7, 7, 7}, outlier[] = {1, 1000, 2, 3, 4, 5, 6};
    is_figure(hada_bench_figure_of(one, 1), 3, 3, 3, 1);
    is_figure(hada_bench_figure_of(two, 2), 2, 3, 4, 2);
    is_figure(hada_bench_figure_of(three, 3), 1.5, 2, 5.5, 3);
    is_figure(hada_bench_figure_of(four, 4), 1.75, 2.5, 3.25, 4);
    is_figure(hada_bench_figure_of(five, 5), 20, 30, 40, 5);
    is_figure(hada_bench_figure_of(equal, 4), 7, 7, 7, 4);
    is_figure(hada_bench_figure_of(outlier, 7), 2.5, 4, 5.5, 7);
    is_figure(hada_bench_scaled(hada_bench_figure_of(five, 5), 0.1), 2, 3, 4, 5);
    const hada_bench_figure none = hada_bench_figure_of(one, 0);
    assert_true(isnan(none.median) && isnan(none.q1) && isnan(none.q3) && none.count == 0);
}

TEST(ranges_apart)
{
    const hada_bench_figure a = {10, 9, 11, 5}, b = {12, 11, 13, 5}, c = {13, 11.5, 14, 5};
    assert_false(hada_bench_apart(&a, &a));
    assert_false(hada_bench_apart(&a, &b)); /* they touch */
    assert_true(hada_bench_apart(&a, &c));
    assert_true(hada_bench_apart(&c, &a));
    assert_false(hada_bench_apart(&b, &c));
}

TEST(front_of_known_points)
{
    /*                       a  b  c  d (behind b)  e (as b)  f (dear, best)  g (as dear as c, worse)  h, i: unknown */
    const double cost[] = {1, 2, 3, 2.5, 2, 9, 3, 1, NAN};
    const double loss[] = {9, 5, 4, 6, 5, 1, 8, NAN, 1};
    const int expected[] = {1, 1, 1, 0, 1, 1, 0, 0, 0};
    int front[9];
    hada_bench_pareto(cost, loss, 9, front);
    assert_memory_equal(front, expected, sizeof expected);
    const double minus[] = {-28, -16}, times[] = {100, 10}; /* dB, turned round */
    const int both[] = {1, 1}, first[] = {1, 0};
    hada_bench_pareto(times, minus, 2, front);
    assert_memory_equal(front, both, sizeof both);
    const double worse[] = {-28, -16}, slower[] = {10, 100};
    hada_bench_pareto(slower, worse, 2, front);
    assert_memory_equal(front, first, sizeof first);
}
