#include "command.h"
#include "compare.h"
#include "folder.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct settings {
    hada_cli_common common;
    const char *distances, *window, *mask, *lpips, *lpips_heads;
    double peak, tolerance;
    int match_gain, authors, lpips_net;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Yardstick"),
    {HADA_OPTION_REAL, "peak", 0, "VALUE", "value that counts as full scale for PSNR and SSIM (default: 1)", NULL,
     AT(peak)},
    {HADA_OPTION_FLAG, "match-gain", 0, NULL, "multiply each result by the factor that fits best first",
     "For models made from a PSF, which do not know the scale of the scene.", AT(match_gain)},
    {HADA_OPTION_REAL, "tolerance", 0, "STEPS", "a distance is right within this many depth steps (default: 0.5)", NULL,
     AT(tolerance)},
    {HADA_OPTION_TEXT, "distances", 0, "LIST", "the camera's distances in mm, which say what a depth step is",
     "Without it they are read from NAME_stack.tif beside NAME_depth.tif.", AT(distances)},
    {HADA_OPTION_FLAG, "authors", 0, NULL, "show PSNR and SSIM also as the code of the 2022 paper computes them",
     "The mean of each pixel's PSNR, and SSIM with twice the data range: for comparing with that paper's figures "
     "alone. --json always has them.",
     AT(authors)},
    HADA_CLI_GROUP("Where"),
    {HADA_OPTION_TEXT, "window", 0, "HxW[+ROW+COL]", "compare within this rectangle alone",
     "It stands at the centre where the row and column of its top left are not given. Nothing outside it is looked at.",
     AT(window)},
    {HADA_OPTION_TEXT, "mask", 0, "FILE", "compare only where this image is not 0",
     "A TIFF file of the size of the images, first page. SSIM and sharpness still see the neighbours of the pixels "
     "that count.",
     AT(mask)},
    HADA_CLI_GROUP("LPIPS"),
    {HADA_OPTION_TEXT, "lpips", 0, "FILE", "weights of VGG-16 or AlexNet (safetensors): adds the perceptual distance",
     "docs/metrics.md tells how to make the file from the packages torchvision and lpips; none comes with this "
     "program.",
     AT(lpips)},
    {HADA_OPTION_TEXT, "lpips-heads", 0, "FILE", "the linear heads, where they stand in a file of their own", NULL,
     AT(lpips_heads)},
    {HADA_OPTION_CHOICE, "lpips-net", 0, "vgg|alex", "insist on this net (default: what the file holds)", NULL,
     AT(lpips_net)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    set->peak = 1;
    set->tolerance = 0.5;
}

/* One row of the table. */
typedef struct row {
    char *name, *result, *truth;
    hada_cli_score score;
} row;

typedef struct table {
    row *rows;
    int count;
} table;

static void table_free(table *all)
{
    for (int i = 0; i < all->count; i++) {
        free(all->rows[i].name);
        free(all->rows[i].result);
        free(all->rows[i].truth);
    }
    free(all->rows);
}

/* The result that belongs to a truth file: the same name, else NAME_aif.tif for NAME.tif. */
static char *find_result(const char *folder, const char *truth_name)
{
    static const char *const endings[] = {".tif", ".tiff", "_aif.tif"};
    char *stem = hada_cli_stem(truth_name), *found = NULL;
    for (size_t k = 0; stem && !found && k < sizeof endings / sizeof *endings; k++) {
        char *path = hada_cli_text("%s/%s%s", folder, stem, endings[k]);
        if (path && hada_path_is_file(path))
            found = path;
        else
            free(path);
    }
    free(stem);
    return found;
}

static hada_status list_folders(hada_cli *cli, table *all, const char *result, const char *truth, hada_error *err)
{
    char **names = NULL;
    int count = 0, alone = 0;
    hada_status status = hada_cli_list_tiffs(truth, &names, &count, err);
    if (status)
        return status;
    all->rows = calloc((size_t)count + 1, sizeof *all->rows);
    if (!all->rows)
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    for (int i = 0; !status && i < count; i++) {
        char *path = find_result(result, names[i]);
        if (!path) {
            alone++;
            continue;
        }
        row *one = &all->rows[all->count++];
        one->result = path;
        one->name = hada_cli_stem(names[i]);
        one->truth = hada_cli_text("%s/%s", truth, names[i]);
        if (!one->name || !one->truth)
            status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    hada_cli_free_names(&names, &count);
    if (!status && !all->count)
        status = hada_cli_error(err, HADA_ERROR_DATASET,
                                "no TIFF file in %s has a partner in %s; NAME.tif goes with NAME.tif or NAME_aif.tif",
                                truth, result);
    else if (!status && alone)
        hada_cli_warn(cli, "%d %s in %s without a result in %s", alone, alone == 1 ? "file" : "files", truth, result);
    return status;
}

static hada_status list(hada_cli *cli, table *all, const char *result, const char *truth, hada_error *err)
{
    if (hada_path_is_folder(result) != hada_path_is_folder(truth))
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "%s is a folder and %s is not; give two files or two folders",
                              hada_path_is_folder(result) ? result : truth,
                              hada_path_is_folder(result) ? truth : result);
    if (hada_path_is_folder(result))
        return list_folders(cli, all, result, truth, err);
    all->rows = calloc(1, sizeof *all->rows);
    if (!all->rows)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    all->count = 1;
    all->rows->name = hada_cli_stem(result);
    all->rows->result = strdup(result);
    all->rows->truth = strdup(truth);
    return all->rows->name && all->rows->result && all->rows->truth
               ? HADA_OK
               : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
}

static json_t *row_json(const row *one)
{
    static const char *const kinds[] = {"images", "stack", "distance_map"};
    const hada_cli_score *score = &one->score;
    json_t *entry = json_pack("{s:s, s:s, s:s, s:i}", "kind", kinds[score->what], "result", one->result, "truth",
                              one->truth, "pages", score->pages);
    if (score->what == HADA_CLI_MAPS) {
        json_object_set_new(entry, "coverage", hada_cli_real(score->depth.coverage));
        json_object_set_new(entry, "within", score->steps_known ? hada_cli_real(score->depth.within) : json_null());
        json_object_set_new(entry, "mean_error_mm", hada_cli_real(score->depth.mean_error_mm));
        json_object_set_new(entry, "mean_error_steps", hada_cli_real(score->depth.mean_steps));
        return entry;
    }
    json_object_set_new(entry, "occupied_pages", json_integer(score->occupied));
    json_object_set_new(entry, "missing_pages", json_integer(score->missing));
    json_object_set_new(entry, "gain", hada_cli_real(score->gain));
    json_object_set_new(entry, "psnr", hada_cli_real(score->psnr));
    json_object_set_new(entry, "psnr_all_pages", hada_cli_real(score->psnr_all));
    json_object_set_new(entry, "ssim", hada_cli_real(score->ssim));
    json_object_set_new(entry, "mae", hada_cli_real(score->mae));
    json_object_set_new(entry, "sharpness", hada_cli_real(score->sharpness));
    json_object_set_new(entry, "sharpness_truth", hada_cli_real(score->sharpness_truth));
    json_object_set_new(entry, "lpips", hada_cli_real(score->lpips));
    json_object_set_new(entry, "authors_psnr", hada_cli_real(score->authors_psnr));
    json_object_set_new(entry, "authors_ssim", hada_cli_real(score->authors_ssim));
    return entry;
}

/* "27.31", or a dash where there is no such number. */
static const char *number(char text[24], const char *format, double value)
{
    if (isnan(value))
        snprintf(text, 24, "-");
    else
        snprintf(text, 24, format, value);
    return text;
}

/* What the tables of images show. */
typedef struct column {
    const char *title, *format;
    int width;
    size_t offset;
} column;

#define COLUMN(member) offsetof(hada_cli_score, member)
enum { ALWAYS = 5, COLUMNS = 8 };
static const column columns[COLUMNS] = {{"PSNR dB", "%.2f", 7, COLUMN(psnr)},
                                        {"SSIM", "%.3f", 6, COLUMN(ssim)},
                                        {"MAE", "%.4f", 7, COLUMN(mae)},
                                        {"sharpness", "%.4f", 9, COLUMN(sharpness)},
                                        {"(truth)", "%.4f", 9, COLUMN(sharpness_truth)},
                                        {"LPIPS", "%.4f", 7, COLUMN(lpips)},
                                        {"authors' PSNR", "%.2f", 13, COLUMN(authors_psnr)},
                                        {"authors' SSIM", "%.3f", 13, COLUMN(authors_ssim)}};

static int is_shown(const settings *set, int k)
{
    return k < ALWAYS || (k == ALWAYS ? set->lpips != NULL : set->authors);
}

static double value_of(const hada_cli_score *score, int k)
{
    return *(const double *)((const char *)score + columns[k].offset);
}

/* A line of a table; values NULL: the titles. */
static void print_line(hada_cli *cli, const settings *set, const char *before, int width, const char *name,
                       const double *values)
{
    char line[256] = "", text[24];
    size_t used = 0;
    for (int k = 0; k < COLUMNS; k++)
        if (is_shown(set, k))
            used += (size_t)snprintf(line + used, sizeof line - used, "  %*s", columns[k].width,
                                     values ? number(text, columns[k].format, values[k]) : columns[k].title);
    hada_cli_say(cli, "%s%-*s%s", before, width, name, line);
}

/* Means by kind, over files. */
static void print_kind(hada_cli *cli, const settings *set, const table *all, hada_cli_what what, int width)
{
    static const char *const titles[] = {"All-in-focus and other images", "Stacks (occupied planes)"};
    double sum[COLUMNS] = {0};
    int count = 0;
    for (int i = 0; i < all->count; i++) {
        const hada_cli_score *score = &all->rows[i].score;
        double values[COLUMNS];
        if (score->what != what)
            continue;
        if (!count++)
            print_line(cli, set, i ? "\n" : "", width, titles[what], NULL);
        for (int k = 0; k < COLUMNS; k++)
            sum[k] += values[k] = value_of(score, k);
        print_line(cli, set, "  ", width - 2, all->rows[i].name, values);
        if (score->missing)
            hada_cli_warn(cli, "%s lacks %d occupied %s of the truth", all->rows[i].result, score->missing,
                          score->missing == 1 ? "plane" : "planes");
    }
    for (int k = 0; k < COLUMNS; k++)
        sum[k] /= count;
    if (count > 1)
        print_line(cli, set, "  ", width - 2, "mean", sum);
}

static void print_maps(hada_cli *cli, const table *all, int width, double tolerance)
{
    int count = 0;
    char text[3][24];
    for (int i = 0; i < all->count; i++) {
        const hada_cli_score *score = &all->rows[i].score;
        if (score->what != HADA_CLI_MAPS)
            continue;
        if (!count++)
            hada_cli_say(cli, "%s%-*s  %8s  %8s  %10s  %6s", i ? "\n" : "", width, "Distance maps", "covered", "right",
                         "mean error", "steps");
        hada_cli_say(
            cli, "  %-*s  %7.1f%%  %8s  %7s mm  %6s", width - 2, all->rows[i].name, 100 * score->depth.coverage,
            score->steps_known ? number(text[0], "%.1f%%", 100 * score->depth.within) : "-",
            number(text[1], "%.3g", score->depth.mean_error_mm), number(text[2], "%.2f", score->depth.mean_steps));
    }
    if (count)
        hada_cli_say(cli, "  right: share of the covered pixels within %g depth steps", tolerance);
}

static void print_table(hada_cli *cli, const settings *set, const table *all)
{
    size_t width = 30;
    for (int i = 0; i < all->count; i++)
        width = strlen(all->rows[i].name) + 2 > width ? strlen(all->rows[i].name) + 2 : width;
    print_kind(cli, set, all, HADA_CLI_IMAGES, (int)width);
    print_kind(cli, set, all, HADA_CLI_STACKS, (int)width);
    print_maps(cli, all, (int)width, set->tolerance);
}

static hada_status compare_all(hada_cli *cli, table *all, const hada_cli_yardstick *yardstick, hada_error *err)
{
    hada_status status = HADA_OK;
    json_t *files = json_array();
    json_object_set_new(cli->document, "files", files);
    for (int i = 0; !status && i < all->count; i++) {
        row *one = &all->rows[i];
        status = hada_cli_compare(&one->score, one->result, one->truth, yardstick, err);
        if (!status)
            json_array_append_new(files, row_json(one));
        if (!status)
            status = hada_cli_check_signals(err);
    }
    return status;
}

static hada_status open_lpips(hada_cli *cli, const settings *set, hada_context **context, hada_lpips **lpips,
                              hada_error *err)
{
    static const char *const names[] = {"", "vgg", "alex"};
    hada_status status = hada_cli_open(cli, context, err);
    if (!status)
        status = hada_lpips_create(lpips, *context, (hada_lpips_net)set->lpips_net, set->lpips, set->lpips_heads, err);
    if (!status)
        json_object_set_new(cli->document, "lpips_net", json_string(names[hada_lpips_get_net(*lpips)]));
    return status;
}

static hada_status evaluate(hada_cli *cli, const settings *set, table *all, const char **paths, hada_error *err)
{
    double distances[4096];
    hada_context *context = NULL;
    hada_cli_yardstick yardstick = {.peak = set->peak,
                                    .tolerance = set->tolerance,
                                    .distances_mm = distances,
                                    .match_gain = set->match_gain,
                                    .authors = set->authors || set->common.json};
    hada_status status = hada_cli_region_read(&yardstick.region, set->window, set->mask, err);
    if (!status && set->distances)
        status = hada_cli_read_distances("distances", set->distances, distances, 4096, &yardstick.distances, err);
    if (!status)
        status = list(cli, all, paths[0], paths[1], err);
    if (!status && set->lpips)
        status = open_lpips(cli, set, &context, &yardstick.lpips, err);
    if (!status)
        status = compare_all(cli, all, &yardstick, err);
    hada_lpips_destroy(&yardstick.lpips);
    if (set->lpips)
        hada_cli_close(cli, &context);
    hada_cli_region_free(&yardstick.region);
    return status;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    table all = {0};
    if (count != 2)
        return hada_cli_usage(cli, "two names are needed, the result and the truth, not %d", count);
    if (!(set->peak > 0) || !(set->tolerance > 0))
        return hada_cli_usage(cli, "--peak and --tolerance must be greater than zero");
    if ((set->lpips_heads || set->lpips_net) && !set->lpips)
        return hada_cli_usage(cli, "--lpips-heads and --lpips-net need --lpips FILE");
    hada_status status = evaluate(cli, set, &all, arguments, &err);
    if (!status)
        print_table(cli, set, &all);
    table_free(&all);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens evaluate pictures camera/test/truth", "all results of a folder that have a truth."},
    {"hadalens evaluate pictures/a_aif.tif a.tif --match-gain", "one image, whatever its scale."},
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
        "in the result are not covered, those that are NaN in the truth are left out. In files named NAME_stack.tif "
        "the planes that are dark in the truth are left out of the means; --json also gives the PSNR over all planes.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
};
