/* What libFuzzer calls. FUZZ_ONLY: the one target of this program, for services that start programs without
 * environment; FUZZ_PLAIN: without the mutators that know formats, to see what these are worth. */
#include <hadalens/limits.h>
#include <stdlib.h>

#include "fuzz.h"

int LLVMFuzzerInitialize(int *count, char ***words);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes);
size_t LLVMFuzzerMutate(uint8_t *data, size_t bytes, size_t room); /* libFuzzer's own */
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t bytes, size_t room, unsigned seed);

static const fuzz_target *target;
static fuzz_mutator *mutate;

int LLVMFuzzerInitialize(int *count, char ***words)
{
    hada_limits limits;
    hada_error err;
    (void)count;
    (void)words;
#ifdef FUZZ_ONLY
    target = fuzz_find(FUZZ_ONLY);
#else
    target = fuzz_find(getenv("FUZZ_TARGET"));
#endif
    mutate = getenv("FUZZ_PLAIN") ? NULL : target->mutate;
    hada_limits_init(&limits);
    limits.pixels = 1 << 18; /* quick runs: large pictures are no other code */
    limits.parameters = 1 << 18;
    limits.isolate = HADA_ISOLATE_NONE; /* coverage is that of this process */
    if (hada_limits_set(&limits, &err))
        return 1;
    if (target->begin)
        target->begin();
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes)
{
    target->run(data, bytes);
    return 0;
}

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t bytes, size_t room, unsigned seed)
{
    return mutate ? mutate(data, bytes, room, seed, LLVMFuzzerMutate) : LLVMFuzzerMutate(data, bytes, room);
}
