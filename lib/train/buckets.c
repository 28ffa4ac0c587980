#include "train/buckets.h"

#include <stdlib.h>

#include "core/alloc.h"

hada_status hada_buckets_create(hada_buckets *buckets, const hada_communicator *ranks, hada_parameters *parameters,
                                hada_error *err)
{
    const size_t floats = hada_parameters_floats(parameters, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
    const int cpu = parameters->slot->context->info.kind == HADA_DEVICE_CPU;
    hada_status status = HADA_OK;
    *buckets = (hada_buckets){0};
    if (hada_ranks(ranks) == 1 || !floats || (cpu && !ranks->network))
        return HADA_OK;
    buckets->ranks = ranks;
    buckets->parameters = parameters;
    HADA_TRY_OR_DONE(hada_allocated(buckets->values = hada_alloc_raw(floats, sizeof(float), "a gradient", err)));
    HADA_TRY_OR_DONE(hada_allocated(
        buckets->bucket = hada_alloc(floats / HADA_BUCKET + 1, sizeof *buckets->bucket, "a gradient", err)));
done:
    if (status)
        hada_buckets_free(buckets);
    return status;
}

static void release(hada_buckets *buckets)
{
    for (int i = 0; i < buckets->count; i++)
        if (buckets->bucket[i].event)
            clReleaseEvent(buckets->bucket[i].event);
    buckets->count = 0;
}

void hada_buckets_free(hada_buckets *buckets)
{
    release(buckets);
    free(buckets->values);
    free(buckets->bucket);
    *buckets = (hada_buckets){0};
}

void hada_buckets_begin(hada_buckets *buckets)
{
    release(buckets);
    buckets->full = 0;
    buckets->from = hada_parameters_floats(buckets->parameters, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
}

/* The sizes are those of the net's layers, and so the same on all ranks. */
hada_status hada_buckets_ready(void *user, size_t from, hada_error *err)
{
    hada_buckets *buckets = user;
    hada_parameters *parameters = buckets->parameters;
    const size_t count = buckets->from > from ? buckets->from - from : 0;
    if (!count || (count < HADA_BUCKET && from))
        return HADA_OK;
    hada_bucket *next = &buckets->bucket[buckets->count];
    *next = (hada_bucket){from, count, NULL};
    HADA_TRY(hada_buffer_read_event(&parameters->group[HADA_GROUP_NET].gradient, parameters->slot, from * sizeof(float),
                                    buckets->values + from, count * sizeof(float), &next->event, err));
    buckets->count++;
    buckets->from = from;
    return HADA_OK;
}

hada_status hada_buckets_exchange(hada_buckets *buckets, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_buckets_ready(buckets, 0, err));
    for (int i = 0; i < buckets->count; i++) {
        const hada_bucket *it = &buckets->bucket[i];
        const cl_int code = clWaitForEvents(1, &it->event);
        if (code != CL_SUCCESS)
            HADA_TRY_OR_DONE(hada_fail_cl(err, code, "clWaitForEvents"));
        HADA_TRY_OR_DONE(hada_reduce_floats(buckets->ranks, buckets->values + it->first, it->count, err));
    }
    buckets->full = 1;
done:
    /* nothing may still be written into `values` */
    if (status)
        hada_slot_finish(buckets->parameters->slot, NULL);
    release(buckets);
    return status;
}
