#include "compare.h"
#include "folder.h"

#include <hadalens/tiff.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static int ends_with(const char *text, const char *end)
{
    size_t length = strlen(text), tail = strlen(end);
    return length >= tail && !strcmp(text + length - tail, end);
}

hada_cli_what hada_cli_what_is(const char *path)
{
    char *stem = hada_cli_stem(path);
    hada_cli_what what = HADA_CLI_IMAGES;
    if (stem && ends_with(stem, "_stack"))
        what = HADA_CLI_STACKS;
    else if (stem && ends_with(stem, "_depth"))
        what = HADA_CLI_MAPS;
    free(stem);
    return what;
}

typedef struct files {
    const char *result_path, *truth_path;
    hada_tiff_reader *result, *truth;
    int count;
    int *page; /* of the result, for each page of the truth; -1: none */
} files;

static void files_close(files *open)
{
    hada_tiff_close(&open->result);
    hada_tiff_close(&open->truth);
    free(open->page);
}

/* Slices by their distances, when the numbers of pages differ. */
static hada_status match_slices(files *open, hada_error *err)
{
    const hada_tiff_info *result = hada_tiff_get_info(open->result), *truth = hada_tiff_get_info(open->truth);
    double *have = calloc((size_t)result->frames, sizeof *have), *want = calloc((size_t)truth->frames, sizeof *want);
    int found = 0;
    if (!have || !want) {
        free(have);
        free(want);
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    if (hada_tiff_distances(open->result, have, (size_t)result->frames) == (size_t)result->frames &&
        hada_tiff_distances(open->truth, want, (size_t)truth->frames) == (size_t)truth->frames)
        for (int t = 0; t < truth->frames; t++)
            for (int r = 0; r < result->frames && open->page[t] < 0; r++)
                if (fabs(have[r] - want[t]) < 1e-3 * want[t]) {
                    open->page[t] = r;
                    found++;
                }
    free(have);
    free(want);
    return found ? HADA_OK
                 : hada_cli_error(err, HADA_ERROR_SIZE,
                                  "%s has %d %s and %s has %d, and their distances do not tell which belong together",
                                  open->result_path, result->frames, result->frames == 1 ? "image" : "images",
                                  open->truth_path, truth->frames);
}

static hada_status files_open(files *open, const char *result, const char *truth, hada_error *err)
{
    *open = (files){.result_path = result, .truth_path = truth};
    hada_status status = hada_tiff_open(&open->result, result, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", result);
        return status;
    }
    status = hada_tiff_open(&open->truth, truth, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", truth);
        return status;
    }
    open->count = hada_tiff_get_info(open->truth)->frames;
    open->page = calloc((size_t)open->count, sizeof *open->page);
    if (!open->page)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    int equal = hada_tiff_get_info(open->result)->frames == open->count;
    for (int t = 0; t < open->count; t++)
        open->page[t] = equal ? t : -1;
    return equal ? HADA_OK : match_slices(open, err);
}

static hada_status read_pair(files *open, int t, hada_image *result, hada_image *truth, hada_error *err)
{
    hada_status status = hada_tiff_read(open->truth, t, truth, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", open->truth_path);
        return status;
    }
    if (open->page[t] < 0)
        return HADA_OK;
    status = hada_tiff_read(open->result, open->page[t], result, err);
    if (status)
        hada_cli_prefix(err, "%s: ", open->result_path);
    else if (result->channels != truth->channels || result->rows != truth->rows || result->cols != truth->cols)
        status =
            hada_cli_error(err, HADA_ERROR_SIZE, "%s is %dx%d with %d %s, but %s is %dx%d with %d", open->result_path,
                           result->rows, result->cols, result->channels, result->channels == 1 ? "channel" : "channels",
                           open->truth_path, truth->rows, truth->cols, truth->channels);
    return status;
}

static int is_dark(const hada_image *image)
{
    for (size_t i = 0; i < hada_image_count(image); i++)
        if (image->data[i] != 0.0f)
            return 0;
    return 1;
}

/* The factor that brings the result nearest to the truth. */
static hada_status find_gain(files *open, double *gain, hada_error *err)
{
    double cross = 0, square = 0;
    hada_status status = HADA_OK;
    for (int t = 0; !status && t < open->count; t++) {
        hada_image result = {0}, truth = {0};
        status = read_pair(open, t, &result, &truth, err);
        for (size_t i = 0; !status && result.data && i < hada_image_count(&truth); i++) {
            cross += (double)result.data[i] * (double)truth.data[i];
            square += (double)result.data[i] * (double)result.data[i];
        }
        hada_image_destroy(&result);
        hada_image_destroy(&truth);
    }
    *gain = square > 0 && isfinite(cross / square) ? cross / square : 1;
    return status;
}

static hada_status add_page(hada_cli_score *score, hada_image *result, const hada_image *truth, double peak,
                            double *square, hada_error *err)
{
    double mse = 0, psnr = 0, mae = 0, ssim = NAN, sharp = 0, sharp_truth = 0;
    for (size_t i = 0; score->gain != 1 && i < hada_image_count(result); i++)
        result->data[i] = (float)((double)result->data[i] * score->gain);
    hada_status status = hada_metric_mse(result, truth, NULL, &mse, err);
    if (!status)
        status = hada_metric_psnr(result, truth, peak, NULL, &psnr, err);
    if (!status)
        status = hada_metric_mae(result, truth, NULL, &mae, err);
    if (!status && truth->rows >= 11 && truth->cols >= 11)
        status = hada_metric_ssim(result, truth, peak, NULL, &ssim, err);
    if (!status)
        status = hada_metric_sharpness(result, NULL, &sharp, err);
    if (!status)
        status = hada_metric_sharpness(truth, NULL, &sharp_truth, err);
    if (status)
        return status;
    score->pages++;
    *square += mse;
    /* Dark planes of a stack say how clean it is, not how good the picture. */
    if (score->what == HADA_CLI_STACKS && is_dark(truth))
        return HADA_OK;
    score->occupied++;
    score->psnr += psnr;
    score->ssim += ssim;
    score->mae += mae;
    score->sharpness += sharp;
    score->sharpness_truth += sharp_truth;
    return HADA_OK;
}

static hada_status compare_images(hada_cli_score *score, files *open, const hada_cli_yardstick *yardstick,
                                  hada_error *err)
{
    double square = 0;
    hada_status status = HADA_OK;
    if (yardstick->match_gain)
        status = find_gain(open, &score->gain, err);
    for (int t = 0; !status && t < open->count; t++) {
        hada_image result = {0}, truth = {0};
        status = read_pair(open, t, &result, &truth, err);
        if (!status && !result.data)
            score->missing += !is_dark(&truth);
        else if (!status && (status = add_page(score, &result, &truth, yardstick->peak, &square, err)))
            hada_cli_prefix(err, "%s and %s: ", open->result_path, open->truth_path);
        hada_image_destroy(&result);
        hada_image_destroy(&truth);
    }
    double count = score->occupied ? score->occupied : NAN;
    score->psnr /= count;
    score->ssim /= count;
    score->mae /= count;
    score->sharpness /= count;
    score->sharpness_truth /= count;
    score->psnr_all = 10 * log10(yardstick->peak * yardstick->peak / (square / score->pages));
    return status;
}

/* The distances that the NAME_stack.tif beside a NAME_depth.tif states; returns how many, 0 when there is none. */
static int distances_beside(const char *map_path, double *out, int capacity)
{
    hada_tiff_reader *reader = NULL;
    hada_error ignored;
    const char *tail = strstr(map_path, "_depth.");
    for (const char *next = tail; next; next = strstr(next + 1, "_depth."))
        tail = next;
    char *path = tail ? hada_cli_text("%.*s_stack%s", (int)(tail - map_path), map_path, strrchr(map_path, '.')) : NULL;
    int count = 0;
    if (path && hada_cli_is_file(path) && !hada_tiff_open(&reader, path, &ignored)) {
        count = (int)hada_tiff_distances(reader, out, (size_t)capacity);
        hada_tiff_close(&reader);
    }
    free(path);
    return count > capacity ? 0 : count;
}

/* Maps of a sequence: sums over its frames. */
static hada_status compare_maps(hada_cli_score *score, files *open, const hada_cli_yardstick *yardstick,
                                hada_error *err)
{
    enum { MOST = 4096 };
    static double beside[MOST];
    const double *distances = yardstick->distances_mm;
    int count = yardstick->distances;
    double covered = 0, pixels = 0, within = 0, error = 0, steps = 0;
    if (!count) {
        count = distances_beside(open->truth_path, beside, MOST);
        if (!count)
            count = distances_beside(open->result_path, beside, MOST);
        distances = beside;
    }
    score->steps_known = count >= 2;
    hada_status status = HADA_OK;
    for (int t = 0; !status && t < open->count; t++) {
        hada_image result = {0}, truth = {0};
        hada_depth_score page;
        status = read_pair(open, t, &result, &truth, err);
        if (!status)
            status = hada_metric_depth(&result, &truth, score->steps_known ? distances : NULL,
                                       score->steps_known ? count : 0, yardstick->tolerance, NULL, &page, err);
        hada_image_destroy(&result);
        hada_image_destroy(&truth);
        if (status)
            break;
        double here = page.coverage * (double)page.pixels;
        pixels += (double)page.pixels;
        covered += here;
        if (here > 0) {
            within += page.within * here;
            error += page.mean_error_mm * here;
            steps += score->steps_known ? page.mean_steps * here : 0;
        }
        score->pages++;
    }
    score->depth.pixels = (long long)pixels;
    score->depth.coverage = covered / pixels;
    score->depth.within = within / covered;
    score->depth.mean_error_mm = error / covered;
    score->depth.mean_steps = score->steps_known ? steps / covered : NAN;
    return status;
}

hada_status hada_cli_compare(hada_cli_score *score, const char *result, const char *truth,
                             const hada_cli_yardstick *yardstick, hada_error *err)
{
    files open;
    *score = (hada_cli_score){.what = hada_cli_what_is(truth), .gain = 1};
    if (score->what == HADA_CLI_IMAGES)
        score->what = hada_cli_what_is(result);
    hada_status status = files_open(&open, result, truth, err);
    if (!status)
        status = score->what == HADA_CLI_MAPS ? compare_maps(score, &open, yardstick, err)
                                              : compare_images(score, &open, yardstick, err);
    files_close(&open);
    return status;
}
