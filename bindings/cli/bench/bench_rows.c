/* Measured rows, and repeating what is measured. */
#include "bench.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *const hada_bench_group_names[] = {"peak",   "start",      "latency",  "stage", "kernel", "calls",
                                              "memory", "throughput", "sequence", "sweep", NULL};
const char *const hada_bench_mode_names[HADA_BENCH_MODES] = {"linear", "refined"};
const char *const hada_bench_stage_names[HADA_BENCH_STAGES] = {"upload",  "linear", "pursuit", "refine",
                                                               "enhance", "focus",  "download"};

double hada_bench_stage_seconds(const hada_report *report, int stage)
{
    const double seconds[HADA_BENCH_STAGES] = {
        report->seconds_upload,  report->seconds_linear, report->seconds_pursuit, report->seconds_refine,
        report->seconds_enhance, report->seconds_focus,  report->seconds_download};
    return seconds[stage];
}

void hada_bench_mode_options(int mode, hada_plan_options *options)
{
    hada_plan_options_init(options);
    /* every frame is measured, also one that is like the one before */
    options->skip &= ~(unsigned)HADA_SKIP_FRAMES;
    if (!mode)
        options->refine = 0;
}

hada_bench_row *hada_bench_add(hada_bench *bench, const char *device, const char *workload, hada_bench_group group,
                               const char *unit, int better, hada_bench_figure value, const char *name, ...)
{
    if (bench->count == bench->room) {
        bench->room = bench->room ? 2 * bench->room : 64;
        bench->rows = hada_cli_longer(bench->rows, (size_t)bench->room * sizeof *bench->rows);
    }
    hada_bench_row *row = &bench->rows[bench->count++];
    va_list arguments;
    *row = (hada_bench_row){.group = group, .unit = unit, .better = better, .value = value};
    row->error = row->bound = row->psnr = row->psnr_in_focus = NAN;
    snprintf(row->device, sizeof row->device, "%s", device);
    snprintf(row->workload, sizeof row->workload, "%s", workload);
    va_start(arguments, name);
    vsnprintf(row->name, sizeof row->name, name, arguments);
    va_end(arguments);
    return row;
}

const hada_bench_row *hada_bench_find(const hada_bench *bench, const char *device, const char *workload,
                                      hada_bench_group group, const char *name)
{
    for (int i = 0; i < bench->count; i++) {
        const hada_bench_row *row = &bench->rows[i];
        if (row->group == group && !strcmp(row->device, device) && !strcmp(row->workload, workload) &&
            !strcmp(row->name, name))
            return row;
    }
    return NULL;
}

hada_status hada_bench_repeat(const hada_bench *bench, hada_bench_work work, void *user, int rounds, double *values,
                              int *count, hada_error *err)
{
    const double start = hada_cli_seconds();
    *count = 0;
    while (*count < rounds && (*count < 3 || hada_cli_seconds() - start < bench->patience)) {
        HADA_TRY(work(user, *count, &values[*count], err));
        HADA_TRY(hada_cli_check_signals(err));
        (*count)++;
    }
    return HADA_OK;
}

int hada_bench_left_out(const hada_bench *bench, hada_status status, const char *what, const hada_error *err)
{
    if (status != HADA_ERROR_DEVICE_MEMORY && status != HADA_ERROR_UNSUPPORTED)
        return 0;
    hada_cli_warn(bench->cli, "%s is left out: %s", what, err->message);
    return 1;
}

static int by_time(const void *a, const void *b)
{
    const double x = (*(const hada_bench_row *const *)a)->value.median,
                 y = (*(const hada_bench_row *const *)b)->value.median;
    return (x < y) - (x > y);
}

const hada_bench_row **hada_bench_rows_of(const hada_bench *bench, const char *device, const char *workload,
                                          hada_bench_group group, int *count)
{
    const hada_bench_row **rows = hada_cli_memory((size_t)bench->count, sizeof *rows);
    *count = 0;
    for (int i = 0; i < bench->count; i++) {
        const hada_bench_row *row = &bench->rows[i];
        if (row->group == group && !strcmp(row->device, device) && !strcmp(row->workload, workload))
            rows[(*count)++] = row;
    }
    qsort(rows, (size_t)*count, sizeof *rows, by_time);
    return rows;
}

int hada_bench_places(const hada_bench *bench, hada_bench_place *places)
{
    int count = 0, devices = 0;
    for (int i = 0; i < bench->count; i++) {
        const hada_bench_row *row = &bench->rows[i];
        int known = !*row->workload, device = -1, first = 1;
        for (int k = 0; k < count; k++) {
            known |= !strcmp(places[k].device, row->device) && !strcmp(places[k].workload, row->workload);
            device = !strcmp(places[k].device, row->device) ? places[k].number : device;
            first &= strcmp(places[k].workload, row->workload) != 0;
        }
        if (known || count == HADA_BENCH_PLACES)
            continue;
        places[count] = (hada_bench_place){row->device, row->workload, "", device < 0 ? devices++ : device, first};
        count++;
    }
    for (int k = 0; k < count; k++)
        if (places[k].number)
            snprintf(places[k].suffix, sizeof places[k].suffix, "-%d", places[k].number);
    return count;
}
