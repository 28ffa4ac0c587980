/* What calls to a device cost, whatever they do. */
#include <hadalens/profile.h>

#include <stdlib.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "runtime/buffer.h"
#include "runtime/peaks.h"

enum { RUNS = 9, LAUNCHES = 200, WAITS = 40, ITEMS = 64 };
#define WRITE_BYTES ((size_t)16 << 20)

/* Seconds of a launch of a kernel without rounds, of `count` of them; `each`: all are waited for one by one. */
static hada_status time_launches(hada_slot *slot, const hada_buffer *out, int count, int each, double *seconds,
                                 hada_error *err)
{
    HADA_TRY(hada_slot_finish(slot, err));
    const double start = hada_seconds();
    for (int i = 0; i < count; i++) {
        HADA_TRY(hada_peak_flops(slot, hada_peak_width(slot->context), out->mem, ITEMS, 1.0f, 0.0f, 0, NULL, err));
        if (each)
            HADA_TRY(hada_slot_finish(slot, err));
    }
    HADA_TRY(hada_slot_finish(slot, err));
    *seconds = (hada_seconds() - start) / count;
    return HADA_OK;
}

static hada_status best_calls(hada_slot *slot, double *launch, double *wait, hada_error *err)
{
    hada_buffer out = {0};
    double seconds, waited = 0;
    hada_status status = HADA_OK;
    /* a group's items at most, of the widest vector */
    HADA_TRY_OR_DONE(hada_buffer_create(&out, slot->context, 1024 * 16 * sizeof(float), "a few sums", err));
    for (int run = -1; run < RUNS; run++) { /* the first one compiles */
        HADA_TRY_OR_DONE(time_launches(slot, &out, LAUNCHES, 0, &seconds, err));
        *launch = run <= 0 || seconds < *launch ? seconds : *launch;
        HADA_TRY_OR_DONE(time_launches(slot, &out, WAITS, 1, &seconds, err));
        waited = run <= 0 || seconds < waited ? seconds : waited;
    }
    *wait = waited > *launch ? waited - *launch : 0;
done:
    hada_slot_finish(slot, NULL);
    hada_buffer_destroy(&out);
    return status;
}

static hada_status best_write(hada_slot *slot, double *rate, hada_error *err)
{
    hada_buffer to = {0};
    void *from = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(from = hada_alloc(WRITE_BYTES, 1, "a transfer", err)));
    HADA_TRY_OR_DONE(hada_buffer_create(&to, slot->context, WRITE_BYTES, "a transfer", err));
    for (int run = -1; run < RUNS; run++) { /* the first one touches the memory */
        const double start = hada_seconds();
        HADA_TRY_OR_DONE(hada_buffer_write(&to, slot, 0, from, WRITE_BYTES, err));
        const double now = (double)WRITE_BYTES / (hada_seconds() - start);
        if (run >= 0 && now > *rate)
            *rate = now;
    }
done:
    hada_buffer_destroy(&to);
    free(from);
    return status;
}

hada_status hada_device_call_costs(hada_context *context, double *launch_seconds, double *wait_seconds,
                                   double *write_bytes_per_second, hada_error *err)
{
    double launch = 0, wait = 0, rate = 0;
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    if (!context)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_device_call_costs: a context is needed");
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(best_calls(slot, &launch, &wait, err));
    HADA_TRY_OR_DONE(best_write(slot, &rate, err));
    if (launch_seconds)
        *launch_seconds = launch;
    if (wait_seconds)
        *wait_seconds = wait;
    if (write_bytes_per_second)
        *write_bytes_per_second = rate;
done:
    hada_slot_destroy(&slot);
    return status;
}
