/* What libFuzzer calls. */
#include <hadalens/limits.h>
#include <stdlib.h>

#include "fuzz.h"

int LLVMFuzzerInitialize(int *count, char ***words);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes);

static const fuzz_target *target;

int LLVMFuzzerInitialize(int *count, char ***words)
{
    hada_limits limits;
    hada_error err;
    (void)count;
    (void)words;
    target = fuzz_find(getenv("FUZZ_TARGET"));
    hada_limits_init(&limits);
    limits.pixels = 1 << 18; /* quick runs: large pictures are no other code */
    limits.parameters = 1 << 18;
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
