/* The results in words, for a terminal. */
#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SHOWN_KERNELS = 10 };

static const char *with_spread(char *text, size_t size, const hada_bench_figure *f)
{
    const int digits = f->median >= 100 ? 0 : f->median >= 10 ? 1 : f->median >= 1 ? 2 : 3;
    snprintf(text, size, "%.*f (%.*f to %.*f)", digits, f->median, digits, f->q1, digits, f->q3);
    return text;
}

/* Rows of a group, one a line. */
static void print_group(const hada_bench *bench, const char *device, const char *workload, hada_bench_group group,
                        const char *title)
{
    int begun = 0;
    for (int i = 0; i < bench->count; i++) {
        const hada_bench_row *row = &bench->rows[i];
        char text[64], bytes[16];
        if (row->group != group || strcmp(row->device, device) || strcmp(row->workload, workload))
            continue;
        if (!begun++)
            hada_cli_say(bench->cli, "\n  %s", title);
        if (group == HADA_BENCH_MEMORY)
            hada_cli_say(bench->cli, "    %-44s %s", row->name, hada_cli_bytes(bytes, (uint64_t)row->value.median));
        else
            hada_cli_say(bench->cli, "    %-44s %s %s", row->name, with_spread(text, sizeof text, &row->value),
                         row->unit);
    }
}

static double peak_of(const hada_bench *bench, const char *device, const char *name)
{
    const hada_bench_row *row = hada_bench_find(bench, device, "", HADA_BENCH_PEAK, name);
    return row ? row->value.q3 * 1e9 : NAN;
}

/* The kernels that take most of the time, and how far each is from what traffic and arithmetic need at least. */
static void print_kernels(const hada_bench *bench, const char *device, const char *workload)
{
    int count;
    const hada_bench_row **list = hada_bench_rows_of(bench, device, workload, HADA_BENCH_KERNEL, &count);
    const double copy = peak_of(bench, device, "copy"), flops = peak_of(bench, device, "float32 arithmetic");
    if (count) {
        hada_cli_say(bench->cli, "\n  Kernels and transfers that take most of a frame; 'floor': times the least time "
                                 "at the peaks above");
        hada_cli_say(bench->cli, "    %-44s %9s %9s %9s %7s", "mode, stage, kernel", "ms", "GB/s", "GFLOP/s", "floor");
    }
    for (int i = 0; i < count && i < SHOWN_KERNELS; i++) {
        const double seconds = list[i]->value.median * 1e-3;
        const double least = fmax(list[i]->bytes / copy, list[i]->flops / flops);
        hada_cli_digits floor_text;
        hada_cli_say(bench->cli, "    %-44s %9.3f %9.1f %9.1f %7s", list[i]->name, list[i]->value.median,
                     list[i]->bytes / seconds * 1e-9, list[i]->flops / seconds * 1e-9,
                     /* a dash for kernels that do not say what they need */
                     hada_cli_number(floor_text, "%.1f", least > 0 ? seconds / least : NAN));
    }
    free(list);
}

static void print_front(const hada_bench *bench, const char *device, const char *workload)
{
    int all, count = 0, truth = 0;
    const hada_bench_row **list = hada_bench_rows_of(bench, device, workload, HADA_BENCH_SWEEP, &all);
    for (int i = 0; i < all; i++) {
        truth |= !isnan(list[i]->psnr);
        if (list[i]->front)
            list[count++] = list[i];
    }
    if (count) {
        hada_cli_say(bench->cli, "\n  Run time against error: the %d of %d settings that no other beats in both", count,
                     all);
        hada_cli_say(bench->cli, "    %-36s %24s %16s%s", "setting", "ms a frame", "L2 to dense",
                     truth ? "   PSNR" : "");
    }
    for (int i = count - 1; i >= 0; i--) {
        char text[64], psnr[16] = "";
        hada_cli_digits error;
        with_spread(text, sizeof text, &list[i]->value);
        if (!isnan(list[i]->psnr))
            snprintf(psnr, sizeof psnr, "%5.2f dB", list[i]->psnr);
        hada_cli_say(bench->cli, "    %-36s %24s %16s %s", list[i]->name, text,
                     hada_cli_number(error, "%.2g", list[i]->error), psnr);
    }
    free(list);
}

static void print_workload(const hada_bench *bench, const char *device, const char *workload)
{
    hada_cli_say(bench->cli, "\n%s on %s", workload, device);
    print_group(bench, device, workload, HADA_BENCH_LATENCY, "Latency of a frame, and per depth");
    print_group(bench, device, workload, HADA_BENCH_STAGE, "Per depth, stage by stage");
    print_group(bench, device, workload, HADA_BENCH_CALLS,
                "What a frame asks of the device, and the time that it should take by that");
    print_group(bench, device, workload, HADA_BENCH_THROUGHPUT, "Many frames");
    print_group(bench, device, workload, HADA_BENCH_MEMORY, "Memory");
    print_group(bench, device, workload, HADA_BENCH_START, "From nothing to the first frame");
    print_kernels(bench, device, workload);
    print_front(bench, device, workload);
}

void hada_bench_print(const hada_bench *bench)
{
    hada_bench_place places[HADA_BENCH_PLACES];
    const int count = hada_bench_places(bench, places);
    hada_cli_say(bench->cli, "Medians, with the quartiles in brackets.");
    for (int i = 0, devices = 0; i < count; i++)
        if (places[i].number == devices) {
            devices++;
            hada_cli_say(bench->cli, "\n%s", places[i].device);
            print_group(bench, places[i].device, "", HADA_BENCH_PEAK, "What the device can do at best");
        }
    for (int i = 0; i < count; i++)
        print_workload(bench, places[i].device, places[i].workload);
}
