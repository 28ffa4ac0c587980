/* One result against its truth. */
#include "tasks/evaluate_compare.h"

#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "tasks/evaluate_map.h"
#include "tasks/evaluate_pages.h"

enum { SSIM_LEAST = 11 }; /* its window */

static hada_evaluated kind_of(const char *path)
{
    const size_t length = hada_stem_of(path);
    return hada_stem_ends(path, length, "_stack")   ? HADA_EVALUATED_STACK
           : hada_stem_ends(path, length, "_depth") ? HADA_EVALUATED_MAP
                                                    : HADA_EVALUATED_IMAGES;
}

static int is_dark(const hada_compared_page *one)
{
    for (size_t i = 0; i < hada_image_count(&one->truth); i++)
        if (one->truth.data[i] != 0.0f && hada_compared_counts(one, i))
            return 0;
    return 1;
}

/* The factor that brings the result nearest to the truth. */
static hada_status find_gain(const hada_compared *open, const hada_region *region, double *gain, hada_error *err)
{
    double cross = 0, square = 0;
    hada_status status = HADA_OK;
    hada_compared_page one = {0};
    for (int t = 0; t < open->count; t++) {
        HADA_TRY(hada_compared_read(&one, open, t, region, err));
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
    *gain = square > 0 && isfinite(cross / square) ? cross / square : 1;
    return status;
}

/* What yardsticks say of one page. */
typedef struct marks {
    double mse, psnr, mae, ssim, sharpness, sharpness_truth, lpips, authors_psnr, authors_ssim;
} marks;

static hada_status measure(marks *of, const hada_compared_page *one, const hada_evaluate_task *by, hada_error *err)
{
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

static hada_status add_page(hada_evaluation *score, hada_compared_page *one, const hada_evaluate_task *by,
                            double *square, hada_error *err)
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

/* PSNR and SSIM at jumps of the true distances and away from them. */
typedef struct places {
    double psnr[2], ssim[2];
    int pages[2];
} places;

static hada_status add_places(places *sums, const hada_compared *open, int t, const hada_compared_page *one,
                              const hada_evaluate_task *by, const hada_region *region, hada_error *err)
{
    static const hada_depth_part which[] = {HADA_DEPTH_JUMP, HADA_DEPTH_AWAY};
    const size_t pixels = (size_t)one->truth.rows * (size_t)one->truth.cols;
    unsigned char *parts = NULL, *mask = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_evaluate_parts_beside(&parts, open, t, one, by, region, err));
    if (!parts)
        goto done;
    HADA_TRY(hada_alloc((void **)&mask, pixels, 1, "a mask", err));
    for (int k = 0; k < 2; k++) {
        double psnr, ssim = NAN;
        size_t found = 0;
        for (size_t i = 0; i < pixels; i++)
            found += mask[i] = (unsigned char)(parts[i] == which[k] && hada_compared_counts(one, i));
        if (!found)
            continue;
        HADA_TRY(hada_metric_psnr(&one->result, &one->truth, by->peak, mask, &psnr, err));
        if (one->truth.rows >= SSIM_LEAST && one->truth.cols >= SSIM_LEAST &&
            hada_metric_ssim(&one->result, &one->truth, by->peak, mask, &ssim, NULL))
            ssim = NAN; /* all of the place is too near to the edges */
        sums->psnr[k] += psnr;
        sums->ssim[k] += ssim;
        sums->pages[k]++;
    }
done:
    free(parts);
    free(mask);
    return status;
}

static hada_status compare_images(hada_evaluation *score, const hada_compared *open, const hada_evaluate_task *by,
                                  const hada_region *region, hada_error *err)
{
    double square = 0;
    places at = {0};
    hada_status status = HADA_OK;
    hada_compared_page one = {0};
    if (by->match_gain)
        HADA_TRY(find_gain(open, region, &score->gain, err));
    for (int t = 0; t < open->count; t++) {
        HADA_TRY(hada_compared_read(&one, open, t, region, err));
        if (!one.result.data) {
            score->missing += !is_dark(&one);
        } else {
            status = add_page(score, &one, by, &square, err);
            if (status)
                hada_error_prefix(err, "%s and %s: ", open->result_path, open->truth_path);
            HADA_TRY(status);
            HADA_TRY(add_places(&at, open, t, &one, by, region, err));
        }
        hada_compared_page_free(&one);
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
    score->psnr_jumps = at.psnr[0] / at.pages[0];
    score->psnr_away = at.psnr[1] / at.pages[1];
    score->ssim_jumps = at.ssim[0] / at.pages[0];
    score->ssim_away = at.ssim[1] / at.pages[1];
    score->psnr_all = 10 * log10(by->peak * by->peak / (square / score->pages));
done:
    hada_compared_page_free(&one);
    return status;
}

hada_status hada_evaluate_compare(hada_evaluation *one, const hada_evaluate_task *by, const hada_region *region,
                                  hada_error *err)
{
    hada_status status = HADA_OK;
    hada_compared open = {0};
    one->gain = 1;
    one->psnr_jumps = one->psnr_away = one->ssim_jumps = one->ssim_away = NAN;
    one->steps_jumps = one->steps_away = one->within_jumps = one->within_away = NAN;
    one->coverage_jumps = one->coverage_away = one->outside = one->outside_unknown = NAN;
    one->confident_half = one->risk = NAN;
    one->what = kind_of(one->truth);
    if (one->what == HADA_EVALUATED_IMAGES)
        one->what = kind_of(one->result);
    HADA_TRY(hada_compared_open(&open, one->result, one->truth, err));
    if (one->what == HADA_EVALUATED_MAP) {
        HADA_TRY(hada_evaluate_maps(one, &open, by, region, err));
    } else {
        HADA_TRY(hada_compared_encode(&open, by->truth_encoding, by->encoding, err));
        one->result_encoding = open.result_encoding;
        one->encoding = open.encoding;
        HADA_TRY(compare_images(one, &open, by, region, err));
    }
done:
    hada_compared_close(&open);
    return status;
}
