/* What the frames of pairs hold without the scenes' light: a dark level, or light of the room as a smooth surface. */
#include <hadalens/response.h>

#include "fit/fitter.h"
#include "fit/sample.h"
#include "image/correct.h"
#include "image/pixels.h"
#include "image/statistics.h"

/* Dark levels are tried in so many steps up to the darkest place of all frames, then between the best one's neighbours;
 * below LEAST_DARK of the brightest place none is looked for (of full scale it would be too much: 10 bits in a file of
 * 16 are small numbers). A level must leave less of the frames by this factor, surely (perf/results/learning.md). */
enum { LEVELS = 6, SECTIONS = 10 };
#define LEAST_DARK  1e-3
#define DARK_BETTER 1.5
/* A surface must leave less by this factor; whether it is right, confirm.c says. */
#define SURFACE_BETTER 1.2

/* Of Gaussian noise one value in a hundred is so many standard deviations below the mean. */
#define FIRST_PERCENTILE 2.326

/* The darkest place of all frames: of each the first percentile of its reduced pixels, were they without noise. */
static double darkest(const hada_sample *work)
{
    double least = INFINITY;
    for (int k = 0; k < work->count; k++) {
        const hada_image *frame = &work->frame[k];
        const size_t area = (size_t)frame->rows * (size_t)frame->cols;
        for (size_t c = 0; c < (size_t)frame->channels; c++)
            least = fmin(least, hada_first_percentile(frame->data + c * area, area, work->reducer.room) +
                                    FIRST_PERCENTILE * work->noise[k]);
    }
    return least;
}

/* Logarithms of what is left of each frame less a level, with the response and exposures that leave least. */
typedef struct left_over {
    double level, log[HADA_SAMPLE_MOST], mean;
} left_over;

static void darken(hada_sample *work, double level)
{
    for (int k = 0; k < work->count; k++)
        for (size_t i = 0; i < hada_image_count(&work->frame[k]); i++)
            work->frame[k].data[i] -= (float)(level - work->dark);
    work->dark = level;
}

static left_over try_level(hada_sample *work, double level)
{
    left_over best = {.level = level, .mean = INFINITY};
    darken(work, level);
    hada_sample_compare(work);
    for (int row = 0; row < 2 * work->tried; row++) {
        const double *shares = work->unexplained[row / 2][row % 2];
        left_over now = {.level = level};
        for (int k = 0; k < work->count; k++) {
            now.log[k] = log(fmax(shares[k], HADA_LEAST_SHARE) * work->level.frame_energy[k]);
            now.mean += now.log[k] / work->count;
        }
        best = now.mean < best.mean ? now : best;
    }
    return best;
}

/* By golden sections, after steps of one length. */
static left_over best_level(hada_sample *work, left_over none, double most)
{
    const double golden = 0.5 * (sqrt(5.0) - 1.0), step = most / LEVELS;
    left_over best = none;
    for (int i = 1; i <= LEVELS; i++) {
        const left_over now = try_level(work, i * step);
        best = now.mean < best.mean ? now : best;
    }
    double low = fmax(0.0, best.level - step), high = fmin(most, best.level + step);
    left_over left = try_level(work, high - golden * (high - low));
    left_over right = try_level(work, low + golden * (high - low));
    for (int i = 0; i < SECTIONS; i++)
        if (left.mean < right.mean) {
            high = right.level;
            right = left;
            left = try_level(work, high - golden * (high - low));
        } else {
            low = left.level;
            left = right;
            right = try_level(work, low + golden * (high - low));
        }
    best = left.mean < best.mean ? left : best;
    return right.mean < best.mean ? right : best;
}

/* The level where less is left of the frames with it, surely; otherwise none. */
static left_over choose_level(hada_sample *work, left_over none, double most)
{
    double less[HADA_SAMPLE_MOST];
    const left_over best = best_level(work, none, most);
    for (int k = 0; k < work->count; k++)
        less[k] = none.log[k] - best.log[k];
    return hada_sample_is_better(less, work->count, log(DARK_BETTER)) ? best : none;
}

/* The surface on the sensor, where less is left with it than otherwise, surely; no channel of it is dark in the mean.
 */
static hada_status draw(const hada_sample *work, const hada_light *from, const left_over *otherwise, hada_image *out,
                        hada_error *err)
{
    const hada_fit_options *options = &work->options;
    if (!(otherwise->mean - from->mean > log(SURFACE_BETTER)))
        return HADA_OK;
    for (int c = 0; c < options->channels; c++)
        if (!(hada_smooth_mean(from->weight + (size_t)c * HADA_SMOOTH_TERMS) > 0.0))
            return HADA_OK;
    HADA_TRY(hada_image_create(out, options->channels, options->raw_rows, options->raw_cols, err));
    hada_smooth_add(from->weight, 1.0, out);
    return HADA_OK;
}

/* With exposures alike or apart, as leaves less. */
static hada_status find_surface(hada_sample *work, const left_over *otherwise, hada_image *out, hada_error *err)
{
    hada_light alike = {0}, apart = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_sample_find_light(work, 0, 0, &alike, err));
    HADA_TRY_OR_DONE(hada_sample_find_light(work, 0, 1, &apart, err));
    HADA_TRY_OR_DONE(draw(work, apart.mean < alike.mean ? &apart : &alike, otherwise, out, err));
done:
    hada_light_free(&alike);
    hada_light_free(&apart);
    return status;
}

hada_status hada_fit_find_dark(hada_fit_options *options, const hada_dataset *pairs, hada_image *found, hada_error *err)
{
    hada_sample work = {.options = *options, .pairs = pairs, .counts = hada_dataset_get_info(pairs)->counts};
    left_over none, level;
    double least = 0.0;
    hada_status status = HADA_OK;
    if (options->dark != 0.0 || hada_dataset_get_info(pairs)->dark_frame)
        options->find_dark = 0;
    if (!options->find_dark)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_sample_begin(&work, err));
    const double most = darkest(&work);
    for (int k = 0; k < work.count; k++)
        least = fmax(least, LEAST_DARK * (double)hada_image_brightest(&work.frame[k]));
    if (work.count < HADA_SAMPLE_LEAST || (most < least && !found))
        goto done;
    hada_sample_forget(&work);
    hada_sample_try_responses(&work);
    HADA_TRY_OR_DONE(hada_sample_take(&work, err));
    none = level = try_level(&work, 0.0);
    if (most >= least)
        level = choose_level(&work, none, most);
    darken(&work, 0.0);
    if (found)
        HADA_TRY_OR_DONE(find_surface(&work, &level, found, err));
    options->dark = level.level;
done:
    options->find_dark = !status && (options->dark > 0.0 || (found && found->data));
    hada_sample_end(&work);
    return status;
}
