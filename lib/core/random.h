/* Random numbers with the same bits on every machine. Internal.
 *
 * Generator: PCG-XSH-RR 64/32 (M. E. O'Neill, "PCG: A family of simple fast space-efficient statistically good
 * algorithms for random number generation", 2014), seeded through SplitMix64 (Steele, Lea, Flood, 2014), so that
 * neighbouring seeds give unrelated sequences. Real values use IEEE +, -, *, / and sqrt only, which are rounded
 * correctly everywhere, never the C library's log or cos, which are not. */
#ifndef HADA_CORE_RANDOM_H
#define HADA_CORE_RANDOM_H

#include <stdint.h>

typedef struct hada_random {
    uint64_t state, stream;
    double spare; /* the second normal value of a pair */
    int has_spare;
} hada_random;

/* Different `sequence` numbers give independent sequences for one seed (one per purpose or frame). */
void hada_random_seed(hada_random *random, uint64_t seed, uint64_t sequence);
uint32_t hada_random_bits(hada_random *random);
/* 0 <= value < 1, a multiple of 2^-53. */
double hada_random_uniform(hada_random *random);
/* low <= value < high. */
double hada_random_range(hada_random *random, double low, double high);
/* 0 <= value < count, without bias; count >= 1. */
uint32_t hada_random_below(hada_random *random, uint32_t count);
/* Mean 0, variance 1 (Marsaglia's polar method). */
double hada_random_normal(hada_random *random);

#endif
