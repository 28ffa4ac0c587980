#include "evaluate_tell.h"

#include <hadalens/response.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

static json_t *place_json(double coverage, double within, double steps)
{
    return json_pack("{s:o, s:o, s:o}", "coverage", hada_cli_real(coverage), "within", hada_cli_real(within),
                     "mean_error_steps", hada_cli_real(steps));
}

static json_t *encoding_json(double encoding)
{
    char name[HADA_RESPONSE_NAME];
    hada_response_name(name, encoding);
    return encoding == 0 ? json_null() : json_string(name);
}

static json_t *row_json(const hada_evaluation *score)
{
    static const char *const kinds[] = {"images", "stack", "distance_map", "emitters"};
    const hada_depth_score *depth = &score->depth;
    json_t *entry =
        json_pack("{s:s, s:o, s:o, s:i}", "kind", kinds[score->what], "result", hada_cli_json_text(score->result),
                  "truth", hada_cli_json_text(score->truth), "pages", score->pages);
    if (score->what == HADA_EVALUATED_EMITTERS) {
        json_object_set_new(entry, "emitters", json_integer(score->emitters));
        json_object_set_new(entry, "emitters_truth", json_integer(score->emitters_truth));
        HADA_CLI_SET(entry, {"recall", score->recall}, {"precision", score->precision}, {"f1", score->f1},
                     {"jaccard", score->jaccard}, {"lateral_rmse", score->lateral_rmse},
                     {"axial_rmse", score->axial_rmse});
        if (!isnan(score->switches)) {
            json_object_set_new(entry, "tracks", json_integer(score->tracks));
            json_object_set_new(entry, "tracks_truth", json_integer(score->tracks_truth));
            json_object_set_new(entry, "switches", json_integer((json_int_t)score->switches));
        }
        return entry;
    }
    if (score->what == HADA_EVALUATED_MAP) {
        HADA_CLI_SET(entry, {"coverage", depth->coverage}, {"within", score->steps_known ? depth->within : NAN},
                     {"mean_error_mm", depth->mean_error_mm}, {"mean_error_steps", depth->mean_steps});
        json_object_set_new(entry, "jumps", place_json(score->coverage_jumps, score->within_jumps, score->steps_jumps));
        json_object_set_new(entry, "away", place_json(score->coverage_away, score->within_away, score->steps_away));
        HADA_CLI_SET(entry, {"outside", score->outside}, {"outside_unknown", score->outside_unknown},
                     {"confident_half_error", score->confident_half}, {"risk_coverage", score->risk});
        return entry;
    }
    json_object_set_new(entry, "occupied_pages", json_integer(score->occupied));
    json_object_set_new(entry, "missing_pages", json_integer(score->missing));
    HADA_CLI_SET(entry, {"gain", score->gain});
    json_object_set_new(entry, "encoding", encoding_json(score->encoding));
    json_object_set_new(entry, "result_encoding", encoding_json(score->result_encoding));
    HADA_CLI_SET(entry, {"psnr", score->psnr}, {"psnr_all_pages", score->psnr_all}, {"ssim", score->ssim},
                 {"mae", score->mae}, {"sharpness", score->sharpness}, {"sharpness_truth", score->sharpness_truth},
                 {"psnr_jumps", score->psnr_jumps}, {"psnr_away", score->psnr_away}, {"ssim_jumps", score->ssim_jumps},
                 {"ssim_away", score->ssim_away}, {"lpips", score->lpips}, {"authors_psnr", score->authors_psnr},
                 {"authors_ssim", score->authors_ssim});
    return entry;
}

/* What a table shows of a score. */
typedef struct column {
    const char *title, *format;
    int width;
    size_t offset;
} column;

#define COLUMN(member) offsetof(hada_evaluation, member)
static const column score_columns[] = {{"PSNR dB", "%.2f", 7, COLUMN(psnr)},
                                       {"SSIM", "%.3f", 6, COLUMN(ssim)},
                                       {"MAE", "%.4f", 7, COLUMN(mae)},
                                       {"sharpness", "%.4f", 9, COLUMN(sharpness)},
                                       {"(truth)", "%.4f", 9, COLUMN(sharpness_truth)},
                                       {"LPIPS", "%.4f", 7, COLUMN(lpips)},
                                       {"authors' PSNR", "%.2f", 13, COLUMN(authors_psnr)},
                                       {"authors' SSIM", "%.3f", 13, COLUMN(authors_ssim)}};

/* A table of numbers for files of one kind, with their means where there is more than one. Of columns behind
 * the first `fixed`, those that no file has a number for are left out. */
typedef struct table {
    const char *title;
    hada_evaluated what;
    const column *columns;
    int count, fixed;
} table;

enum { TABLE_COLUMNS = 8 };
#define TABLE(columns) columns, (int)(sizeof(columns) / sizeof *(columns))

static void print_row(hada_cli *cli, const table *of, const unsigned char *shown, int width, const char *name,
                      const double *values)
{
    char line[256] = "";
    hada_cli_digits text;
    for (int k = 0; k < of->count; k++)
        if (shown[k])
            hada_cli_append(line, sizeof line, "  %*s", of->columns[k].width,
                            values ? hada_cli_number(text, of->columns[k].format, values[k]) : of->columns[k].title);
    hada_cli_say(cli, "%s%-*s%s", values ? "  " : "", values ? width - 2 : width, name, line);
}

static double entry_of(const column *of, const hada_evaluation *score)
{
    double value;
    memcpy(&value, (const char *)score + of->offset, sizeof value);
    if (of->offset == COLUMN(depth) + offsetof(hada_depth_score, within) && !score->steps_known)
        return NAN; /* within so many millimetres says nothing */
    if (of->offset == COLUMN(outside) && isnan(score->outside_unknown))
        return NAN;
    return of->format[strlen(of->format) - 1] == '%' ? 100 * value : value;
}

static void print_numbers(hada_cli *cli, const table *of, const hada_evaluate_report *all, int width)
{
    double sum[TABLE_COLUMNS] = {0};
    int numbers[TABLE_COLUMNS] = {0}, rows = 0;
    unsigned char shown[TABLE_COLUMNS] = {0};
    for (int i = 0; i < hada_evaluate_report_count(all); i++) {
        const hada_evaluation *score = hada_evaluate_report_get(all, i);
        if (score->what != of->what)
            continue;
        rows++;
        for (int k = 0; k < of->count; k++) {
            const double value = entry_of(&of->columns[k], score);
            if (isnan(value))
                continue;
            sum[k] += value;
            shown[k] = 1;
            numbers[k]++;
        }
    }
    for (int k = 0; k < of->fixed; k++)
        shown[k] = 1;
    print_row(cli, of, shown, width, of->title, NULL);
    for (int i = 0; i < hada_evaluate_report_count(all); i++) {
        const hada_evaluation *score = hada_evaluate_report_get(all, i);
        double values[TABLE_COLUMNS];
        for (int k = 0; k < of->count; k++)
            values[k] = entry_of(&of->columns[k], score);
        if (score->what == of->what)
            print_row(cli, of, shown, width, score->name, values);
    }
    for (int k = 0; k < of->count; k++)
        sum[k] /= numbers[k];
    if (rows > 1)
        print_row(cli, of, shown, width, "mean", sum);
}

static const column map_columns[] = {
    {"covered", "%.1f%%", 8, COLUMN(depth) + offsetof(hada_depth_score, coverage)},
    {"right", "%.1f%%", 8, COLUMN(depth) + offsetof(hada_depth_score, within)},
    {"mean error", "%.3g mm", 10, COLUMN(depth) + offsetof(hada_depth_score, mean_error_mm)},
    {"steps", "%.2f", 6, COLUMN(depth) + offsetof(hada_depth_score, mean_steps)},
    {"outside", "%.1f%%", 8, COLUMN(outside)},
    {"said so", "%.1f%%", 8, COLUMN(outside_unknown)},
    {"sure half", "%.2f", 9, COLUMN(confident_half)},
    {"risk", "%.2f", 6, COLUMN(risk)}};
static const column place_columns[] = {
    {"covered", "%.1f%%", 8, COLUMN(coverage_jumps)}, {"right", "%.1f%%", 8, COLUMN(within_jumps)},
    {"steps", "%.2f", 6, COLUMN(steps_jumps)},        {"| away: covered", "%.1f%%", 15, COLUMN(coverage_away)},
    {"right", "%.1f%%", 8, COLUMN(within_away)},      {"steps", "%.2f", 6, COLUMN(steps_away)}};
static const column image_columns[] = {{"PSNR dB", "%.2f", 7, COLUMN(psnr_jumps)},
                                       {"SSIM", "%.3f", 6, COLUMN(ssim_jumps)},
                                       {"| away: PSNR dB", "%.2f", 15, COLUMN(psnr_away)},
                                       {"SSIM", "%.3f", 6, COLUMN(ssim_away)}};

static const column emitter_columns[] = {{"recall", "%.3f", 7, COLUMN(recall)},
                                         {"precision", "%.3f", 9, COLUMN(precision)},
                                         {"F1", "%.3f", 6, COLUMN(f1)},
                                         {"Jaccard", "%.3f", 7, COLUMN(jaccard)},
                                         {"lateral px", "%.3f", 10, COLUMN(lateral_rmse)},
                                         {"axial depths", "%.3f", 12, COLUMN(axial_rmse)},
                                         {"switches", "%.4g", 8, COLUMN(switches)}};

static int has(const hada_evaluate_report *all, hada_evaluated what)
{
    for (int i = 0; i < hada_evaluate_report_count(all); i++)
        if (hada_evaluate_report_get(all, i)->what == what)
            return 1;
    return 0;
}

static int has_jumps(const hada_evaluate_report *all)
{
    for (int i = 0; i < hada_evaluate_report_count(all); i++)
        if (!isnan(hada_evaluate_report_get(all, i)->coverage_jumps))
            return 1;
    return 0;
}

static void print_maps(hada_cli *cli, const hada_evaluate_report *all, int width, double tolerance)
{
    const table maps = {"Distance maps", HADA_EVALUATED_MAP, TABLE(map_columns), 4},
                map_places = {"Distance maps at jumps", HADA_EVALUATED_MAP, TABLE(place_columns), 6},
                image_places = {"Images at jumps", HADA_EVALUATED_IMAGES, TABLE(image_columns), 4};
    if (!has(all, HADA_EVALUATED_MAP))
        return;
    if (has(all, HADA_EVALUATED_IMAGES) || has(all, HADA_EVALUATED_STACK))
        hada_cli_say(cli, "%s", "");
    print_numbers(cli, &maps, all, width);
    hada_cli_say(cli, "  right: share of the covered pixels within %g depth steps", tolerance);
    if (!has_jumps(all))
        return;
    hada_cli_say(cli, "%s", "");
    print_numbers(cli, &map_places, all, width);
    if (has(all, HADA_EVALUATED_IMAGES)) {
        hada_cli_say(cli, "%s", "");
        print_numbers(cli, &image_places, all, width);
    }
    hada_cli_say(cli, "  at jumps: within 3 pixels of where true distances differ by more than half a step");
}

/* Says once how images were compared, where that is not as they are. */
static void print_encoding(hada_cli *cli, const hada_evaluate_report *all)
{
    for (int i = 0; i < hada_evaluate_report_count(all); i++) {
        const hada_evaluation *score = hada_evaluate_report_get(all, i);
        char both[HADA_RESPONSE_NAME], result[HADA_RESPONSE_NAME];
        if (score->encoding == 0 || score->encoding == HADA_RESPONSE_LINEAR)
            continue;
        hada_response_name(both, score->encoding);
        hada_response_name(result, score->result_encoding);
        hada_cli_say(cli, "  images are compared in the encoding '%s'%s%s%s", both,
                     score->result_encoding != score->encoding ? ", to which results in '" : "",
                     score->result_encoding != score->encoding ? result : "",
                     score->result_encoding != score->encoding ? "' were brought" : "");
        return;
    }
}

static void warn_of_missing(hada_cli *cli, const hada_evaluate_report *all)
{
    for (int i = 0; i < hada_evaluate_report_count(all); i++) {
        const hada_evaluation *score = hada_evaluate_report_get(all, i);
        if (score->missing)
            hada_cli_warn(cli, "%s lacks %d occupied %s of the truth", score->result, score->missing,
                          score->missing == 1 ? "plane" : "planes");
    }
}

/* Images and stacks, each with their means. */
static void print_scores(hada_cli *cli, const hada_evaluate_report *all, int width)
{
    const table images = {"All-in-focus and other images", HADA_EVALUATED_IMAGES, TABLE(score_columns), 5},
                stacks = {"Stacks (occupied planes)", HADA_EVALUATED_STACK, TABLE(score_columns), 5},
                emitters = {"Emitters", HADA_EVALUATED_EMITTERS, TABLE(emitter_columns), 6};
    if (has(all, HADA_EVALUATED_IMAGES))
        print_numbers(cli, &images, all, width);
    if (has(all, HADA_EVALUATED_IMAGES) && has(all, HADA_EVALUATED_STACK))
        hada_cli_say(cli, "%s", "");
    if (has(all, HADA_EVALUATED_STACK))
        print_numbers(cli, &stacks, all, width);
    if (has(all, HADA_EVALUATED_EMITTERS))
        print_numbers(cli, &emitters, all, width);
    warn_of_missing(cli, all);
}

void hada_cli_evaluate_tell(hada_cli *cli, const hada_evaluate_report *all, double tolerance)
{
    size_t width = 30;
    json_t *files = json_array();
    for (int i = 0; i < hada_evaluate_report_count(all); i++) {
        const hada_evaluation *score = hada_evaluate_report_get(all, i);
        const size_t name = strlen(score->name) + 2;
        width = name > width ? name : width;
        json_array_append_new(files, row_json(score));
    }
    json_object_set_new(cli->document, "files", files);
    print_scores(cli, all, (int)width);
    print_maps(cli, all, (int)width, tolerance);
    print_encoding(cli, all);
}
