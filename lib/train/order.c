/* The order of pairs: a permutation of each round, computed place by place. */
#include "core/random.h"
#include "train/feed.h"

uint64_t hada_pairs_total(const hada_pairs *pairs)
{
    uint64_t total = 0;
    for (int z = 0; z < pairs->depths; z++)
        total += (uint64_t)pairs->counts[z];
    return total;
}

void hada_pairs_find(const hada_pairs *pairs, uint64_t index, int *depth, int *pair)
{
    *depth = 0;
    while (index >= (uint64_t)pairs->counts[*depth])
        index -= (uint64_t)pairs->counts[(*depth)++];
    *pair = (int)index;
}

enum { ROUNDS = 6 };

/* A Feistel network on 2 * half bits (Luby and Rackoff, "How to construct pseudorandom permutations from pseudorandom
 * functions", 1988): a permutation, whatever the keys. */
static uint64_t scramble(uint64_t value, int half, const uint32_t *keys)
{
    const uint32_t mask = (uint32_t)((UINT64_C(1) << half) - 1);
    uint32_t left = (uint32_t)(value >> half), right = (uint32_t)value & mask;
    for (int i = 0; i < ROUNDS; i++) {
        uint32_t mix = (right + keys[i]) * UINT32_C(0x9e3779b1);
        mix = (mix ^ (mix >> 15)) * UINT32_C(0x85ebca77);
        mix ^= mix >> 13;
        const uint32_t next = left ^ (mix & mask);
        left = right;
        right = next;
    }
    return (uint64_t)left << half | right;
}

void hada_order_pair(const hada_pairs *pairs, uint64_t seed, uint64_t place, int *depth, int *pair)
{
    const uint64_t total = hada_pairs_total(pairs);
    uint32_t keys[ROUNDS];
    hada_random random;
    int half = 1;
    while (half < 32 && UINT64_C(1) << (2 * half) < total)
        half++;
    hada_random_seed(&random, seed, place / total);
    for (int i = 0; i < ROUNDS; i++)
        keys[i] = hada_random_bits(&random);
    /* Values beyond the list lead on to others until one is on it: still a permutation. */
    uint64_t index = place % total;
    do
        index = scramble(index, half, keys);
    while (index >= total);
    hada_pairs_find(pairs, index, depth, pair);
}
