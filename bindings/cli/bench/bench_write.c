/* What came out: tables for a person; bench.json for --compare and other programs, bench.csv as one long table. */
#include <hadalens/folder.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bench.h"

/* The results in words, for a terminal. */

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
        char text[64], bytes[16], psnr[24] = "";
        if (row->group != group || strcmp(row->device, device) || strcmp(row->workload, workload))
            continue;
        if (!begun++)
            hada_cli_say(bench->cli, "\n  %s", title);
        if (!isnan(row->psnr))
            snprintf(psnr, sizeof psnr, ", %.2f dB", row->psnr);
        if (group == HADA_BENCH_MEMORY)
            hada_cli_say(bench->cli, "    %-44s %s", row->name, hada_cli_bytes(bytes, (uint64_t)row->value.median));
        else
            hada_cli_say(bench->cli, "    %-44s %s %s%s", row->name, with_spread(text, sizeof text, &row->value),
                         row->unit, psnr);
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
    print_group(bench, device, workload, HADA_BENCH_SEQUENCE, "Films");
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

static json_t *row_json(const hada_bench_row *row)
{
    json_t *out =
        json_pack("{s:s, s:s, s:s, s:s, s:s, s:s, s:o, s:o, s:o, s:i}", "device", row->device, "workload",
                  row->workload, "group", hada_bench_group_names[row->group], "name", row->name, "unit", row->unit,
                  "better", row->better > 0 ? "more" : "less", "median", hada_cli_real(row->value.median), "q1",
                  hada_cli_real(row->value.q1), "q3", hada_cli_real(row->value.q3), "count", row->value.count);
    if (row->group == HADA_BENCH_SWEEP) {
        HADA_CLI_SET(out, {"error_l2", row->error}, {"bound_l2", row->bound}, {"psnr_db", row->psnr},
                     {"psnr_in_focus_db", row->psnr_in_focus});
        json_object_set_new(out, "front", json_boolean(row->front));
    }
    if (row->group == HADA_BENCH_KERNEL)
        HADA_CLI_SET(out, {"bytes", row->bytes}, {"flops", row->flops});
    return out;
}

hada_status hada_bench_json(const hada_bench *bench, json_t *document, hada_error *err)
{
    json_t *rows = json_array();
    char when[32] = "";
    const time_t now = time(NULL);
    struct tm parts;
    if (gmtime_r(&now, &parts))
        strftime(when, sizeof when, "%Y-%m-%dT%H:%M:%SZ", &parts);
    for (int i = 0; rows && i < bench->count; i++)
        json_array_append_new(rows, row_json(&bench->rows[i]));
    json_object_set_new(document, "format", json_string("hadalens bench 1"));
    json_object_set_new(document, "time", json_string(when));
    json_object_set_new(document, "rounds", json_integer(bench->rounds));
    if (!rows || json_object_set_new(document, "rows", rows) || (int)json_array_size(rows) != bench->count)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    return HADA_OK;
}

/* A field: text in quotes where it needs them; nothing where there is no value. */
static void put_field(FILE *out, const json_t *value)
{
    const char *text = json_string_value(value);
    const int quoted = text && strpbrk(text, ",\"\n");
    if (json_is_integer(value) || json_is_boolean(value))
        fprintf(out, "%lld", json_is_integer(value) ? (long long)json_integer_value(value) : json_is_true(value));
    else if (json_is_real(value))
        fprintf(out, "%.9g", json_real_value(value));
    if (quoted)
        fputc('"', out);
    for (; text && *text; text++)
        fputs(*text == '"' ? "\"\"" : (const char[]){*text, 0}, out);
    if (quoted)
        fputc('"', out);
}

/* The rows of the document, a column for each of some keys. */
static hada_status write_csv(const hada_bench *bench, const char *path, hada_error *err)
{
    static const char *const columns[] = {
        "device",  "workload",         "group", "name",  "unit", "median", "q1", "q3", "count", "error_l2", "bound_l2",
        "psnr_db", "psnr_in_focus_db", "front", "bytes", "flops"};
    enum { COLUMNS = sizeof columns / sizeof *columns };
    const json_t *rows = json_object_get(bench->cli->document, "rows");
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    if (!out)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    for (int k = 0; k < COLUMNS; k++)
        fprintf(out, "%s%c", columns[k], k + 1 < COLUMNS ? ',' : '\n');
    for (size_t i = 0; i < json_array_size(rows); i++)
        for (int k = 0; k < COLUMNS; k++) {
            put_field(out, json_object_get(json_array_get(rows, i), columns[k]));
            fputc(k + 1 < COLUMNS ? ',' : '\n', out);
        }
    hada_status status = HADA_OK;
    if (ferror(out) | fclose(out))
        HADA_TRY_OR_DONE(hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory"));
    HADA_TRY_OR_DONE(hada_file_write(path, text, size, err));
done:
    free(text);
    return status;
}

hada_status hada_bench_write(const hada_bench *bench, const char *folder, hada_error *err)
{
    char *json = hada_cli_text("%s/bench.json", folder), *csv = hada_cli_text("%s/bench.csv", folder);
    char *text = json_dumps(bench->cli->document, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    hada_status status = HADA_OK;
    if (!text)
        HADA_TRY_OR_DONE(hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory"));
    HADA_TRY_OR_DONE(hada_file_write(json, text, strlen(text), err));
    HADA_TRY_OR_DONE(write_csv(bench, csv, err));
    hada_cli_say(bench->cli, "\nWrote %s and %s.", json, csv);
done:
    free(text);
    free(json);
    free(csv);
    return status;
}
