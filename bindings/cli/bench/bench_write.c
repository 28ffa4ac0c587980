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
    if (!json || !csv || !text) {
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
        goto done;
    }
    HADA_TRY_OR_DONE(hada_file_write(json, text, strlen(text), err));
    HADA_TRY_OR_DONE(write_csv(bench, csv, err));
    hada_cli_say(bench->cli, "\nWrote %s and %s.", json, csv);
done:
    free(text);
    free(json);
    free(csv);
    return status;
}
