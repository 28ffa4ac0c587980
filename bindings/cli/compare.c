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

/* A page of the truth, what belongs to it, and which pixels count. */
typedef struct page {
    hada_image result, truth; /* result: empty where there is none */
    unsigned char *mask;      /* NULL: all */
} page;

static void page_free(page *one)
{
    hada_image_destroy(&one->result);
    hada_image_destroy(&one->truth);
    free(one->mask);
}

static hada_status page_read(page *one, files *open, int t, const hada_cli_region *region, hada_error *err)
{
    *one = (page){0};
    hada_image *result = &one->result, *truth = &one->truth;
    hada_status status = hada_tiff_read(open->truth, t, truth, err);
    if (!status)
        status = hada_cli_region_mask(region, truth->rows, truth->cols, &one->mask, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", open->truth_path);
        return status;
    }
    if (open->page[t] >= 0) {
        status = hada_tiff_read(open->result, open->page[t], result, err);
        if (status)
            hada_cli_prefix(err, "%s: ", open->result_path);
        else if (result->channels != truth->channels || result->rows != truth->rows || result->cols != truth->cols)
            status = hada_cli_error(err, HADA_ERROR_SIZE, "%s is %dx%d with %d %s, but %s is %dx%d with %d",
                                    open->result_path, result->rows, result->cols, result->channels,
                                    result->channels == 1 ? "channel" : "channels", open->truth_path, truth->rows,
                                    truth->cols, truth->channels);
    }
    if (!status && result->data)
        status = hada_cli_region_cut(region, result, err);
    if (!status)
        status = hada_cli_region_cut(region, truth, err);
    return status;
}

/* Whether a value of an image counts. */
static int counts(const page *one, size_t i)
{
    return !one->mask || one->mask[i % ((size_t)one->truth.rows * (size_t)one->truth.cols)];
}

static int is_dark(const page *one)
{
    for (size_t i = 0; i < hada_image_count(&one->truth); i++)
        if (one->truth.data[i] != 0.0f && counts(one, i))
            return 0;
    return 1;
}

/* The factor that brings the result nearest to the truth. */
static hada_status find_gain(files *open, const hada_cli_region *region, double *gain, hada_error *err)
{
    double cross = 0, square = 0;
    hada_status status = HADA_OK;
    for (int t = 0; !status && t < open->count; t++) {
        page one;
        status = page_read(&one, open, t, region, err);
        for (size_t i = 0; !status && one.result.data && i < hada_image_count(&one.truth); i++) {
            const double result = (double)one.result.data[i];
            if (counts(&one, i)) {
                cross += result * (double)one.truth.data[i];
                square += result * result;
            }
        }
        page_free(&one);
    }
    *gain = square > 0 && isfinite(cross / square) ? cross / square : 1;
    return status;
}

/* What yardsticks say of one page. */
typedef struct marks {
    double mse, psnr, mae, ssim, sharpness, sharpness_truth, lpips, authors_psnr, authors_ssim;
} marks;

static hada_status measure(marks *of, const page *one, const hada_cli_yardstick *by, hada_error *err)
{
    const hada_image *result = &one->result, *truth = &one->truth;
    const unsigned char *mask = one->mask;
    const int ssim = truth->rows >= 11 && truth->cols >= 11;
    *of = (marks){.ssim = NAN, .lpips = NAN, .authors_psnr = NAN, .authors_ssim = NAN};
    hada_status status = hada_metric_mse(result, truth, mask, &of->mse, err);
    if (!status)
        status = hada_metric_psnr(result, truth, by->peak, mask, &of->psnr, err);
    if (!status)
        status = hada_metric_mae(result, truth, mask, &of->mae, err);
    if (!status && ssim)
        status = hada_metric_ssim(result, truth, by->peak, mask, &of->ssim, err);
    if (!status)
        status = hada_metric_sharpness(result, mask, &of->sharpness, err);
    if (!status)
        status = hada_metric_sharpness(truth, mask, &of->sharpness_truth, err);
    if (!status && by->lpips)
        status = hada_lpips_run(by->lpips, result, truth, by->peak, mask, &of->lpips, err);
    if (!status && by->authors)
        status = hada_metric_authors_psnr(result, truth, by->peak, mask, &of->authors_psnr, err);
    if (!status && by->authors && ssim)
        status = hada_metric_authors_ssim(result, truth, by->peak, mask, &of->authors_ssim, err);
    return status;
}

static hada_status add_page(hada_cli_score *score, page *one, const hada_cli_yardstick *by, double *square,
                            hada_error *err)
{
    marks of;
    for (size_t i = 0; score->gain != 1 && i < hada_image_count(&one->result); i++)
        one->result.data[i] = (float)((double)one->result.data[i] * score->gain);
    hada_status status = measure(&of, one, by, err);
    if (status)
        return status;
    score->pages++;
    *square += of.mse;
    /* Dark planes of a stack say how clean it is, not how good the picture. */
    if (score->what == HADA_CLI_STACKS && is_dark(one))
        return HADA_OK;
    score->occupied++;
    score->psnr += of.psnr;
    score->ssim += of.ssim;
    score->mae += of.mae;
    score->sharpness += of.sharpness;
    score->sharpness_truth += of.sharpness_truth;
    score->lpips += of.lpips;
    score->authors_psnr += of.authors_psnr;
    score->authors_ssim += of.authors_ssim;
    return HADA_OK;
}

static hada_status compare_images(hada_cli_score *score, files *open, const hada_cli_yardstick *by, hada_error *err)
{
    double square = 0;
    hada_status status = HADA_OK;
    if (by->match_gain)
        status = find_gain(open, &by->region, &score->gain, err);
    for (int t = 0; !status && t < open->count; t++) {
        page one;
        status = page_read(&one, open, t, &by->region, err);
        if (!status && !one.result.data)
            score->missing += !is_dark(&one);
        else if (!status && (status = add_page(score, &one, by, &square, err)))
            hada_cli_prefix(err, "%s and %s: ", open->result_path, open->truth_path);
        page_free(&one);
    }
    double count = score->occupied ? score->occupied : NAN;
    score->psnr /= count;
    score->ssim /= count;
    score->mae /= count;
    score->sharpness /= count;
    score->sharpness_truth /= count;
    score->lpips /= count;
    score->authors_psnr /= count;
    score->authors_ssim /= count;
    score->psnr_all = 10 * log10(by->peak * by->peak / (square / score->pages));
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
    if (path && hada_path_is_file(path) && !hada_tiff_open(&reader, path, &ignored)) {
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
        page one;
        hada_depth_score depth = {.size = sizeof depth};
        status = page_read(&one, open, t, &yardstick->region, err);
        if (!status)
            status = hada_metric_depth(&one.result, &one.truth, score->steps_known ? distances : NULL,
                                       score->steps_known ? count : 0, yardstick->tolerance, one.mask, &depth, err);
        page_free(&one);
        if (status)
            break;
        double here = depth.coverage * (double)depth.pixels;
        pixels += (double)depth.pixels;
        covered += here;
        if (here > 0) {
            within += depth.within * here;
            error += depth.mean_error_mm * here;
            steps += score->steps_known ? depth.mean_steps * here : 0;
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
