/* Results against the truth: which files go together, and one result against its truth. */

#include "core/callers.h"
#include "io/folder.h"
#include "metrics/metrics.h"
#include "tasks/evaluate.h"

/* One result against its truth. */

enum { SSIM_LEAST = 11 }; /* its window */

static hada_evaluated kind_of(const char *path)
{
    const size_t length = hada_stem_of(path);
    return hada_stem_ends(path, length, "_stack")   ? HADA_EVALUATED_STACK
           : hada_stem_ends(path, length, "_depth") ? HADA_EVALUATED_MAP
                                                    : HADA_EVALUATED_IMAGES;
}

static int is_table(const char *path)
{
    return hada_stem_ends(path, strlen(path), ".csv");
}

static int is_dark(const hada_compared_page *one)
{
    for (size_t i = 0; i < hada_image_count(&one->truth); i++)
        if (one->truth.data[i] != 0.0f && hada_compared_counts(one, i))
            return 0;
    return 1;
}

/* The factor from 0 on that brings the result nearest to the truth: no negative turned into a picture. */
static hada_status find_gain(const hada_compared *open, const hada_region *region, double *gain, hada_error *err)
{
    double cross = 0, square = 0;
    hada_status status = HADA_OK;
    hada_compared_page one = {0};
    for (int t = 0; t < open->count; t++) {
        HADA_TRY_OR_DONE(hada_compared_read(&one, open, t, 0, region, err));
        for (size_t i = 0; one.result.data && i < hada_image_count(&one.truth); i++) {
            const double result = (double)one.result.data[i];
            if (hada_compared_counts(&one, i)) {
                cross += result * (double)one.truth.data[i];
                square += result * result;
            }
        }
        hada_compared_page_free(&one);
    }
done:
    hada_compared_page_free(&one);
    *gain = square > 0 && isfinite(cross / square) ? fmax(cross / square, 0.0) : 1;
    return status;
}

/* Places of an image: at jumps of the true distances, and away from them. */
enum { JUMPS, AWAY, PLACES };

/* What counts at each place; NULL: nothing. Freed with free(). */
static hada_status find_places(unsigned char *mask[PLACES], const hada_compared *open, int t,
                               const hada_compared_page *one, const hada_evaluate_task *by, const hada_region *region,
                               hada_error *err)
{
    static const hada_depth_part which[PLACES] = {HADA_DEPTH_JUMP, HADA_DEPTH_AWAY};
    const size_t pixels = (size_t)one->truth.rows * (size_t)one->truth.cols;
    unsigned char *parts = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_evaluate_parts_beside(&parts, open, t, one, by, region, err));
    for (int k = 0; parts && k < PLACES; k++) {
        size_t found = 0;
        HADA_TRY_OR_DONE(HADA_NEW(mask[k], pixels, "a mask", err));
        for (size_t i = 0; i < pixels; i++)
            found += mask[k][i] = (unsigned char)(parts[i] == which[k] && hada_compared_counts(one, i));
        if (!found) {
            free(mask[k]);
            mask[k] = NULL;
        }
    }
done:
    free(parts);
    return status;
}

/* What yardsticks say of one page. */
typedef struct marks {
    double mse, psnr, mae, ssim, sharpness, sharpness_truth, lpips, authors_psnr, authors_ssim;
    double place_psnr[PLACES], place_ssim[PLACES];
} marks;

/* Structural similarities: of all that counts, as the 2022 paper's code has it, and of the places. */
static hada_status measure_ssim(marks *of, const hada_compared_page *one, unsigned char *const place[PLACES],
                                const hada_evaluate_task *by, hada_error *err)
{
    const hada_similarity kinds[] = {{.peak = by->peak, .mask = one->mask},
                                     {.peak = HADA_AUTHORS_RANGE * by->peak, .mask = one->mask},
                                     {.peak = by->peak, .mask = place[JUMPS]},
                                     {.peak = by->peak, .mask = place[AWAY]}};
    const int wanted[] = {1, by->authors, place[JUMPS] != NULL, place[AWAY] != NULL};
    double *const to[] = {&of->ssim, &of->authors_ssim, &of->place_ssim[JUMPS], &of->place_ssim[AWAY]};
    enum { KINDS = sizeof kinds / sizeof *kinds };
    hada_similarity list[KINDS];
    int count = 0;
    for (int k = 0; k < KINDS; k++)
        if (wanted[k])
            list[count++] = kinds[k];
    HADA_TRY(hada_similarities(&one->result, &one->truth, list, count, err));
    if (!list[0].pixels)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "the mask leaves no pixel to compare"));
    count = 0;
    for (int k = 0; k < KINDS; k++)
        if (wanted[k])
            *to[k] = list[count++].mean; /* of a place that is all too near to the edges: NaN */
    return HADA_OK;
}

static hada_status measure(marks *of, const hada_compared_page *one, unsigned char *const place[PLACES],
                           const hada_evaluate_task *by, hada_error *err)
{
    const hada_image *result = &one->result, *truth = &one->truth;
    const unsigned char *mask = one->mask;
    *of = (marks){.ssim = NAN, .lpips = NAN, .authors_psnr = NAN, .authors_ssim = NAN, .place_ssim = {NAN, NAN}};
    HADA_TRY(hada_metric_compare(HADA_METRIC_MSE, result, truth, 1.0, mask, &of->mse, err));
    HADA_TRY(hada_metric_compare(HADA_METRIC_PSNR, result, truth, by->peak, mask, &of->psnr, err));
    HADA_TRY(hada_metric_compare(HADA_METRIC_MAE, result, truth, 1.0, mask, &of->mae, err));
    if (truth->rows >= SSIM_LEAST && truth->cols >= SSIM_LEAST)
        HADA_TRY(measure_ssim(of, one, place, by, err));
    HADA_TRY(hada_metric_sharpness(result, mask, &of->sharpness, err));
    HADA_TRY(hada_metric_sharpness(truth, mask, &of->sharpness_truth, err));
    if (by->lpips) {
        hada_lpips_watch(by->lpips, by->monitor);
        const hada_status status = hada_lpips_run(by->lpips, result, truth, by->peak, mask, &of->lpips, err);
        hada_lpips_watch(by->lpips, NULL);
        HADA_TRY(status);
    }
    if (by->authors)
        HADA_TRY(hada_metric_compare(HADA_METRIC_AUTHORS_PSNR, result, truth, by->peak, mask, &of->authors_psnr, err));
    for (int k = 0; k < PLACES; k++)
        if (place[k])
            HADA_TRY(hada_metric_compare(HADA_METRIC_PSNR, result, truth, by->peak, place[k], &of->place_psnr[k], err));
    return HADA_OK;
}

/* Sums over the pages. */
typedef struct sums {
    double square, psnr[PLACES], ssim[PLACES];
    int pages[PLACES];
} sums;

static hada_status add_page(hada_evaluation *score, sums *of_all, hada_compared_page *one,
                            unsigned char *const place[PLACES], const hada_evaluate_task *by, hada_error *err)
{
    marks of;
    for (size_t i = 0; score->gain != 1 && i < hada_image_count(&one->result); i++)
        one->result.data[i] = (float)((double)one->result.data[i] * score->gain);
    HADA_TRY(measure(&of, one, place, by, err));
    score->pages++;
    of_all->square += of.mse;
    for (int k = 0; k < PLACES; k++)
        if (place[k]) {
            of_all->psnr[k] += of.place_psnr[k];
            of_all->ssim[k] += of.place_ssim[k];
            of_all->pages[k]++;
        }
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

/* A page of the truth, with what stands beside it and what the result has for it. */
static hada_status compare_page(hada_evaluation *score, sums *of_all, const hada_compared *open, int t,
                                const hada_evaluate_task *by, const hada_region *region, hada_error *err)
{
    unsigned char *place[PLACES] = {NULL};
    hada_compared_page one = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_compared_read(&one, open, t, 0, region, err));
    if (!one.result.data) {
        score->missing += !is_dark(&one);
        goto done;
    }
    HADA_TRY_OR_DONE(find_places(place, open, t, &one, by, region, err));
    status = add_page(score, of_all, &one, place, by, err);
    if (status)
        hada_error_prefix(err, "%s and %s: ", open->result_path, open->truth_path);
done:
    for (int k = 0; k < PLACES; k++)
        free(place[k]);
    hada_compared_page_free(&one);
    return status;
}

static hada_status compare_images(hada_evaluation *score, const hada_compared *open, const hada_evaluate_task *by,
                                  const hada_region *region, hada_error *err)
{
    sums all = {0};
    if (by->match_gain)
        HADA_TRY(find_gain(open, region, &score->gain, err));
    for (int t = 0; t < open->count; t++)
        HADA_TRY(compare_page(score, &all, open, t, by, region, err));
    const double count = score->occupied ? (double)score->occupied : (double)NAN;
    score->psnr /= count;
    score->ssim /= count;
    score->mae /= count;
    score->sharpness /= count;
    score->sharpness_truth /= count;
    score->lpips /= count;
    score->authors_psnr /= count;
    score->authors_ssim /= count;
    score->psnr_jumps = all.psnr[JUMPS] / all.pages[JUMPS];
    score->psnr_away = all.psnr[AWAY] / all.pages[AWAY];
    score->ssim_jumps = all.ssim[JUMPS] / all.pages[JUMPS];
    score->ssim_away = all.ssim[AWAY] / all.pages[AWAY];
    score->psnr_all = 10 * log10(by->peak * by->peak / (all.square / score->pages));
    return HADA_OK;
}

/* one->result and one->truth are given, the rest is filled in. */
static hada_status evaluate_compare(hada_evaluation *one, const hada_evaluate_task *by, const hada_region *region,
                                    hada_error *err)
{
    hada_status status = HADA_OK;
    hada_compared open = {0};
    one->gain = 1;
    one->psnr_jumps = one->psnr_away = one->ssim_jumps = one->ssim_away = NAN;
    one->steps_jumps = one->steps_away = one->within_jumps = one->within_away = NAN;
    one->coverage_jumps = one->coverage_away = one->outside = one->outside_unknown = NAN;
    one->confident_half = one->risk = NAN;
    one->recall = one->precision = one->f1 = one->jaccard = one->lateral_rmse = one->axial_rmse = one->switches = NAN;
    if (is_table(one->result) && is_table(one->truth)) {
        one->what = HADA_EVALUATED_EMITTERS;
        return hada_evaluate_emitters(one, by, err);
    }
    one->what = kind_of(one->truth);
    if (one->what == HADA_EVALUATED_IMAGES)
        one->what = kind_of(one->result);
    HADA_TRY_OR_DONE(hada_compared_open(&open, one->result, one->truth, err));
    open.monitor = by->monitor;
    one->downsample = open.times;
    if (one->what == HADA_EVALUATED_MAP) {
        HADA_TRY_OR_DONE(hada_evaluate_maps(one, &open, by, region, err));
    } else {
        HADA_TRY_OR_DONE(hada_compared_encode(&open, by->truth_encoding, by->encoding, err));
        one->result_encoding = open.result_encoding;
        one->encoding = open.encoding;
        HADA_TRY_OR_DONE(compare_images(one, &open, by, region, err));
    }
done:
    hada_compared_close(&open);
    return status;
}

struct hada_evaluate_report {
    hada_evaluation *rows; /* their names are on the heap */
    int count;
};

/* The result that belongs to a truth file: the same name, else NAME_aif.tif for NAME.tif; NULL: none. */
static hada_status find_result(char **out, const char *folder, const char *stem, hada_error *err)
{
    static const char *const endings[] = {".tif", ".tiff", "_aif.tif"};
    hada_status status = HADA_OK;
    int there = 0;
    *out = NULL;
    for (size_t k = 0; !there && k < sizeof endings / sizeof *endings; k++) {
        free(*out);
        HADA_TRY_OR_DONE(hada_path_format(out, err, "%s/%s%s", folder, stem, endings[k]));
        HADA_TRY_OR_DONE(hada_path_finds_file(*out, &there, err));
    }
done:
    if (!there) {
        free(*out);
        *out = NULL;
    }
    return status;
}

/* A row named after a file, that of `named`. */
static hada_status add(hada_evaluate_report *report, const char *named, const char *result, const char *truth,
                       hada_error *err)
{
    hada_status status = HADA_OK;
    char *name = NULL, *result_copy = NULL, *truth_copy = NULL;
    HADA_TRY_OR_DONE(hada_path_stem(&name, named, err));
    HADA_TRY_OR_DONE(hada_path_format(&result_copy, err, "%s", result));
    HADA_TRY_OR_DONE(hada_path_format(&truth_copy, err, "%s", truth));
    report->rows[report->count++] =
        (hada_evaluation){.size = sizeof(hada_evaluation), .name = name, .result = result_copy, .truth = truth_copy};
    name = result_copy = truth_copy = NULL;
done:
    HADA_FREE(name, result_copy, truth_copy);
    return status;
}

static hada_status add_file(hada_evaluate_report *report, const char *folder, const char *truth_folder,
                            const char *file, int *alone, hada_error *err)
{
    hada_status status = HADA_OK;
    char *stem = NULL, *result = NULL;
    hada_path truth;
    if (hada_stem_ends(file, hada_stem_of(file), "_depth2")) /* goes with NAME_depth.tif */
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_path_stem(&stem, file, err));
    HADA_TRY_OR_DONE(find_result(&result, folder, stem, err));
    *alone += !result;
    if (result) {
        HADA_TRY_OR_DONE(hada_path_write(truth, err, "%s/%s", truth_folder, file));
        HADA_TRY_OR_DONE(add(report, file, result, truth, err));
    }
done:
    HADA_FREE(stem, result);
    return status;
}

static hada_status list_folders(hada_evaluate_report *report, const char *result, const char *truth,
                                const hada_monitor *monitor, hada_error *err)
{
    hada_status status = HADA_OK;
    char **names = NULL;
    int count = 0, alone = 0;
    HADA_TRY_OR_DONE(hada_folder_list_tiffs(truth, &names, &count, err));
    HADA_TRY_OR_DONE(HADA_NEW(report->rows, (size_t)count + 1, "a list of files", err));
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(add_file(report, result, truth, names[i], &alone, err));
    if (!report->count)
        HADA_TRY_OR_DONE(hada_fail(
            err, HADA_ERROR_DATASET,
            "no TIFF file in %s has a partner in %s; NAME.tif goes with NAME.tif or NAME_aif.tif", truth, result));
    if (alone)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "%d %s in %s without a result in %s", alone,
                          alone == 1 ? "file" : "files", truth, result);
done:
    hada_names_free(&names, &count);
    return status;
}

static hada_status list(hada_evaluate_report *report, const char *result, const char *truth,
                        const hada_monitor *monitor, hada_error *err)
{
    hada_stands one, other;
    HADA_TRY(hada_path_kind(result, &one, err));
    HADA_TRY(hada_path_kind(truth, &other, err));
    const int folder = one == HADA_STANDS_FOLDER;
    if (folder != (other == HADA_STANDS_FOLDER))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "%s is a folder and %s is not; give two files or two folders",
                           folder ? result : truth, folder ? truth : result));
    if (folder)
        return list_folders(report, result, truth, monitor, err);
    HADA_TRY(HADA_NEW(report->rows, 1, "a list of files", err));
    return add(report, result, result, truth, err);
}

hada_status hada_evaluate_run(hada_evaluate_report **out, const char *result, const char *truth,
                              const hada_evaluate_task *callers, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_evaluate_report *report = NULL;
    hada_evaluate_task task;
    hada_region region = {0};
    HADA_NEED(out && result && truth, err);
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&task, callers, hada_evaluate_task, err));
    if (!(task.peak > 0.0) || !(task.tolerance > 0.0))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT, "options.peak and options.tolerance must be greater than zero"));
    if (!(task.gate_pixels > 0.0) || !(task.gate_depths > 0.0))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT,
                                   "options.gate_pixels and options.gate_depths must be greater than zero"));
    HADA_TRY_OR_DONE(hada_region_read(&region, &task, err));
    HADA_TRY_OR_DONE(HADA_NEW(report, 1, "a report", err));
    HADA_TRY_OR_DONE(list(report, result, truth, task.monitor, err));
    for (int i = 0; i < report->count; i++) {
        HADA_TRY_OR_DONE(evaluate_compare(&report->rows[i], &task, &region, err));
        HADA_TRY_OR_DONE(hada_monitor_check(task.monitor, err));
    }
    if (report->rows[0].downsample > 1)
        hada_monitor_tell(
            task.monitor, HADA_MESSAGE_NOTE,
            "the truth has %d times the rows and columns of the results, and is binned as the frames were",
            report->rows[0].downsample);
    *out = report;
    report = NULL;
done:
    hada_region_free(&region);
    hada_evaluate_report_destroy(&report);
    return status;
}

int hada_evaluate_report_count(const hada_evaluate_report *report)
{
    return report ? report->count : 0;
}

const hada_evaluation *hada_evaluate_report_get(const hada_evaluate_report *report, int index)
{
    return report && index >= 0 && index < report->count ? &report->rows[index] : NULL;
}

void hada_evaluate_report_destroy(hada_evaluate_report **pointer)
{
    hada_evaluate_report *report = hada_taken(pointer);
    if (!report)
        return;
    for (int i = 0; i < report->count; i++) {
        free((void *)(uintptr_t)report->rows[i].name);
        free((void *)(uintptr_t)report->rows[i].result);
        free((void *)(uintptr_t)report->rows[i].truth);
    }
    HADA_FREE(report->rows, report);
}
