#include "option.h"

#include <hadalens/response.h>
#include <hadalens/task_evaluate.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

typedef struct settings {
    hada_cli_common common;
    hada_evaluate_task task;
    const char *distances, *window, *lpips, *lpips_heads, *encoding, *truth_encoding;
    int lpips_net;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Yardstick"),
    {HADA_OPTION_REAL, "peak", 0, "VALUE", "value that counts as full scale for PSNR and SSIM (default: 1)", NULL,
     AT(task.peak)},
    {HADA_OPTION_FLAG, "match-gain", 0, NULL, "multiply each result by the factor that fits best first",
     "For models made from a PSF, which do not know the scale of the scene.", AT(task.match_gain)},
    {HADA_OPTION_REAL, "tolerance", 0, "STEPS", "a distance is right within this many depth steps (default: 0.5)", NULL,
     AT(task.tolerance)},
    {HADA_OPTION_TEXT, "distances", 0, "LIST", "the camera's distances in mm, which say what a depth step is",
     "Without it they are read from NAME_stack.tif beside NAME_depth.tif.", AT(distances)},
    {HADA_OPTION_FLAG, "authors", 0, NULL, "show PSNR and SSIM also as the code of the 2022 paper computes them",
     "The mean of each pixel's PSNR, and SSIM with twice the data range. --json always has them.", AT(task.authors)},
    {HADA_OPTION_TEXT, "encoding", 0, "linear|srgb|P", "compare in this encoding (default: the truth's)",
     "Both are brought to it; the result says how its values stand for light.", AT(encoding)},
    {HADA_OPTION_TEXT, "truth-encoding", 0, "linear|srgb|P", "how the values of the truth stand for light",
     "Without it: what its file says, else as the scenes that the result's camera was learned from.",
     AT(truth_encoding)},
    {HADA_OPTION_REAL, "gate-pixels", 0, "P", "an emitter is found within so many pixels of the true one (default: 2)",
     NULL, AT(task.gate_pixels)},
    {HADA_OPTION_REAL, "gate-depths", 0, "D", "and within so many depths (default: 2.5)", NULL, AT(task.gate_depths)},
    HADA_CLI_GROUP("Where"),
    {HADA_OPTION_TEXT, "window", 0, "HxW[+ROW+COL]", "compare within this rectangle alone",
     "It stands at the centre where the row and column of its top left are not given. Nothing outside it is looked at.",
     AT(window)},
    {HADA_OPTION_TEXT, "mask", 0, "FILE", "compare only where this image is not 0",
     "A TIFF file of the size of the images, first page. SSIM and sharpness still see the neighbours of these pixels.",
     AT(task.mask)},
    HADA_CLI_GROUP("LPIPS"),
    {HADA_OPTION_TEXT, "lpips", 0, "FILE", "weights of VGG-16 or AlexNet (safetensors): adds the perceptual distance",
     "docs/reference/measures.md tells how to make the file from the packages torchvision and lpips; none comes with this "
     "program.",
     AT(lpips)},
    {HADA_OPTION_TEXT, "lpips-heads", 0, "FILE", "the linear heads, where they stand in a file of their own", NULL,
     AT(lpips_heads)},
    {HADA_OPTION_CHOICE, "lpips-net", 0, "vgg|alex", "insist on this net (default: what the file holds)", NULL,
     HADA_CLI_ONE_OF(settings, lpips_net, HADA_LPIPS_VGG, HADA_LPIPS_ALEX)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    hada_evaluate_task_init(&set->task);
    set->encoding = set->truth_encoding = "auto";
}

/* What is printed and put into the document. */

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

static void evaluate_tell(hada_cli *cli, const hada_evaluate_report *all, double tolerance)
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

/* "HxW", or "HxW+ROW+COL". */
static int read_window(hada_evaluate_task *task, const char *text)
{
    char size[32];
    int used = 0, extent[2];
    const size_t length = strcspn(text, "+");
    if (length >= sizeof size)
        return 0;
    memcpy(size, text, length);
    size[length] = 0;
    if (!hada_cli_read_size(size, extent) || extent[0] < 1 || extent[1] < 1)
        return 0;
    task->window_rows = extent[0];
    task->window_cols = extent[1];
    return !text[length] || (sscanf(text + length, "+%9d+%9d%n", &task->window_row, &task->window_col, &used) == 2 &&
                             !text[length + (size_t)used] && task->window_row >= 0 && task->window_col >= 0);
}

static hada_status open_lpips(hada_cli *cli, const settings *set, hada_context **context, hada_lpips **lpips,
                              hada_error *err)
{
    static const char *const names[] = {"", "vgg", "alex"};
    HADA_TRY(hada_cli_open(cli, context, err));
    HADA_TRY(hada_lpips_create(lpips, *context, (hada_lpips_net)set->lpips_net, set->lpips, set->lpips_heads, err));
    json_object_set_new(cli->document, "lpips_net", json_string(names[hada_lpips_get_net(*lpips)]));
    return HADA_OK;
}

static hada_status evaluate(hada_cli *cli, settings *set, const char **paths, hada_error *err)
{
    double distances[4096];
    hada_status status = HADA_OK;
    hada_context *context = NULL;
    hada_evaluate_report *report = NULL;
    hada_evaluate_task *task = &set->task;
    task->distances_mm = distances;
    task->authors |= set->common.json;
    task->monitor = &cli->monitor;
    if (set->window && !read_window(task, set->window))
        HADA_TRY_OR_DONE(
            hada_cli_error(err, HADA_ERROR_ARGUMENT,
                           "--window %s is not a window; write rows x columns as in 192x192, or with the row and "
                           "column of its top left as in 192x192+10+20",
                           set->window));
    HADA_TRY_OR_DONE(hada_response_from_name(&task->encoding, set->encoding, err));
    HADA_TRY_OR_DONE(hada_response_from_name(&task->truth_encoding, set->truth_encoding, err));
    HADA_TRY_OR_DONE(hada_cli_read_distances("distances", set->distances, distances, 4096, &task->distances, err));
    if (set->lpips)
        HADA_TRY_OR_DONE(open_lpips(cli, set, &context, &task->lpips, err));
    HADA_TRY_OR_DONE(hada_evaluate_run(&report, paths[0], paths[1], task, err));
    evaluate_tell(cli, report, set->task.tolerance);
done:
    hada_evaluate_report_destroy(&report);
    hada_lpips_destroy(&task->lpips);
    if (context)
        hada_cli_close(cli, &context);
    return status;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    settings *set = user;
    hada_error err = {0};
    if (count != 2)
        return hada_cli_usage(cli, "two names are needed, the result and the truth, not %d", count);
    if (!(set->task.peak > 0) || !(set->task.tolerance > 0))
        return hada_cli_usage(cli, "--peak and --tolerance must be greater than zero");
    if (!(set->task.gate_pixels > 0) || !(set->task.gate_depths > 0))
        return hada_cli_usage(cli, "--gate-pixels and --gate-depths must be greater than zero");
    if ((set->lpips_heads || set->lpips_net) && !set->lpips)
        return hada_cli_usage(cli, "--lpips-heads and --lpips-net need --lpips FILE");
    return evaluate(cli, set, arguments, &err) ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens evaluate pictures camera/test/truth", "all results of a folder that have a truth."},
    {"hadalens evaluate pictures/a_aif.tif a.tif --match-gain", "one image, whatever its scale."},
    {"hadalens evaluate pictures/a_emitters.csv truth.csv", "emitters: recall, precision, errors."},
    {"hadalens evaluate pictures truth --window 192x192 --lpips vgg.safetensors", "the centre, and LPIPS as well."},
    {0},
};

const hada_cli_command hada_cli_evaluate = {
    .name = "evaluate",
    .summary = "compare results with the truth: PSNR, SSIM, MAE, LPIPS, sharpness, distances",
    .synopsis = "RESULT TRUTH [OPTION...]",
    .description =
        "RESULT and TRUTH are two files or two folders. In folders, files of the same name are compared, and "
        "NAME_aif.tif with NAME.tif. Files named NAME_depth.tif are distance maps in millimetres: pixels that are NaN "
        "in the result are not covered, those that are NaN in the truth are left out. Where the depth steps are known, maps "
        "and all-in-focus images are also judged at jumps of the true distances and away from them, pixels beyond the "
        "camera's distances apart, and NAME_confidence.tif beside a map by what it promises. In files named NAME_stack.tif "
        "the planes that are dark in the truth are left out of the means; --json also gives the PSNR over all planes. Two "
        "files that end in .csv are tables of emitters: columns x, y, z, and frame where there are several.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
};
