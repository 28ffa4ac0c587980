/* The generator against an independent Python implementation of the published algorithms, and its statistics. */
#include "testing.h"

TEST(known_bits)
{
    const uint32_t expected[] = {0xbfc16eb0u, 0x8dd3b338u, 0x4f4503a6u, 0x62a58c73u};
    hada_random random;
    hada_random_seed(&random, 42, 7);
    for (int i = 0; i < 4; i++)
        assert_int_equal(hada_random_bits(&random), expected[i]);
    hada_random_seed(&random, 42, 7);
    assert_true(hada_random_uniform(&random) == 0x1.7f82dd6374eccp-1);
    assert_true(hada_random_uniform(&random) == 0x1.3d140eb152c62p-2);
    hada_random_seed(&random, 42, 7);
    assert_true(fabs(hada_random_normal(&random) - 1.085804799172956) < 1e-14);
    assert_true(fabs(hada_random_normal(&random) + 0.8299148603342282) < 1e-14);
}

TEST(statistics)
{
    enum { COUNT = 400000 };
    hada_random random;
    hada_random_seed(&random, 1, 2);
    double sum = 0.0, square = 0.0, fourth = 0.0, last = 0.0, lag = 0.0, lowest = 1.0, highest = 0.0;
    int bins[10] = {0};
    for (int i = 0; i < COUNT; i++) {
        const double x = hada_random_normal(&random), u = hada_random_uniform(&random);
        sum += x;
        square += x * x;
        fourth += x * x * x * x;
        lag += x * last;
        last = x;
        bins[hada_random_below(&random, 10)]++;
        lowest = fmin(lowest, u);
        highest = fmax(highest, u);
    }
    /* five standard errors */
    assert_true(fabs(sum / COUNT) < 5.0 / sqrt(COUNT));
    assert_true(fabs(square / COUNT - 1.0) < 5.0 * sqrt(2.0 / COUNT));
    assert_true(fabs(fourth / COUNT - 3.0) < 5.0 * sqrt(96.0 / COUNT));
    assert_true(fabs(lag / COUNT) < 5.0 / sqrt(COUNT));
    assert_true(lowest >= 0.0 && lowest < 1e-4 && highest < 1.0 && highest > 0.9999);
    for (int i = 0; i < 10; i++)
        assert_true(fabs(bins[i] - COUNT / 10.0) < 5.0 * sqrt(COUNT * 0.09));
}

TEST(independence)
{
    /* neighbouring seeds and sequences: no equal values at equal places */
    for (uint64_t seed = 0; seed < 20; seed++) {
        hada_random a, b, c;
        hada_random_seed(&a, seed, 1);
        hada_random_seed(&b, seed + 1, 1);
        hada_random_seed(&c, seed, 2);
        int equal = 0;
        for (int i = 0; i < 1000; i++) {
            const uint32_t x = hada_random_bits(&a), y = hada_random_bits(&b), z = hada_random_bits(&c);
            equal += (x == y) + (x == z) + (y == z);
        }
        assert_true(equal <= 2);
    }
}
