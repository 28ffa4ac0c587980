/* Random numbers that are a function of key and counter alone, for several counters side by side: Philox4x32 (Salmon,
 * Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011). Its authors recommend 10 rounds; 7 are
 * the fewest that passed their tests. */
#ifndef INC_PHILOX_H
#define INC_PHILOX_H

/* What holds a word of each counter: a vector of uint. */
#ifndef PHILOX_BITS
#define PHILOX_BITS uint8
#endif

/* Takes the four words of a counter to four words of random bits. */
static inline __attribute__((always_inline)) void philox(PHILOX_BITS word[4], int rounds, uint key0, uint key1)
{
    for (int round = 0; round < rounds; round++) {
        const PHILOX_BITS high0 = mul_hi(word[0], (PHILOX_BITS)0xD2511F53u), low0 = word[0] * 0xD2511F53u;
        const PHILOX_BITS high1 = mul_hi(word[2], (PHILOX_BITS)0xCD9E8D57u), low1 = word[2] * 0xCD9E8D57u;
        word[0] = high1 ^ word[1] ^ key0;
        word[1] = low1;
        word[2] = high0 ^ word[3] ^ key1;
        word[3] = low0;
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
}

#endif
