/* Result files: bench.json for --compare and other programs, bench.csv as one long table. */
#include "bench.h"

#include <hadalens/folder.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static json_t *row_json(const hada_bench_row *row)
{
    json_t *out =
        json_pack("{s:s, s:s, s:s, s:s, s:s, s:s, s:o, s:o, s:o, s:i}", "device", row->device, "workload",
                  row->workload, "group", hada_bench_group_names[row->group], "name", row->name, "unit", row->unit,
                  "better", row->better > 0 ? "more" : "less", "median", hada_cli_real(row->value.median), "q1",
                  hada_cli_real(row->value.q1), "q3", hada_cli_real(row->value.q3), "count", row->value.count);
    if (row->group == HADA_BENCH_SWEEP) {
        json_object_set_new(out, "error_l2", hada_cli_real(row->error));
        json_object_set_new(out, "bound_l2", hada_cli_real(row->bound));
        json_object_set_new(out, "psnr_db", hada_cli_real(row->psnr));
        json_object_set_new(out, "psnr_in_focus_db", hada_cli_real(row->psnr_in_focus));
        json_object_set_new(out, "front", json_boolean(row->front));
    }
    if (row->group == HADA_BENCH_KERNEL) {
        json_object_set_new(out, "bytes", hada_cli_real(row->bytes));
        json_object_set_new(out, "flops", hada_cli_real(row->flops));
    }
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

/* A field in quotes where it needs them. */
static void put_text(FILE *out, const char *text)
{
    const int quoted = strpbrk(text, ",\"\n") != NULL;
    if (quoted)
        fputc('"', out);
    for (; *text; text++) {
        if (*text == '"')
            fputc('"', out);
        fputc(*text, out);
    }
    if (quoted)
        fputc('"', out);
}

static void put_number(FILE *out, double value, int known)
{
    fputc(',', out);
    if (known && isfinite(value))
        fprintf(out, "%.9g", value);
}

static void put_row(FILE *out, const hada_bench_row *row)
{
    const int sweep = row->group == HADA_BENCH_SWEEP, kernel = row->group == HADA_BENCH_KERNEL;
    put_text(out, row->device);
    fputc(',', out);
    put_text(out, row->workload);
    fprintf(out, ",%s,", hada_bench_group_names[row->group]);
    put_text(out, row->name);
    fprintf(out, ",%s", row->unit);
    put_number(out, row->value.median, 1);
    put_number(out, row->value.q1, 1);
    put_number(out, row->value.q3, 1);
    fprintf(out, ",%d", row->value.count);
    put_number(out, row->error, sweep);
    put_number(out, row->bound, sweep);
    put_number(out, row->psnr, sweep);
    put_number(out, row->psnr_in_focus, sweep);
    fprintf(out, sweep ? ",%d" : ",", row->front);
    put_number(out, row->bytes, kernel);
    put_number(out, row->flops, kernel);
    fputc('\n', out);
}

static hada_status write_csv(const hada_bench *bench, const char *path, hada_error *err)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    if (!out)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    fputs("device,workload,group,name,unit,median,q1,q3,count,error_l2,bound_l2,psnr_db,psnr_in_focus_db,front,bytes,"
          "flops\n",
          out);
    for (int i = 0; i < bench->count; i++)
        put_row(out, &bench->rows[i]);
    hada_status status = HADA_OK;
    if (ferror(out) | fclose(out))
        HADA_TRY(hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory"));
    HADA_TRY(hada_file_write(path, text, size, err));
done:
    free(text);
    return status;
}

hada_status hada_bench_write(const hada_bench *bench, const char *folder, hada_error *err)
{
    char *json = hada_cli_text("%s/bench.json", folder), *csv = hada_cli_text("%s/bench.csv", folder);
    char *text = json_dumps(bench->cli->document, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    hada_status status = HADA_OK;
    if (!json || !csv || !text) {
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
        goto done;
    }
    HADA_TRY(hada_file_write(json, text, strlen(text), err));
    HADA_TRY(write_csv(bench, csv, err));
    hada_cli_say(bench->cli, "\nWrote %s and %s.", json, csv);
done:
    free(text);
    free(json);
    free(csv);
    return status;
}
