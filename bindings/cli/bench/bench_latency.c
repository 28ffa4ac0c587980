/* One frame at a time: seconds, stage by stage and kernel by kernel, and bytes. */
#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 256, KERNELS = 96 };
typedef struct latency {
    hada_bench *bench;
    hada_plan *plan;
    const hada_bench_workload *workload;
    hada_result result;
    double stage[HADA_BENCH_STAGES][MOST];
    hada_kernel_time kernel[KERNELS]; /* of the first profiled frame */
    double seconds[KERNELS][MOST];
    int kernels;
} latency;

static hada_status run_frame(void *user, int round, double *value, hada_error *err)
{
    latency *work = user;
    const hada_image *raw = &work->workload->raw[round % work->workload->frames];
    HADA_TRY(hada_plan_run(work->plan, raw, &work->result, err));
    *value = work->result.report->seconds_total;
    for (int s = 0; s < HADA_BENCH_STAGES; s++)
        work->stage[s][round] = hada_bench_stage_seconds(work->result.report, s);
    return HADA_OK;
}

/* Always the first frame, so that every round does the same. */
static hada_status profile_frame(void *user, int round, double *value, hada_error *err)
{
    latency *work = user;
    hada_kernel_time *rows = NULL;
    size_t count = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_plan_profile(work->plan, 1, err));
    HADA_TRY_OR_DONE(hada_plan_run(work->plan, &work->workload->raw[0], &work->result, err));
    HADA_TRY_OR_DONE(hada_plan_kernel_times(work->plan, &rows, &count, err));
    *value = 0;
    for (size_t i = 0; i < count; i++) {
        int k = 0;
        while (k < work->kernels &&
               (strcmp(work->kernel[k].name, rows[i].name) || strcmp(work->kernel[k].stage, rows[i].stage)))
            k++;
        if (k == work->kernels && (round || k == KERNELS))
            continue;
        if (k == work->kernels)
            work->kernel[work->kernels++] = rows[i];
        work->seconds[k][round] = rows[i].seconds;
        *value += rows[i].seconds;
    }
done:
    hada_memory_destroy(&rows);
    return status;
}

/* A row of the workload on a device, in a mode. */
static void add(latency *work, const char *device, hada_bench_group group, const char *mode, const char *what,
                const char *unit, const double *values, int count, double factor)
{
    double copy[MOST];
    memcpy(copy, values, (size_t)count * sizeof *copy);
    const hada_bench_figure figure = hada_bench_scaled(hada_bench_figure_of(copy, count), factor);
    hada_bench_add(work->bench, device, work->workload->name, group, unit, -1, figure, "%s, %s", mode, what);
}

static void add_latency(latency *work, const char *device, const char *mode, const double *values, int count)
{
    const double each = 1e3 / work->result.depths;
    add(work, device, HADA_BENCH_LATENCY, mode, "frame", "ms", values, count, 1e3);
    add(work, device, HADA_BENCH_LATENCY, mode, "depth", "ms", values, count, each);
    for (int s = 0; s < HADA_BENCH_STAGES; s++)
        add(work, device, HADA_BENCH_STAGE, mode, hada_bench_stage_names[s], "ms", work->stage[s], count, each);
}

static void add_kernels(latency *work, const char *device, const char *mode, int count)
{
    for (int k = 0; k < work->kernels; k++) {
        const hada_kernel_time *kernel = &work->kernel[k];
        const hada_bench_figure figure = hada_bench_scaled(hada_bench_figure_of(work->seconds[k], count), 1e3);
        hada_bench_row *row = hada_bench_add(work->bench, device, work->workload->name, HADA_BENCH_KERNEL, "ms", -1,
                                             figure, "%s, %s, %s", mode, kernel->stage, kernel->name);
        row->bytes = kernel->bytes;
        row->flops = kernel->flops;
    }
}

/* What the first frame asks of the device, and the time that it should take by that (docs/reference/measures.md),
 * beside what it takes. */
static hada_status add_calls(latency *work, const hada_bench_device *device, const char *mode, hada_error *err)
{
    const double *peak = device->peak;
    double least = 0, bytes = 0, flops = 0, busy = 0, seconds;
    hada_call_counts a, b;
    HADA_TRY(hada_plan_profile(work->plan, 0, err));
    HADA_TRY(hada_plan_calls(work->plan, &a, err));
    HADA_TRY(run_frame(work, 0, &seconds, err));
    HADA_TRY(hada_plan_calls(work->plan, &b, err));
    for (int k = 0; k < work->kernels; k++) {
        const hada_kernel_time *kernel = &work->kernel[k];
        if (kernel->transfer)
            continue;
        bytes += kernel->bytes;
        flops += kernel->flops;
        busy += kernel->seconds;
        least += fmax(kernel->bytes / peak[HADA_BENCH_COPY], kernel->flops / peak[HADA_BENCH_ARITHMETIC]);
    }
    const double launches = (double)(b.launches - a.launches), launching = launches * peak[HADA_BENCH_LAUNCH];
    const double waits = (double)(b.waits - a.waits), waiting = waits * peak[HADA_BENCH_WAIT];
    const double up = b.bytes_up - a.bytes_up, down = b.bytes_down - a.bytes_down;
    const double moving = (up + down) / peak[HADA_BENCH_WRITE];
    struct {
        const char *name, *unit;
        double value;
    } rows[] = {{"launches", "", launches},
                {"transfers", "", (double)(b.transfers - a.transfers)},
                {"waits", "", waits},
                {"arguments set", "", (double)(b.arguments - a.arguments)},
                {"to the device", "KiB", up / 1024},
                {"to the host", "KiB", down / 1024},
                {"expected", "ms", 1e3 * (launching + waiting + moving + least)},
                {"of it launches", "ms", 1e3 * launching},
                {"of it waits", "ms", 1e3 * waiting},
                {"of it transfers", "ms", 1e3 * moving},
                {"of it kernels at the peaks", "ms", 1e3 * least},
                {"measured", "ms", 1e3 * seconds},
                {"in kernels", "ms", 1e3 * busy},
                {"share of bandwidth", "%", 100 * bytes / busy / peak[HADA_BENCH_COPY]},
                {"share of arithmetic", "%", 100 * flops / busy / peak[HADA_BENCH_ARITHMETIC]}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        add(work, device->info.name, HADA_BENCH_CALLS, mode, rows[i].name, rows[i].unit, &rows[i].value, 1, 1);
    return HADA_OK;
}

static hada_status measure(latency *work, hada_bench_device *device, int mode, hada_error *err)
{
    hada_plan_options options;
    uint64_t stated = 0, host = 0;
    double values[MOST];
    int count = 0;
    const char *name = hada_bench_mode_names[mode];
    hada_bench_mode_options(mode, &options);
    const uint64_t before = hada_cli_context_info(device->context).bytes;
    hada_context_reset_peak(device->context);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_plan_estimate(device->context, work->workload->model, &options, &stated, &host, err));
    HADA_TRY_OR_DONE(hada_plan_create(&work->plan, device->context, work->workload->model, &options, err));
    /* once before: the first run of a kernel may compile it */
    for (int i = 0; i < work->workload->frames; i++)
        HADA_TRY_OR_DONE(run_frame(work, i, values, err));
    const uint64_t held = hada_cli_context_info(device->context).peak_bytes - before;
    HADA_TRY_OR_DONE(hada_bench_repeat(work->bench, run_frame, work, work->bench->rounds, values, &count, err));
    add_latency(work, device->info.name, name, values, count);
    const double bytes[] = {(double)stated, (double)held, (double)host};
    static const char *const words[] = {"stated on the device", "held at most on the device", "stated on the host"};
    for (int i = 0; i < 3; i++)
        add(work, device->info.name, HADA_BENCH_MEMORY, name, words[i], "bytes", &bytes[i], 1, 1);
    HADA_TRY_OR_DONE(hada_bench_repeat(work->bench, profile_frame, work, work->bench->rounds, values, &count, err));
    add_kernels(work, device->info.name, name, count);
    HADA_TRY_OR_DONE(add_calls(work, device, name, err));
done:
    hada_plan_destroy(&work->plan);
    hada_result_destroy(&work->result);
    return status;
}

hada_status hada_bench_latency(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                               hada_error *err)
{
    for (int mode = 0; mode < HADA_BENCH_MODES; mode++) {
        /* a model without transfer functions cannot refine */
        if (mode && !hada_model_get_info(workload->model)->has_otf)
            break;
        latency *work = hada_cli_memory(1, sizeof *work);
        work->bench = bench;
        work->workload = workload;
        const hada_status measured = measure(work, device, mode, err);
        free(work);
        HADA_TRY(hada_bench_left_out(bench, measured, hada_bench_mode_names[mode], err) ? HADA_OK : measured);
    }
    return HADA_OK;
}

hada_status hada_bench_peaks(hada_bench *bench, hada_bench_device *device, hada_error *err)
{
    enum { TIMES = 3 };
    static const struct {
        const char *name, *unit;
        int better;
        double factor;
    } peaks[HADA_BENCH_PEAKS] = {{"copy", "GB/s", 1, 1e-9},
                                 {"float32 arithmetic", "GFLOP/s", 1, 1e-9},
                                 {"launch", "us", -1, 1e6},
                                 {"wait", "us", -1, 1e6},
                                 {"write", "GB/s", 1, 1e-9}};
    double found[HADA_BENCH_PEAKS][TIMES];
    for (int i = 0; i < TIMES; i++) {
        HADA_TRY(hada_device_peaks(device->context, &found[HADA_BENCH_COPY][i], &found[HADA_BENCH_ARITHMETIC][i], err));
        HADA_TRY(hada_device_call_costs(device->context, &found[HADA_BENCH_LAUNCH][i], &found[HADA_BENCH_WAIT][i],
                                        &found[HADA_BENCH_WRITE][i], err));
    }
    for (int p = 0; p < HADA_BENCH_PEAKS; p++) {
        const hada_bench_figure figure = hada_bench_figure_of(found[p], TIMES);
        hada_bench_add(bench, device->info.name, "", HADA_BENCH_PEAK, peaks[p].unit, peaks[p].better,
                       hada_bench_scaled(figure, peaks[p].factor), "%s", peaks[p].name);
        device->peak[p] = figure.median;
    }
    return HADA_OK;
}
