/* Random numbers that are a function of key and counter alone, for eight counters side by side: Philox4x32 with 10
 * rounds (Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011). */
#ifndef INC_PHILOX_H
#define INC_PHILOX_H

/* The four words of a counter. */
typedef struct philox_words {
    uint8 w0, w1, w2, w3;
} philox_words;

static inline philox_words philox(philox_words c, uint key0, uint key1)
{
    for (int round = 0; round < 10; round++) {
        const uint8 high0 = mul_hi(c.w0, (uint8)0xD2511F53u), low0 = c.w0 * 0xD2511F53u;
        const uint8 high1 = mul_hi(c.w2, (uint8)0xCD9E8D57u), low1 = c.w2 * 0xCD9E8D57u;
        c.w0 = high1 ^ c.w1 ^ key0;
        c.w1 = low1;
        c.w2 = high0 ^ c.w3 ^ key1;
        c.w3 = low0;
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
    return c;
}

/* From words to multiples of 2^-24, above 0 and at most 1, exact in single precision. */
static inline float8 philox_unit(uint8 word)
{
    return convert_float8((word >> 8) + 1) * 0x1p-24f;
}

#endif
