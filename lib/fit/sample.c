#include "fit/sample.h"

#include <hadalens/pixels.h>
#include <hadalens/response.h>

#include "fit/fitter.h"
#include "image/correct.h"
#include "image/statistics.h"

#define BETTER_ERRORS 2.0
/* A pair that gains far more than most, such as a dark scene's without a dark level, counts as so many times the
 * median: else it alone makes the mean uncertain. */
#define MOST_OF_MEDIAN 2.0

/* Reads pair number `pair` of a depth, its scene in all responses tried. */
hada_status hada_sample_take_pair(hada_sample *work, int depth, int pair, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    hada_pair taken = {0};
    hada_pixels pixels = {.size = sizeof pixels, .full_scale = HADA_AUTO};
    hada_status status = HADA_OK;
    if (!work->progress.what)
        work->progress = hada_progress_begin(options->monitor, "looks at pairs, for dark level and response", 0);
    HADA_TRY(hada_progress_step(&work->progress, NULL, err));
    HADA_TRY(hada_pair_take(&taken, work->pairs, depth, pair, err));
    if (!hada_reducer_fits(&work->reducer, taken.raw, taken.scene))
        goto done;
    HADA_TRY_OR_DONE(hada_reduce_frame(&work->reducer, taken.raw, &work->frame[work->count], err));
    if (!work->tried) {
        hada_pixels_of_image(&pixels, taken.raw);
        work->noise[work->count] = hada_noise_estimate(&pixels, options->mosaic) / work->reducer.factor;
    }
    work->depth[work->count] = depth;
    work->count++; /* from here on it is freed */
    for (int r = 0; r < work->tried; r++)
        HADA_TRY_OR_DONE(
            hada_reduce_scene(&work->reducer, taken.scene, work->response[r], &work->scene[work->count - 1][r], err));
done:
    hada_pair_return(&taken);
    return status;
}

void hada_sample_try_responses(hada_sample *work)
{
    static const double few[] = {HADA_RESPONSE_LINEAR, 1.5, HADA_RESPONSE_SRGB};
    const int open = work->options.scene_response == HADA_AUTO;
    work->tried = open ? HADA_COUNT(few) : 1;
    work->response = open ? few : &work->options.scene_response;
}

void hada_sample_forget(hada_sample *work)
{
    for (int k = 0; k < work->count; k++) {
        hada_image_destroy(&work->frame[k]);
        for (int r = 0; r < work->tried; r++)
            hada_image_destroy(&work->scene[k][r]);
    }
    work->count = 0;
}

/* Up to HADA_SAMPLE_EACH pairs, evenly spread, of the depths that are looked at. */
hada_status hada_sample_take(hada_sample *work, hada_error *err)
{
    const int depths = work->options.depths, looked = hada_least(depths, HADA_SAMPLE_DEPTHS);
    for (int k = 0; k < looked; k++) {
        const int z = hada_spread(k, looked, depths), all = work->counts[z];
        const int count = all < HADA_SAMPLE_LEAST ? 0 : hada_least(all, HADA_SAMPLE_EACH);
        for (int i = 0; i < count; i++)
            HADA_TRY(hada_sample_take_pair(work, z, (int)((long)i * all / count), err));
    }
    return HADA_OK;
}

hada_status hada_sample_begin(hada_sample *work, hada_error *err)
{
    HADA_TRY(hada_reducer_create(&work->reducer, &work->options, work->grid, err));
    HADA_TRY(hada_pair_level_create(&work->level, work->reducer.grid, work->options.channels, HADA_SAMPLE_MOST, err));
    return hada_sample_take(work, err);
}

void hada_sample_end(hada_sample *work)
{
    if (work->progress.what)
        hada_progress_end(&work->progress);
    hada_sample_forget(work);
    hada_pair_level_destroy(&work->level);
    hada_reducer_destroy(&work->reducer);
}

/* Where row or column i of a reduced frame lies on the sensor. */
static double place(int i, int count, int factor, int whole)
{
    return hada_smooth_place((i + 0.5) * factor + (whole - count * factor) / 2, whole);
}

double hada_sample_term(const hada_sample *work, int k, int row, int col)
{
    const hada_image *frame = &work->frame[0];
    return hada_smooth_term(k, place(row, frame->rows, work->reducer.factor, work->options.raw_rows),
                            place(col, frame->cols, work->reducer.factor, work->options.raw_cols));
}

void hada_sample_compare(hada_sample *work)
{
    double gain[HADA_SAMPLE_MOST], room[HADA_SAMPLE_MOST];
    for (int r = 0; r < work->tried; r++) {
        for (int k = 0; k < work->count; k++) {
            hada_pair_level_put(&work->level, k, work->depth[k], &work->frame[k], &work->scene[k][r]);
            gain[k] = 1.0;
        }
        hada_pair_level_judge(&work->level, gain, 0, work->unexplained[r][0], NULL);
        hada_pair_level_expose(&work->level, gain, work->unexplained[r][1], room);
    }
}

/* The geometric mean: shares of one response differ by ten from pair to pair, and their mean is that of the worst. */
double hada_sample_mean(const double *shares, int count)
{
    double sum = 0.0;
    for (int k = 0; k < count; k++)
        sum += log(fmax(shares[k], HADA_LEAST_SHARE)) / count;
    return exp(sum);
}

/* Whether so much less is left (a logarithm of each pair), surely. */
int hada_sample_is_better(const double *less, int count, double by)
{
    double kept[HADA_SAMPLE_MOST], gain = 0.0, spread = 0.0;
    memcpy(kept, less, (size_t)count * sizeof *less);
    const double most = MOST_OF_MEDIAN * fmax(hada_median(kept, (size_t)count), 0.0);
    for (int k = 0; k < count; k++) {
        kept[k] = fmin(less[k], most);
        gain += kept[k] / count;
    }
    for (int k = 0; k < count; k++)
        spread += (kept[k] - gain) * (kept[k] - gain);
    return gain > by && gain > BETTER_ERRORS * sqrt(spread / ((double)count * fmax(1.0, count - 1.0)));
}
