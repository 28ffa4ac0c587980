/* Many frames: how many a second, with one queue and with two, and how much of what is not a kernel a second queue
 * hides behind kernels. */
#include "bench.h"

#include <hadalens/job.h>
#include <stdio.h>
#include <stdlib.h>

#define LEAST_REST 0.1
enum { MOST = 256, IN_FLIGHT = 4, FRAMES = 8, QUEUES = 2 };

typedef struct stream {
    hada_plan *plan;
    const hada_bench_workload *workload;
    hada_result results[IN_FLIGHT];
    int frames; /* of a round */
} stream;

static hada_status run_round(void *user, int round, double *value, hada_error *err)
{
    stream *s = user;
    hada_job *jobs[IN_FLIGHT] = {NULL};
    hada_status status = HADA_OK;
    (void)round;
    const double start = hada_cli_seconds();
    for (int i = 0; i < s->frames + IN_FLIGHT; i++) {
        const int at = i % IN_FLIGHT;
        if (jobs[at])
            HADA_TRY_OR_DONE(hada_job_wait(jobs[at], err));
        hada_job_destroy(&jobs[at]);
        if (i < s->frames)
            HADA_TRY_OR_DONE(
                hada_job_submit(&jobs[at], s->plan, &s->workload->raw[i % s->workload->frames], &s->results[at], err));
    }
done:
    *value = (hada_cli_seconds() - start) / s->frames;
    for (int at = 0; at < IN_FLIGHT; at++)
        hada_job_destroy(&jobs[at]);
    return status;
}

/* Seconds a frame with a number of queues; *kernels (may be NULL): seconds of kernels in a frame. */
static hada_status measure(hada_bench *bench, hada_bench_device *device, stream *s, int mode, int queues,
                           double *values, int *count, double *kernels, hada_error *err)
{
    hada_plan_options options;
    hada_kernel_time *rows = NULL;
    size_t row_count = 0;
    hada_bench_mode_options(mode, &options);
    options.queues = queues;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_plan_create(&s->plan, device->context, s->workload->model, &options, err));
    double first = 0;
    s->frames = queues; /* every queue once: it may compile */
    HADA_TRY_OR_DONE(run_round(s, 0, &first, err));
    /* rounds of a second or so, of a slow device a few frames */
    s->frames = first > 0.3 ? 2 : FRAMES;
    HADA_TRY_OR_DONE(hada_bench_repeat(bench, run_round, s, bench->rounds, values, count, err));
    if (kernels) {
        HADA_TRY_OR_DONE(hada_plan_profile(s->plan, 1, err));
        HADA_TRY_OR_DONE(run_round(s, 0, &first, err));
        HADA_TRY_OR_DONE(hada_plan_kernel_times(s->plan, &rows, &row_count, err));
        *kernels = 0;
        for (size_t i = 0; i < row_count; i++)
            if (!rows[i].transfer)
                *kernels += rows[i].seconds / s->frames;
    }
done:
    hada_memory_destroy(&rows);
    hada_plan_destroy(&s->plan);
    return status;
}

/* Of two sets of rounds: what the second way hides, round by round. */
static void add_overlap(hada_bench *bench, hada_bench_device *device, stream *s, const char *mode, const double *one,
                        int ones, const double *two, int twos, double kernels)
{
    double hidden[MOST];
    const int count = ones < twos ? ones : twos;
    for (int i = 0; i < count; i++) {
        const double rest = one[i] - kernels;
        if (rest < LEAST_REST * one[i])
            return; /* hardly anything beside kernels to hide: the ratio would be noise */
        hidden[i] = 100 * (one[i] - two[i]) / rest;
    }
    hada_bench_add(bench, device->info.name, s->workload->name, HADA_BENCH_THROUGHPUT, "%", 1,
                   hada_bench_figure_of(hidden, count), "%s, hidden by the second queue", mode);
}

static hada_status of_mode(hada_bench *bench, hada_bench_device *device, stream *s, int mode, hada_error *err)
{
    double values[QUEUES][MOST], rates[MOST], kernels = 0;
    int count[QUEUES] = {0};
    for (int q = 0; q < QUEUES; q++) {
        HADA_TRY(measure(bench, device, s, mode, q + 1, values[q], &count[q], q ? NULL : &kernels, err));
        for (int i = 0; i < count[q]; i++)
            rates[i] = 1 / values[q][i];
        hada_bench_add(bench, device->info.name, s->workload->name, HADA_BENCH_THROUGHPUT, "frames/s", 1,
                       hada_bench_figure_of(rates, count[q]), "%s, %d %s", hada_bench_mode_names[mode], q + 1,
                       q ? "queues" : "queue");
    }
    add_overlap(bench, device, s, hada_bench_mode_names[mode], values[0], count[0], values[1], count[1], kernels);
    return HADA_OK;
}

hada_status hada_bench_throughput(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                                  hada_error *err)
{
    stream *s = hada_cli_memory(1, sizeof *s);
    hada_status status = HADA_OK;
    s->workload = workload;
    for (int mode = 0; mode < HADA_BENCH_MODES; mode++)
        if (!mode || hada_model_get_info(workload->model)->has_otf) {
            const hada_status measured = of_mode(bench, device, s, mode, err);
            HADA_TRY_OR_DONE(hada_bench_left_out(bench, measured, hada_bench_mode_names[mode], err) ? HADA_OK
                                                                                                    : measured);
        }
done:
    for (int i = 0; i < IN_FLIGHT; i++)
        hada_result_destroy(&s->results[i]);
    free(s);
    return status;
}
