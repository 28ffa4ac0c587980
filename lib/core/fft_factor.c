/* Factors of lengths, and the order of the stages. */
#include "core/fft_factor.h"

#include "kernels/shared_fft_table.h"

int hada_fft_smooth(int n)
{
    static const int primes[] = {2, 3, 5, 7};
    for (int i = 0; i < 4; i++)
        while (n % primes[i] == 0)
            n /= primes[i];
    return n == 1;
}

int hada_fft_good_size(int n)
{
    if (n < 2)
        n = 2;
    n += n % 2;
    while (!hada_fft_smooth(n))
        n += 2;
    return n;
}

/* A power of two as few stages of 8, 4 and, for want of others, 2. */
static int split_twos(int exponent, int *radix)
{
    int count = 0, eights = exponent / 3, rest = exponent % 3;
    int fours = rest == 2;
    if (rest == 1 && eights) {
        eights--;
        fours = 2;
        rest = 0;
    }
    while (eights-- > 0)
        radix[count++] = 8;
    while (fours-- > 0)
        radix[count++] = 4;
    if (rest == 1)
        radix[count++] = 2;
    return count;
}

void hada_fft_factor(int n, int columns, hada_fft_stages *stages)
{
    int exponent = 0, odd_count = 0, odd[HADA_FFT_MAX_STAGES] = {0}, twos[HADA_FFT_MAX_STAGES];
    int rest = n;
    for (; rest % 2 == 0; rest /= 2)
        exponent++;
    for (int p = 3; p <= FFT_ODD_LARGEST && rest > 1; p += 2)
        for (; rest % p == 0; rest /= p)
            odd[odd_count++] = p; /* in rising order: the largest comes last */
    stages->chirp = rest > 1;
    stages->points = n;
    if (stages->chirp) {
        hada_fft_factor(hada_fft_good_size(2 * n - 1), 0, stages);
        stages->chirp = 1;
        return;
    }
    int two_count = split_twos(exponent, twos), used = 0;
    stages->count = 0;
    if (columns) {
        const int direct = two_count && twos[0] >= 4 && two_count + odd_count > 1;
        stages->radix[stages->count++] = direct ? twos[used++] : 1;
    }
    /* The largest radix last: a pruned transform then skips most of it. */
    const int small_odd = odd_count && odd[odd_count - 1] < 8 && used < two_count && twos[used] > odd[odd_count - 1];
    if (small_odd) {
        for (int i = 0; i < odd_count; i++)
            stages->radix[stages->count++] = odd[i];
        while (two_count > used)
            stages->radix[stages->count++] = twos[--two_count];
    } else {
        while (used < two_count)
            stages->radix[stages->count++] = twos[used++];
        for (int i = 0; i < odd_count; i++)
            stages->radix[stages->count++] = odd[i];
    }
    while (stages->count < (columns ? 2 : 1))
        stages->radix[stages->count++] = 1;
}
