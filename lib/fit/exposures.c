/* How bright frames are beside what their scenes make, with the crop in the model: exposures, more precise than a
 * survey of small copies gives them, and white balance, which is an exposure of each channel. */
#include "core/numbers.h"
#include "fit/look.h"
#include "image/correct.h"

/* Both become more precise in so many rounds, in each by this factor at most. */
enum { ROUNDS = 3 };
#define MOST_CHANGE 1.5
/* Frames whose channels differ so much in exposure (a root mean square of logarithms, of the first round) differ in
 * white balance: simulated ones that did by a tenth gave 0.11 to 0.17, by a twentieth 0.03 to 0.06, those that did not
 * 0.004, six real ones 0.03 (perf/results/learning.md). */
#define UNBALANCED 0.1

/* The exposure of a frame by what its scene makes, with a smooth surface beside it where light is to be left out:
 * least squares of pixels that are known. */
static double exposure_of(const hada_look *at, int pair, const hada_image *frame, double dark, const float *made)
{
    enum { MOST = 1 + HADA_SMOOTH_TERMS };
    const int rows = at->options->raw_rows, cols = at->options->raw_cols, n = at->centred || at->smooth ? MOST : 1;
    const float *weights = at->weights[pair].data;
    double normal[MOST * MOST] = {0.0}, right[MOST] = {0.0}, term[MOST];
    for (int p = 0; p < rows * cols; p++) {
        const double y = hada_smooth_place(p / cols + 0.5, rows), x = hada_smooth_place(p % cols + 0.5, cols);
        for (int k = 0; k < n && (!weights || weights[p] == 1.0f); k++) {
            term[k] = k ? hada_smooth_term(k - 1, y, x) : (double)made[p];
            right[k] += term[k] * ((double)frame->data[p] - dark);
            for (int j = 0; j <= k; j++)
                normal[k * n + j] += term[k] * term[j];
        }
    }
    if (!hada_cholesky_factor(normal, n))
        return 1.0;
    hada_cholesky_solve(normal, n, right);
    return right[0] > 0.0 ? fmin(fmax(right[0], 1.0 / MOST_CHANGE), MOST_CHANGE) : 1.0;
}

/* Exposures of the pairs that `at` names, from what they make of each other together. Their geometric mean is 1. */
static hada_status expose(hada_look *at, const hada_dataset *pairs, double *times, hada_error *err)
{
    const size_t area = (size_t)at->options->raw_rows * (size_t)at->options->raw_cols;
    double dark[HADA_LOOK_MOST], mean = 0.0;
    hada_image frame[HADA_LOOK_MOST];
    float *made = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(made, (size_t)at->group * area, "frames", err));
    HADA_TRY_OR_DONE(hada_look_take(at, pairs, err));
    HADA_TRY_OR_DONE(hada_look_predict(at, made, frame, dark, err));
    for (int i = 0; i < at->group; i++) {
        times[i] = exposure_of(at, i, &frame[i], dark[i], made + (size_t)i * area);
        mean += log(times[i]) / at->group;
    }
    for (int i = 0; i < at->group; i++)
        times[i] /= exp(mean);
done:
    free(made);
    hada_look_return(at);
    return status;
}

/* Groups of pairs of a depth that make something of each other, and the first and number of the pairs of one. */
static int groups_of(int count)
{
    return count >= HADA_LOOK_LEAST ? (count + HADA_LOOK_MOST - 1) / HADA_LOOK_MOST : 0;
}

static hada_look group_of(hada_context *context, const hada_fit_options *options, const hada_dataset *pairs, int depth,
                          int group)
{
    const int count = hada_dataset_get_info(pairs)->counts[depth], groups = groups_of(count);
    hada_look at = {.context = context, .options = options, .depth = depth, .first = count * group / groups};
    at.group = count * (group + 1) / groups - at.first;
    hada_look_ignore_light(&at, pairs, depth);
    return at;
}

hada_status hada_fit_expose_depth(const hada_survey *survey, const hada_fit_options *fit, int depth,
                                  hada_context *context, const hada_dataset *pairs, hada_error *err)
{
    double *gain = (double *)(uintptr_t)survey->gains[depth], times[HADA_LOOK_MOST];
    hada_fit_options options = *fit;
    hada_dataset *even = NULL;
    hada_status status = HADA_OK;
    options.scene_response = survey->response;
    for (int g = 0; g < groups_of(hada_dataset_get_info(pairs)->counts[depth]); g++)
        for (int round = 0; round < ROUNDS; round++) {
            hada_look at = group_of(context, &options, pairs, depth, g);
            HADA_TRY_OR_DONE(hada_survey_apply(&even, survey, pairs, err));
            HADA_TRY_OR_DONE(expose(&at, even, times, err));
            hada_dataset_destroy(&even);
            for (int i = 0; i < at.group; i++)
                gain[at.first + i] *= times[i];
        }
done:
    hada_dataset_destroy(&even);
    return status;
}

/* How much light of a depth's scenes, exposed as the survey says, reaches the sensor and beyond. */
static hada_status light_of(const hada_survey *survey, const hada_fit_options *fit, int depth, hada_context *context,
                            const hada_dataset *even, double *light, hada_error *err)
{
    hada_fit_options options = *fit;
    hada_look at = {.context = context, .options = &options, .depth = depth};
    double left[HADA_LOOK_MOST];
    int rows, cols;
    hada_status status = HADA_OK;
    options.scene_response = survey->response;
    at.group = hada_least(hada_dataset_get_info(even)->counts[depth], HADA_LOOK_MOST);
    hada_look_whole(&options, &rows, &cols);
    HADA_TRY_OR_DONE(hada_look_take(&at, even, err));
    HADA_TRY_OR_DONE(hada_look_explain(&at, rows, cols, at.learned, left, light, NULL, err));
done:
    hada_look_return(&at);
    return status;
}

hada_status hada_fit_level_depths(const hada_survey *survey, const hada_fit_options *fit, hada_context *context,
                                  const hada_dataset *pairs, hada_error *err)
{
    const int *counts = hada_dataset_get_info(pairs)->counts;
    hada_dataset *even = NULL;
    double *light = NULL, mean = 0.0;
    hada_status status = HADA_OK;
    if (fit->depths < 2)
        return HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(light, (size_t)fit->depths, "exposures", err));
    HADA_TRY_OR_DONE(hada_survey_apply(&even, survey, pairs, err));
    for (int z = 0; z < fit->depths; z++) {
        if (!counts[z])
            goto done;
        HADA_TRY_OR_DONE(light_of(survey, fit, z, context, even, &light[z], err));
        mean += log(light[z]) / fit->depths;
    }
    for (int z = 0; isfinite(mean) && z < fit->depths; z++)
        for (int i = 0; i < counts[z]; i++)
            ((double *)(uintptr_t)survey->gains[z])[i] *= light[z] / exp(mean);
done:
    free(light);
    hada_dataset_destroy(&even);
    return status;
}

/* One round of the white balance of a group: balance[pair][channel], by hada_pair_number(), whose geometric mean over
 * channels stays. *most: by how much a channel's changed, as a root mean square of logarithms. */
static hada_status balance_group(hada_look *at, const hada_dataset *pairs, double *balance, double *most,
                                 hada_error *err)
{
    double times[HADA_COLOURS][HADA_LOOK_MOST], squares[HADA_COLOURS] = {0.0};
    hada_dataset *even = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_dataset_balance(&even, pairs, balance, HADA_COLOURS, err));
    for (int c = 0; c < HADA_COLOURS; c++) {
        at->channel = c + 1;
        HADA_TRY_OR_DONE(expose(at, even, times[c], err));
    }
    for (int i = 0; i < at->group; i++) {
        const double mean = cbrt(times[0][i] * times[1][i] * times[2][i]);
        double *of = balance + (size_t)hada_pair_number(pairs, at->depth, at->first + i) * HADA_COLOURS;
        for (int c = 0; c < HADA_COLOURS; c++) {
            const double change = log(times[c][i] / mean);
            of[c] *= exp(-change);
            squares[c] += change * change / at->group;
        }
    }
    for (int c = 0; c < HADA_COLOURS; c++)
        *most = fmax(*most, sqrt(squares[c]));
done:
    hada_dataset_destroy(&even);
    return status;
}

hada_status hada_fit_find_balance(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                  double **balance, hada_error *err)
{
    const int *counts = hada_dataset_get_info(pairs)->counts;
    const size_t count = (size_t)pairs->store->pairs * HADA_COLOURS;
    double most = 0.0;
    int differs = 1;
    *balance = NULL;
    if (fit->channels != HADA_COLOURS)
        return HADA_OK;
    HADA_TRY(HADA_NEW(*balance, count, "the white balance of frames", err));
    for (size_t i = 0; i < count; i++)
        (*balance)[i] = 1.0;
    for (int z = hada_look_depth(fit, pairs); z < fit->depths && differs; z++)
        for (int g = 0; g < groups_of(counts[z]); g++)
            for (int round = 0; round < ROUNDS && differs; round++) {
                hada_look at = group_of(context, fit, pairs, z, g);
                HADA_TRY(balance_group(&at, pairs, *balance, &most, err));
                differs = most > UNBALANCED;
            }
    if (!differs) {
        free(*balance);
        *balance = NULL;
    }
    return HADA_OK;
}
