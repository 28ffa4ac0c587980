/* Mutators that know a format: what they make is mostly whole, so that it gets past the checks at the door. */
#ifndef HADA_TESTS_FUZZ_MUTATE_H
#define HADA_TESTS_FUZZ_MUTATE_H

#include <stddef.h>
#include <stdint.h>

/* Changes `bytes` bytes, for which there is room for `room`, anyhow; how many it leaves. */
typedef size_t fuzz_plain(uint8_t *data, size_t bytes, size_t room);
/* The same, decided by `seed` alone; parts without structure are left to `plain`. */
typedef size_t fuzz_mutator(uint8_t *data, size_t bytes, size_t room, uint64_t seed, fuzz_plain *plain);

fuzz_mutator fuzz_mutate_tiff;        /* tags, types, counts, lists of strips, directories; pictures in every codec */
fuzz_mutator fuzz_mutate_safetensors; /* the header's JSON, lengths, offsets; numbers of the data */

/* Random numbers of a seed. */
typedef struct fuzz_luck {
    uint64_t state;
} fuzz_luck;
static inline size_t fuzz_below(fuzz_luck *luck, size_t bound)
{
    luck->state = luck->state * 6364136223846793005u + 1442695040888963407u;
    return bound ? (size_t)(luck->state >> 33) % bound : 0;
}

#endif
