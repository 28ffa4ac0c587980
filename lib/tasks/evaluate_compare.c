/* One result against its truth. */
#include "tasks/evaluate_compare.h"

#include <hadalens/folder.h>
#include <hadalens/tiff.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "io/folder.h"

/* Distances that are the same but for the rounding of a file's text. */
#define SAME_DISTANCE 1e-3

static int ends_with(const char *name, size_t length, const char *end)
{
    const size_t tail = strlen(end);
    return length >= tail && !memcmp(name + length - tail, end, tail);
}

/* The length of a path without the ending of its file. */
static size_t stem_of(const char *path)
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    return (size_t)(name - path) + hada_name_stem(name);
}

static hada_evaluated kind_of(const char *path)
{
    const size_t length = stem_of(path);
    return ends_with(path, length, "_stack")   ? HADA_EVALUATED_STACK
           : ends_with(path, length, "_depth") ? HADA_EVALUATED_MAP
                                               : HADA_EVALUATED_IMAGES;
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
    const size_t results = (size_t)result->frames, truths = (size_t)truth->frames;
    hada_status status = HADA_OK;
    double *have = NULL, *want = NULL;
    int found = 0;
    HADA_TRY(hada_alloc((void **)&have, results, sizeof *have, "distances", err));
    HADA_TRY(hada_alloc((void **)&want, truths, sizeof *want, "distances", err));
    if (hada_tiff_distances(open->result, have, results) == results &&
        hada_tiff_distances(open->truth, want, truths) == truths)
        for (int t = 0; t < truth->frames; t++)
            for (int r = 0; r < result->frames && open->page[t] < 0; r++)
                if (fabs(have[r] - want[t]) < SAME_DISTANCE * want[t]) {
                    open->page[t] = r;
                    found++;
                }
    if (!found)
        HADA_TRY(hada_fail(err, HADA_ERROR_SIZE,
                           "%s has %d %s and %s has %d, and their distances do not tell which belong together",
                           open->result_path, result->frames, result->frames == 1 ? "image" : "images",
                           open->truth_path, truth->frames));
done:
    free(have);
    free(want);
    return status;
}

static hada_status open_tiff(hada_tiff_reader **reader, const char *path, hada_error *err)
{
    const hada_status status = hada_tiff_open(reader, path, err);
    if (status)
        hada_error_prefix_path(err, path);
    return status;
}

static hada_status files_open(files *open, const char *result, const char *truth, hada_error *err)
{
    hada_status status = HADA_OK;
    *open = (files){.result_path = result, .truth_path = truth};
    HADA_TRY(open_tiff(&open->result, result, err));
    HADA_TRY(open_tiff(&open->truth, truth, err));
    open->count = hada_tiff_get_info(open->truth)->frames;
    HADA_TRY(hada_alloc((void **)&open->page, (size_t)open->count, sizeof *open->page, "a list of pages", err));
    const int equal = hada_tiff_get_info(open->result)->frames == open->count;
    for (int t = 0; t < open->count; t++)
        open->page[t] = equal ? t : -1;
    if (!equal)
        HADA_TRY(match_slices(open, err));
done:
    return status;
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
    one->mask = NULL;
}

/* What the result has for page t of the truth. */
static hada_status read_result(page *one, const files *open, int t, hada_error *err)
{
    hada_image *result = &one->result;
    const hada_image *truth = &one->truth;
    hada_status status = hada_tiff_read(open->result, open->page[t], result, err);
    if (status)
        hada_error_prefix_path(err, open->result_path);
    else if (result->channels != truth->channels || result->rows != truth->rows || result->cols != truth->cols)
        status = hada_fail(err, HADA_ERROR_SIZE, "%s is %dx%d with %d %s, but %s is %dx%d with %d", open->result_path,
                           result->rows, result->cols, result->channels, result->channels == 1 ? "channel" : "channels",
                           open->truth_path, truth->rows, truth->cols, truth->channels);
    return status;
}

static hada_status page_read(page *one, const files *open, int t, const hada_region *region, hada_error *err)
{
    hada_image *truth = &one->truth;
    hada_status status = HADA_OK;
    int reading_truth = 1;
    *one = (page){0};
    HADA_TRY(hada_tiff_read(open->truth, t, truth, err));
    HADA_TRY(hada_region_mask(region, truth->rows, truth->cols, &one->mask, err));
    reading_truth = 0;
    if (open->page[t] >= 0) {
        HADA_TRY(read_result(one, open, t, err));
        HADA_TRY(hada_region_cut(region, &one->result, err));
    }
    HADA_TRY(hada_region_cut(region, truth, err));
done:
    if (status && reading_truth)
        hada_error_prefix_path(err, open->truth_path);
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
static hada_status find_gain(const files *open, const hada_region *region, double *gain, hada_error *err)
{
    double cross = 0, square = 0;
    hada_status status = HADA_OK;
    page one = {0};
    for (int t = 0; t < open->count; t++) {
        HADA_TRY(page_read(&one, open, t, region, err));
        for (size_t i = 0; one.result.data && i < hada_image_count(&one.truth); i++) {
            const double result = (double)one.result.data[i];
            if (counts(&one, i)) {
                cross += result * (double)one.truth.data[i];
                square += result * result;
            }
        }
        page_free(&one);
    }
done:
    page_free(&one);
    *gain = square > 0 && isfinite(cross / square) ? cross / square : 1;
    return status;
}

/* What yardsticks say of one page. */
typedef struct marks {
    double mse, psnr, mae, ssim, sharpness, sharpness_truth, lpips, authors_psnr, authors_ssim;
} marks;

static hada_status measure(marks *of, const page *one, const hada_evaluate_task *by, hada_error *err)
{
    enum { SSIM_LEAST = 11 }; /* its window */
    const hada_image *result = &one->result, *truth = &one->truth;
    const unsigned char *mask = one->mask;
    const int ssim = truth->rows >= SSIM_LEAST && truth->cols >= SSIM_LEAST;
    hada_status status = HADA_OK;
    *of = (marks){.ssim = NAN, .lpips = NAN, .authors_psnr = NAN, .authors_ssim = NAN};
    HADA_TRY(hada_metric_mse(result, truth, mask, &of->mse, err));
    HADA_TRY(hada_metric_psnr(result, truth, by->peak, mask, &of->psnr, err));
    HADA_TRY(hada_metric_mae(result, truth, mask, &of->mae, err));
    if (ssim)
        HADA_TRY(hada_metric_ssim(result, truth, by->peak, mask, &of->ssim, err));
    HADA_TRY(hada_metric_sharpness(result, mask, &of->sharpness, err));
    HADA_TRY(hada_metric_sharpness(truth, mask, &of->sharpness_truth, err));
    if (by->lpips)
        HADA_TRY(hada_lpips_run(by->lpips, result, truth, by->peak, mask, &of->lpips, err));
    if (by->authors)
        HADA_TRY(hada_metric_authors_psnr(result, truth, by->peak, mask, &of->authors_psnr, err));
    if (by->authors && ssim)
        HADA_TRY(hada_metric_authors_ssim(result, truth, by->peak, mask, &of->authors_ssim, err));
done:
    return status;
}

static hada_status add_page(hada_evaluation *score, page *one, const hada_evaluate_task *by, double *square,
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
    if (score->what == HADA_EVALUATED_STACK && is_dark(one))
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

static hada_status compare_images(hada_evaluation *score, const files *open, const hada_evaluate_task *by,
                                  const hada_region *region, hada_error *err)
{
    double square = 0;
    hada_status status = HADA_OK;
    page one = {0};
    if (by->match_gain)
        HADA_TRY(find_gain(open, region, &score->gain, err));
    for (int t = 0; t < open->count; t++) {
        HADA_TRY(page_read(&one, open, t, region, err));
        if (!one.result.data) {
            score->missing += !is_dark(&one);
        } else {
            status = add_page(score, &one, by, &square, err);
            if (status)
                hada_error_prefix(err, "%s and %s: ", open->result_path, open->truth_path);
            HADA_TRY(status);
        }
        page_free(&one);
    }
    const double count = score->occupied ? (double)score->occupied : (double)NAN;
    score->psnr /= count;
    score->ssim /= count;
    score->mae /= count;
    score->sharpness /= count;
    score->sharpness_truth /= count;
    score->lpips /= count;
    score->authors_psnr /= count;
    score->authors_ssim /= count;
    score->psnr_all = 10 * log10(by->peak * by->peak / (square / score->pages));
done:
    page_free(&one);
    return status;
}

/* The distances that the NAME_stack.tif beside a NAME_depth.tif states, freed with free(); 0 of them where there is
 * none, or one that cannot be read: then nothing is known. */
static hada_status distances_beside(double **out, int *count, const char *map_path, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_tiff_reader *reader = NULL;
    hada_error ignored;
    char *path = NULL;
    const size_t stem = stem_of(map_path), tail = strlen("_depth");
    *out = NULL;
    *count = 0;
    if (!ends_with(map_path, stem, "_depth"))
        return HADA_OK;
    HADA_TRY(hada_path_format(&path, err, "%.*s_stack%s", (int)(stem - tail), map_path, map_path + stem));
    if (!hada_path_is_file(path) || hada_tiff_open(&reader, path, &ignored))
        goto done;
    const size_t all = hada_tiff_distances(reader, NULL, 0);
    HADA_TRY(hada_alloc((void **)out, all + 1, sizeof **out, "distances", err));
    *count = (int)hada_tiff_distances(reader, *out, all);
done:
    hada_tiff_close(&reader);
    free(path);
    return status;
}

/* Sums over the frames of a sequence, weighted by their pixels. */
typedef struct depth_sums {
    double covered, pixels, within, error, steps;
} depth_sums;

static void add_map(depth_sums *sums, const hada_depth_score *depth, int steps_known)
{
    const double here = depth->coverage * (double)depth->pixels;
    sums->pixels += (double)depth->pixels;
    sums->covered += here;
    if (here > 0) {
        sums->within += depth->within * here;
        sums->error += depth->mean_error_mm * here;
        sums->steps += steps_known ? depth->mean_steps * here : 0;
    }
}

static hada_status compare_maps(hada_evaluation *score, const files *open, const hada_evaluate_task *by,
                                const hada_region *region, hada_error *err)
{
    hada_status status = HADA_OK;
    double *beside = NULL;
    const double *distances = by->distances_mm;
    int count = by->distances;
    depth_sums sums = {0};
    page one = {0};
    if (!count) {
        HADA_TRY(distances_beside(&beside, &count, open->truth_path, err));
        if (!count) {
            free(beside);
            HADA_TRY(distances_beside(&beside, &count, open->result_path, err));
        }
        distances = beside;
    }
    score->steps_known = count >= 2;
    for (int t = 0; t < open->count; t++) {
        hada_depth_score depth = {.size = sizeof depth};
        HADA_TRY(page_read(&one, open, t, region, err));
        HADA_TRY(hada_metric_depth(&one.result, &one.truth, score->steps_known ? distances : NULL,
                                   score->steps_known ? count : 0, by->tolerance, one.mask, &depth, err));
        add_map(&sums, &depth, score->steps_known);
        score->pages++;
        page_free(&one);
    }
    score->depth.size = sizeof score->depth;
    score->depth.pixels = (long long)sums.pixels;
    score->depth.coverage = sums.covered / sums.pixels;
    score->depth.within = sums.within / sums.covered;
    score->depth.mean_error_mm = sums.error / sums.covered;
    score->depth.mean_steps = score->steps_known ? sums.steps / sums.covered : NAN;
done:
    page_free(&one);
    free(beside);
    return status;
}

hada_status hada_evaluate_compare(hada_evaluation *one, const hada_evaluate_task *by, const hada_region *region,
                                  hada_error *err)
{
    hada_status status = HADA_OK;
    files open = {0};
    one->gain = 1;
    one->what = kind_of(one->truth);
    if (one->what == HADA_EVALUATED_IMAGES)
        one->what = kind_of(one->result);
    HADA_TRY(files_open(&open, one->result, one->truth, err));
    if (one->what == HADA_EVALUATED_MAP)
        HADA_TRY(compare_maps(one, &open, by, region, err));
    else
        HADA_TRY(compare_images(one, &open, by, region, err));
done:
    files_close(&open);
    return status;
}
