/* Two result files, row by row: another version, or another device. */
#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

typedef struct result {
    json_t *document, *rows;
    const char *path;
} result;

static hada_status load(result *out, const char *path, hada_error *err)
{
    json_error_t error;
    *out = (result){.path = path};
    out->document = json_load_file(path, 0, &error);
    if (!out->document)
        return hada_cli_error(err, HADA_ERROR_FILE_READ, "%s: %s", path, error.text);
    const char *format = json_string_value(json_object_get(out->document, "format"));
    out->rows = json_object_get(out->document, "rows");
    if (!format || strcmp(format, "hadalens bench 1") || !json_is_array(out->rows))
        return hada_cli_error(err, HADA_ERROR_FILE_FORMAT, "%s is not a bench.json of 'hadalens bench'", path);
    return HADA_OK;
}

static const char *text(const json_t *row, const char *key)
{
    const char *found = json_string_value(json_object_get(row, key));
    return found ? found : "";
}

static int same(const json_t *a, const json_t *b, const char *key)
{
    return !strcmp(text(a, key), text(b, key));
}

static const char *only_device(const json_t *rows)
{
    const char *device = json_array_size(rows) ? text(json_array_get(rows, 0), "device") : "";
    for (size_t i = 0; i < json_array_size(rows); i++)
        if (strcmp(text(json_array_get(rows, i), "device"), device))
            return NULL;
    return device;
}

static double number(const json_t *row, const char *key)
{
    const json_t *found = json_object_get(row, key);
    return json_is_number(found) ? json_number_value(found) : NAN;
}

static hada_bench_figure figure(const json_t *row)
{
    return (hada_bench_figure){number(row, "median"), number(row, "q1"), number(row, "q3"),
                               (int)json_integer_value(json_object_get(row, "count"))};
}

static const json_t *partner(const json_t *row, const json_t *rows, int any_device)
{
    for (size_t i = 0; i < json_array_size(rows); i++) {
        const json_t *other = json_array_get(rows, i);
        if ((any_device || same(row, other, "device")) && same(row, other, "workload") && same(row, other, "group") &&
            same(row, other, "name") && same(row, other, "unit"))
            return other;
    }
    return NULL;
}

typedef struct tally {
    int better, worse, within, missing;
} tally;

static void compare_rows(hada_cli *cli, const json_t *before, const json_t *after, json_t *list, tally *all)
{
    const hada_bench_figure a = figure(before), b = figure(after);
    if (!(a.median > 0) || !(b.median > 0)) /* nothing to make a ratio of */
        return;
    const double ratio = b.median / a.median;
    const int apart = hada_bench_apart(&a, &b), more = !strcmp(text(before, "better"), "more");
    const char *verdict = !apart ? "within the spread" : (ratio > 1) == more ? "better" : "worse";
    *(!apart ? &all->within : (ratio > 1) == more ? &all->better : &all->worse) += 1;
    json_array_append_new(list,
                          json_pack("{s:s, s:s, s:s, s:s, s:s, s:o, s:o, s:o, s:s}", "device", text(after, "device"),
                                    "workload", text(before, "workload"), "group", text(before, "group"), "name",
                                    text(before, "name"), "unit", text(before, "unit"), "old", hada_cli_real(a.median),
                                    "new", hada_cli_real(b.median), "ratio", hada_cli_real(ratio), "verdict", verdict));
    char name[96];
    snprintf(name, sizeof name, "%s%s%s", text(before, "workload"), *text(before, "workload") ? ": " : "",
             text(before, "name"));
    hada_cli_say(cli, "%-10s  %-52.52s %10.4g %10.4g %-9s %7.3f  %s", text(before, "group"), name, a.median, b.median,
                 text(before, "unit"), ratio, verdict);
}

hada_status hada_bench_compare(hada_cli *cli, const char *old_path, const char *new_path, hada_error *err)
{
    result before = {0}, after = {0};
    tally all = {0};
    hada_status status = HADA_OK;
    json_t *list = NULL;
    HADA_TRY_OR_DONE(load(&before, old_path, err));
    HADA_TRY_OR_DONE(load(&after, new_path, err));
    list = json_array();
    const char *one = only_device(before.rows), *other = only_device(after.rows);
    const int any_device = one && other;
    if (any_device && strcmp(one, other))
        hada_cli_say(cli, "old: %s\nnew: %s\n", one, other);
    hada_cli_say(cli, "%-10s  %-52s %10s %10s %-9s %7s  %s", "group", "what", "old", "new", "unit", "new/old",
                 "beyond the quartiles of both?");
    for (size_t i = 0; i < json_array_size(before.rows); i++) {
        const json_t *row = json_array_get(before.rows, i), *match = partner(row, after.rows, any_device);
        if (match)
            compare_rows(cli, row, match, list, &all);
        else
            all.missing++;
    }
    if (!json_array_size(list))
        HADA_TRY_OR_DONE(
            hada_cli_error(err, HADA_ERROR_DATASET,
                           "%s and %s have no row in common; measure the same workloads, and one device each "
                           "or the same devices",
                           old_path, new_path));
    hada_cli_say(cli, "\n%d better, %d worse, %d within the spread; %d rows of %s are not in %s.", all.better,
                 all.worse, all.within, all.missing, old_path, new_path);
    json_object_set_new(cli->document, "rows", list);
    json_object_set_new(cli->document, "summary",
                        json_pack("{s:i, s:i, s:i, s:i}", "better", all.better, "worse", all.worse, "within",
                                  all.within, "missing", all.missing));
    list = NULL; /* the document's */
done:
    json_decref(list);
    json_decref(before.document);
    json_decref(after.document);
    return status;
}
