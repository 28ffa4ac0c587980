#include "core/communicator.h"

#include "core/options.h"

void hada_communicator_defaults(hada_communicator *communicator, size_t size)
{
    const hada_communicator own = {.size = sizeof own, .count = 1};
    HADA_OPTIONS_GIVE(communicator, size, &own);
}

hada_status hada_communicator_check(const hada_communicator *callers, hada_error *err)
{
    hada_communicator own;
    hada_communicator_init(&own);
    HADA_TRY(HADA_OPTIONS_TAKE(&own, callers, hada_communicator, err));
    if (own.count < 1 || own.rank < 0 || own.rank >= own.count)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "options.communicator: there is no rank %d of %d", own.rank,
                           own.count));
    if (own.count > 1 && (!own.reduce || !own.reduce_floats || !own.broadcast))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.communicator: several ranks need reduce, reduce_floats and broadcast"));
    return HADA_OK;
}

hada_status hada_reduce(const hada_communicator *of, double *values, size_t count, hada_error *err)
{
    return hada_ranks(of) > 1 && count ? of->reduce(of->user, values, count, err) : HADA_OK;
}

hada_status hada_reduce_floats(const hada_communicator *of, float *values, size_t count, hada_error *err)
{
    return hada_ranks(of) > 1 && count ? of->reduce_floats(of->user, values, count, err) : HADA_OK;
}

hada_status hada_broadcast(const hada_communicator *of, int root, void *bytes, size_t count, hada_error *err)
{
    return hada_ranks(of) > 1 && count ? of->broadcast(of->user, root, bytes, count, err) : HADA_OK;
}
