#include "runtime/profile.h"

#include <hadalens/profile.h>

#include "core/callers.h"
#include "core/clock.h"
#include "kernels/shared_peaks.h"
#include "launch/peak_copy.h"
#include "launch/peak_flops.h"
#include "runtime/buffer.h"

enum {
    WIDTH_LANES = 8,
    WIDTH_WIDE = 16,  /* where registers hold as many; narrower ones run short of registers then */
    WIDTH_GROUPS = 4, /* 16 bytes for each work-item */
    GROUP = 256,
    STRETCH = 4096, /* vectors of a CPU's work-item: 128 KiB */
    EACH = 16,      /* vectors of a GPU's work-item */
    RUNS = 16,
    ROUNDS_LANES = 1 << 19,
    ROUNDS_GROUPS = 1 << 12,
    FIRST_SHARE = 64 /* of them, for the runs that compile and measure how slow the device is */
};

/* The longest time of a run, judged by the first ones: all rounds take a large GPU a millisecond, and a CPU that calls
 * itself one seconds. */
#define RUN_SECONDS 0.03

/* Floats of a copy: larger than any cache, and small enough for a small device. */
#define COPY_FLOATS ((uint64_t)64 << 20)

int hada_peak_width(const hada_context *context)
{
    return context->shape == HADA_SHAPE_GROUPS ? WIDTH_GROUPS : WIDTH_LANES;
}

static size_t group_of(const hada_context *context)
{
    size_t size = context->shape == HADA_SHAPE_GROUPS ? GROUP : 1;
    while (size > 1 && size > context->info.max_work_group)
        size /= 2;
    return size;
}

hada_status hada_peak_copy(hada_slot *slot, cl_mem in, cl_mem out, size_t count, hada_error *err)
{
    const hada_context *context = slot->context;
    const int groups = context->shape == HADA_SHAPE_GROUPS;
    const size_t vectors = count / (size_t)hada_peak_width(context), stretch = groups ? EACH : STRETCH;
    const hada_range range = hada_range_of(hada_divide_up(vectors, stretch), group_of(context), 1, 1);
    hada_slot_cost(slot, 8.0 * (double)count, 0);
    return hada_launch_peak_copy(slot, hada_program_peak_copy_of(slot), &range, err, .in = in, .out = out,
                                 .each = stretch, .apart = groups ? 1 : stretch, .step = groups ? range.global[0] : 1,
                                 .count = vectors);
}

hada_status hada_peak_flops(hada_slot *slot, int width, cl_mem out, size_t items, float factor, float term, int rounds,
                            double *flops, hada_error *err)
{
    const hada_range range = hada_range_of(items, group_of(slot->context), 1, 1);
    const double all = 2.0 * HADA_PEAK_CHAINS * width * (double)range.global[0] * rounds;
    if (flops)
        *flops = all;
    hada_slot_cost(slot, 0, all);
    return hada_launch_peak_flops(slot, hada_find_peak_flops(.peak_width = width), &range, err, .out = out,
                                  .factor = factor, .term = term, .rounds = rounds);
}

/* Seconds of the launches since the last call. */
static hada_status last_seconds(hada_slot *slot, double *seconds, hada_error *err)
{
    hada_kernel_time *rows = NULL;
    size_t count = 0;
    hada_status status = HADA_OK;
    *seconds = 0;
    HADA_TRY_OR_DONE(hada_slot_times(slot, &rows, &count, err));
    for (size_t i = 0; i < count; i++)
        *seconds += rows[i].seconds;
    HADA_TRY_OR_DONE(hada_slot_profile(slot, 1, err));
done:
    free(rows);
    return status;
}

static hada_status best_copy(hada_slot *slot, double *rate, hada_error *err)
{
    const hada_device_info *info = &slot->context->info;
    const uint64_t quarter =
        info->memory_bytes / 4 < info->max_allocation_bytes ? info->memory_bytes / 4 : info->max_allocation_bytes;
    const uint64_t most = quarter / sizeof(float) / 64 * 64;
    const size_t count = (size_t)(most < COPY_FLOATS ? most : COPY_FLOATS);
    hada_buffer in = {0}, out = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_buffer_create(&in, slot->context, count * sizeof(float), "a copy", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&out, slot->context, count * sizeof(float), "a copy", err));
    HADA_TRY_OR_DONE(hada_buffer_clear(&in, slot, 0, in.bytes, err));
    for (int run = -1; run < RUNS; run++) { /* the first one touches the memory */
        double seconds = 0;
        HADA_TRY_OR_DONE(hada_monitor_check(slot->context->monitor, err));
        HADA_TRY_OR_DONE(hada_slot_profile(slot, 1, err));
        HADA_TRY_OR_DONE(hada_peak_copy(slot, in.mem, out.mem, count, err));
        HADA_TRY_OR_DONE(last_seconds(slot, &seconds, err));
        if (run >= 0 && seconds > 0 && 8.0 * (double)count / seconds > *rate)
            *rate = 8.0 * (double)count / seconds;
    }
done:
    hada_slot_finish(slot, NULL);
    HADA_DESTROY_BUFFERS(&in, &out);
    return status;
}

static hada_status best_flops(hada_slot *slot, double *rate, hada_error *err)
{
    const hada_context *context = slot->context;
    const int groups = context->shape == HADA_SHAPE_GROUPS;
    const size_t units = context->info.compute_units ? context->info.compute_units : 1;
    const size_t items = units * (groups ? 2048 : 8);
    const int all = groups ? ROUNDS_GROUPS : ROUNDS_LANES;
    int rounds = all / FIRST_SHARE;
    double slowest = 0;
    hada_buffer out = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_buffer_create(&out, slot->context, (items + GROUP) * WIDTH_WIDE * sizeof(float), "sums of chains", err));
    for (int run = -2; run < 2 * RUNS; run++) { /* the first ones compile */
        const int width = !groups && run % 2 ? WIDTH_WIDE : hada_peak_width(context);
        double seconds = 0, flops = 0;
        HADA_TRY_OR_DONE(hada_monitor_check(slot->context->monitor, err));
        HADA_TRY_OR_DONE(hada_slot_profile(slot, 1, err));
        HADA_TRY_OR_DONE(hada_peak_flops(slot, width, out.mem, items, 0.999f, 0.001f, rounds, &flops, err));
        HADA_TRY_OR_DONE(last_seconds(slot, &seconds, err));
        if (run < 0 && seconds > slowest)
            slowest = seconds;
        if (run == -1 && slowest > 0)
            rounds = (int)fmin(all, rounds * fmax(1.0, RUN_SECONDS / slowest));
        if (run >= 0 && seconds > 0 && flops / seconds > *rate)
            *rate = flops / seconds;
    }
done:
    hada_slot_finish(slot, NULL);
    hada_buffer_destroy(&out);
    return status;
}

hada_status hada_device_peaks(hada_context *context, double *copy_bytes_per_second, double *flops_per_second,
                              hada_error *err)
{
    HADA_NEED(context, err);
    double copy = 0, flops = 0;
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    if (copy_bytes_per_second) {
        HADA_TRY_OR_DONE(best_copy(slot, &copy, err));
        *copy_bytes_per_second = copy;
    }
    if (flops_per_second) {
        HADA_TRY_OR_DONE(best_flops(slot, &flops, err));
        *flops_per_second = flops;
    }
done:
    hada_slot_destroy(&slot);
    return status;
}

/* The cost of calls to a device: launches, waits, writes. */

enum { CALL_RUNS = 9, LAUNCHES = 200, WAITS = 40, ITEMS = 64 };
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
    for (int run = -1; run < CALL_RUNS; run++) { /* the first one compiles */
        HADA_TRY_OR_DONE(hada_monitor_check(slot->context->monitor, err));
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
    for (int run = -1; run < CALL_RUNS; run++) { /* the first one touches the memory */
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
    HADA_NEED(context, err);
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
