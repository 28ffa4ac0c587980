/* What the frames of pairs hold without the scenes' light: a dark level, or light of the room as a smooth surface, of
 * all frames or of each. Whichever leaves clearly least of frames that are held out, with the response and exposures
 * that suit it, is taken; the simplest where several do. And the response of scenes, found in the same way. */
#include <hadalens/response.h>

#include "fit/fitter.h"
#include "fit/light_fit.h"
#include "image/correct.h"
#include "image/pixels.h"
#include "image/statistics.h"

/* Sides of the grids on which kinds are compared, and on which one is found exactly. */
enum { COMPARED_ON = 64, FOUND_ON = 128 };
/* Each pair is held out in one of so many turns, of few pairs alone in its depth. */
enum { TURNS = 3 };
/* Pairs of a depth from which on those that are held out tell kinds of light from each other. */
enum { MANY = 4 };
/* Below this share of the brightest place no dark level is looked for (of full scale it would be too much: 10 bits in a
 * file of 16 are small numbers). */
#define LEAST_DARK 1e-3
/* A level lies at most by this factor above the darkest place, which noise makes uncertain. */
#define MOST_DARK 1.1
/* Assumptions, from the simplest on, and the factor by which each must leave less, surely, than the one that is taken
 * before it: on simulated cameras those that were right left 1.8 to 4000 times less, others as much, or for exposures
 * and light of each frame up to 2.1 times less (perf/results/learning.md). */
static const struct {
    hada_light_kind kind;
    int apart;
    double less;
} assumptions[] = {
    {HADA_LIGHT_NONE, 0, 1.0},  {HADA_LIGHT_LEVEL, 0, 1.5},   {HADA_LIGHT_SURFACE, 0, 2.0}, {HADA_LIGHT_NONE, 1, 2.0},
    {HADA_LIGHT_LEVEL, 1, 1.5}, {HADA_LIGHT_SURFACE, 1, 2.0}, {HADA_LIGHT_OWN, 0, 3.5},     {HADA_LIGHT_OWN, 1, 3.5},
};
/* With few pairs frames hold light where that of each leaves so much less (where they do 2.4 to 1000 times, else up to
 * 3.1), or a level; light that leaves at most so much more than any of the pairs themselves is enough (if right up
 * to 2.1 times more, else from 2.9 on). */
#define LIT         3.5
#define LIT_EVENLY  1.5
#define LITTLE_MORE 2.2

/* Exposures alike, linear scenes and those for displays are the usual ones: they may leave so much more than others. */
#define USUAL 2.1

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

/* The most pairs that a depth has. */
static int most_of(const hada_sample *work)
{
    int most = 0, count = 0;
    for (int k = 0; k < work->count; k++) {
        count = k && work->depth[k] == work->depth[k - 1] ? count + 1 : 1;
        most = hada_most(most, count);
    }
    return most;
}

/* A guess, and what it leaves of each frame that was held out: logarithms, and their mean. Light of each frame explains
 * whatever is smooth, so it is judged by all that is left. */
enum { COARSE = 0, WHOLE = 1 };
typedef struct judged {
    hada_light_guess guess;
    double log[2][HADA_SAMPLE_MOST], mean[2];
} judged;

static int measure_of(hada_light_kind kind)
{
    return kind == HADA_LIGHT_OWN ? WHOLE : COARSE;
}

/* What counts as nothing: a share of the mean frame's energy, for a frame may be black. */
static double least_left(const hada_sample *work)
{
    const hada_image *first = &work->frame[0];
    const size_t area = (size_t)first->rows * (size_t)first->cols, from = (size_t)(work->options.channels / 2) * area;
    double energy = 0.0;
    for (int k = 0; k < work->count; k++)
        for (size_t i = from; i < from + area; i++)
            energy += (double)work->frame[k].data[i] * (double)work->frame[k].data[i];
    return HADA_LEAST_SHARE * energy / work->count;
}

/* Holds out each pair in one turn, of which the first counts alone, unless `all`. */
static void judge(hada_light_fit *fit, const hada_sample *work, int all, judged *of)
{
    hada_light_left left[HADA_SAMPLE_MOST];
    int members = 0;
    const double least = least_left(work);
    const int most = most_of(work), turns = most < 2 * TURNS ? most : TURNS;
    for (int turn = 0; turn < (all ? turns : 1); turn++) {
        unsigned char held[HADA_SAMPLE_MOST];
        int number = 0;
        for (int k = 0; k < work->count; k++) {
            number = k && work->depth[k] == work->depth[k - 1] ? number + 1 : 0;
            held[k] = number % turns == turn;
        }
        hada_light_fit_run(fit, work->options.channels / 2, of->guess, held, left, NULL);
        for (int k = 0; k < work->count; k++)
            if (held[k]) {
                of->log[COARSE][members] = log(fmax(left[k].coarse, least));
                of->log[WHOLE][members++] = log(fmax(left[k].whole, least));
            }
    }
    for (int m = COARSE; m <= WHOLE; m++) {
        of->mean[m] = 0.0;
        for (int k = 0; k < members; k++)
            of->mean[m] += of->log[m][k] / members;
    }
}

/* The response with which an assumption leaves least. */
static judged judge_responses(hada_light_fit *fit, const hada_sample *work, hada_light_kind kind, int apart)
{
    const int m = measure_of(kind);
    judged best = {.mean = {INFINITY, INFINITY}};
    for (int r = 0; r < work->tried; r++) {
        judged now = {.guess = {.response = r, .apart = apart, .kind = kind}};
        judge(fit, work, 0, &now);
        best = now.mean[m] < best.mean[m] ? now : best;
    }
    judge(fit, work, 1, &best);
    return best;
}

/* The light of all frames, with a guess: a level, the mean of the channels', and a surface where the guess is one.
 * *lit: whether every channel of it is above 0. */
static hada_status find_exactly(const hada_fit_options *options, const hada_dataset *pairs, const double *response,
                                hada_light_guess guess, double *level, hada_image *surface, int *lit, hada_error *err)
{
    hada_sample work = {
        .options = *options, .pairs = pairs, .counts = hada_dataset_get_info(pairs)->counts, .tried = 1};
    const size_t channels = (size_t)options->channels;
    hada_light_fit *fit = NULL;
    double *weight = NULL;
    hada_status status = HADA_OK;
    *level = 0.0;
    *lit = 1;
    work.response = response;
    work.grid = FOUND_ON;
    guess.response = 0;
    HADA_TRY_OR_DONE(HADA_NEW(weight, channels * HADA_SMOOTH_TERMS, "light in the frames of pairs", err));
    HADA_TRY_OR_DONE(hada_sample_begin(&work, err));
    if (work.count)
        HADA_TRY_OR_DONE(hada_light_fit_create(&fit, &work, options->boundary != HADA_BOUNDARY_CIRCULAR, err));
    for (size_t c = 0; c < channels && fit; c++) {
        double *of = weight + c * HADA_SMOOTH_TERMS;
        HADA_TRY_OR_DONE(hada_progress_step(&work.progress, NULL, err));
        hada_light_fit_run(fit, (int)c, guess, NULL, NULL, of);
        *level += of[0] / (double)channels;
        *lit &= hada_smooth_mean(of) > 0.0;
    }
    if (guess.kind == HADA_LIGHT_SURFACE) {
        HADA_TRY_OR_DONE(hada_image_create(surface, options->channels, options->raw_rows, options->raw_cols, err));
        hada_smooth_add(weight, 1.0, surface);
    }
done:
    hada_light_fit_destroy(&fit);
    hada_sample_end(&work);
    free(weight);
    return status;
}

/* Whether nothing leaves so much less than what is chosen: the most general kind of each measure holds all others. */
#define NEARLY 1.3
static int is_least(const judged *all, hada_light_kind most, const judged *chosen)
{
    for (size_t a = 0; a < HADA_COUNT(assumptions); a++) {
        const hada_light_kind kind = assumptions[a].kind;
        const int m = measure_of(kind);
        if ((kind == most || (kind == HADA_LIGHT_SURFACE && most > kind)) &&
            chosen->mean[m] - all[a].mean[m] > log(NEARLY))
            return 0;
    }
    return 1;
}

/* Kinds up to `most`. What leaves nearly as little as anything is taken at once. */
static hada_status choose_of_many(hada_light_fit *fit, hada_sample *work, hada_light_kind most, judged *chosen,
                                  hada_error *err)
{
    judged all[HADA_COUNT(assumptions)] = {{.mean = {0.0}}};
    for (size_t a = 0; a < HADA_COUNT(assumptions); a++) {
        HADA_TRY(hada_progress_step(&work->progress, NULL, err));
        if (assumptions[a].kind <= most)
            all[a] = judge_responses(fit, work, assumptions[a].kind, assumptions[a].apart);
    }
    *chosen = all[0];
    for (size_t a = 1; a < HADA_COUNT(assumptions) && !is_least(all, most, chosen); a++) {
        const int m = measure_of(assumptions[a].kind);
        double less[HADA_SAMPLE_MOST];
        for (int k = 0; k < work->count; k++)
            less[k] = chosen->log[m][k] - all[a].log[m][k];
        if (assumptions[a].kind <= most && hada_sample_is_better(less, work->count, log(assumptions[a].less)))
            *chosen = all[a];
    }
    return HADA_OK;
}

/* Whether frames hold light: that of each frame leaves less than nothing does, or a level if no light leaves the
 * sensor. own: the better of the first kind. */
static hada_status are_lit(hada_light_fit *fit, const hada_sample *work, int *lit, judged *own, hada_error *err)
{
    const judged none[] = {judge_responses(fit, work, HADA_LIGHT_NONE, 0),
                           judge_responses(fit, work, HADA_LIGHT_NONE, 1)};
    const judged each[] = {judge_responses(fit, work, HADA_LIGHT_OWN, 0),
                           judge_responses(fit, work, HADA_LIGHT_OWN, 1)};
    double less[HADA_SAMPLE_MOST];
    *own = each[each[1].mean[WHOLE] < each[0].mean[WHOLE]];
    for (int k = 0; k < work->count; k++)
        less[k] = fmin(none[0].log[WHOLE][k], none[1].log[WHOLE][k]) - own->log[WHOLE][k];
    *lit = hada_sample_is_better(less, work->count, log(LIT));
    if (*lit)
        return HADA_OK;
    HADA_TRY(hada_light_fit_create(&fit, work, 0, err));
    const judged dark = judge_responses(fit, work, HADA_LIGHT_NONE, 0),
                 level = judge_responses(fit, work, HADA_LIGHT_LEVEL, 0);
    hada_light_fit_destroy(&fit);
    for (int k = 0; k < work->count; k++)
        less[k] = dark.log[COARSE][k] - level.log[COARSE][k];
    *lit = hada_sample_is_better(less, work->count, log(LIT_EVENLY));
    return HADA_OK;
}

/* Light of a few pairs, which do not settle what light of all frames does to one that is held out: the simplest that
 * leaves little more than any of the pairs themselves. */
static hada_status choose_of_few(hada_light_fit *fit, hada_sample *work, hada_light_kind most, judged *chosen,
                                 hada_error *err)
{
    const double nothing = least_left(work);
    double left[2 * HADA_LIGHT_KINDS], least = INFINITY;
    judged own;
    int lit;
    HADA_TRY(hada_progress_step(&work->progress, NULL, err));
    HADA_TRY(are_lit(fit, work, &lit, &own, err));
    *chosen = own;
    chosen->guess.kind = HADA_LIGHT_NONE;
    if (!lit)
        return HADA_OK;
    for (int a = 0; a < 2 * HADA_LIGHT_KINDS; a++) {
        const hada_light_guess guess = {
            .response = own.guess.response, .kind = (hada_light_kind)(a / 2), .apart = a % 2};
        hada_light_left of[HADA_SAMPLE_MOST];
        HADA_TRY(hada_progress_step(&work->progress, NULL, err));
        hada_light_fit_run(fit, work->options.channels / 2, guess, NULL, of, NULL);
        left[a] = 0.0;
        for (int k = 0; k < work->count; k++)
            left[a] += log(fmax(of[k].whole, nothing)) / work->count;
        least = fmin(least, left[a]);
    }
    for (int a = 2 * (int)most + 1; a >= 0; a--)
        if (left[a] < least + log(LITTLE_MORE))
            chosen->guess = (hada_light_guess){own.guess.response, a % 2, (hada_light_kind)(a / 2)};
    return HADA_OK;
}

static hada_status choose(hada_sample *work, hada_light_kind most, judged *chosen, hada_error *err)
{
    const int count = most_of(work), crops = work->options.boundary != HADA_BOUNDARY_CIRCULAR;
    hada_light_fit *fit = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_light_fit_create(&fit, work, crops, err));
    if (count >= MANY || !crops)
        HADA_TRY_OR_DONE(choose_of_many(fit, work, most, chosen, err));
    if (crops && count <= MANY && chosen->guess.kind == HADA_LIGHT_NONE && !chosen->guess.apart)
        HADA_TRY_OR_DONE(choose_of_few(fit, work, most, chosen, err));
done:
    hada_light_fit_destroy(&fit);
    return status;
}

hada_status hada_fit_find_dark(hada_fit_options *options, const hada_dataset *pairs, hada_image *surface,
                               hada_own_light *own, hada_error *err)
{
    hada_sample work = {
        .options = *options, .pairs = pairs, .counts = hada_dataset_get_info(pairs)->counts, .grid = COMPARED_ON};
    judged chosen = {.mean = {0.0}};
    double least = 0.0, level;
    int lit;
    hada_status status = HADA_OK;
    if (own)
        *own = HADA_OWN_LIGHT_NONE;
    if (options->dark != 0.0 || hada_dataset_get_info(pairs)->dark_frame)
        options->find_dark = 0;
    if (!options->find_dark)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_sample_begin(&work, err));
    const double most = darkest(&work);
    for (int k = 0; k < work.count; k++)
        least = fmax(least, LEAST_DARK * (double)hada_image_brightest(&work.frame[k]));
    if (work.count < HADA_SAMPLE_LEAST || (most < least && !surface))
        goto done;
    hada_sample_forget(&work);
    hada_sample_try_responses(&work);
    HADA_TRY_OR_DONE(hada_sample_take(&work, err));
    HADA_TRY_OR_DONE(choose(&work,
                            own       ? HADA_LIGHT_OWN
                            : surface ? HADA_LIGHT_SURFACE
                                      : HADA_LIGHT_LEVEL,
                            &chosen, err));
    const double response = work.response[chosen.guess.response];
    if (own && chosen.guess.kind == HADA_LIGHT_OWN)
        *own = chosen.guess.apart ? HADA_OWN_LIGHT_APART : HADA_OWN_LIGHT_ALIKE;
    else if (chosen.guess.kind == HADA_LIGHT_SURFACE || (chosen.guess.kind == HADA_LIGHT_LEVEL && most >= least)) {
        HADA_TRY_OR_DONE(find_exactly(options, pairs, &response, chosen.guess, &level, surface, &lit, err));
        if (chosen.guess.kind == HADA_LIGHT_LEVEL && level > 0.0 && level < MOST_DARK * most)
            options->dark = level;
        else if (chosen.guess.kind == HADA_LIGHT_SURFACE && !lit)
            hada_image_destroy(surface);
    }
done:
    options->find_dark = !status && (options->dark > 0.0 || (surface && surface->data));
    hada_sample_end(&work);
    return status;
}

hada_status hada_fit_refine_dark(hada_fit_options *options, const hada_dataset *pairs, hada_error *err)
{
    const hada_light_guess guess = {.kind = HADA_LIGHT_LEVEL};
    double level;
    int lit;
    HADA_TRY(find_exactly(options, pairs, &options->scene_response, guess, &level, NULL, &lit, err));
    options->dark = fmax(0.0, options->dark + level);
    return HADA_OK;
}

hada_status hada_fit_find_common_light(const hada_fit_options *options, const hada_dataset *pairs, hada_image *light,
                                       hada_error *err)
{
    const hada_light_guess guess = {.kind = HADA_LIGHT_SURFACE};
    double level;
    int lit;
    return find_exactly(options, pairs, &options->scene_response, guess, &level, light, &lit, err);
}

hada_status hada_fit_find_response(const hada_fit_options *options, const hada_dataset *pairs, int lit,
                                   const double *responses, int count, int *best, hada_error *err)
{
    hada_sample work = {.options = *options,
                        .pairs = pairs,
                        .counts = hada_dataset_get_info(pairs)->counts,
                        .grid = COMPARED_ON,
                        .tried = count,
                        .response = responses};
    hada_light_fit *fit = NULL;
    double left[2][HADA_SAMPLE_RESPONSES], least[] = {INFINITY, INFINITY};
    int best_of[2] = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_sample_begin(&work, err));
    if (work.count < HADA_SAMPLE_LEAST)
        goto done;
    HADA_TRY_OR_DONE(hada_light_fit_create(&fit, &work, options->boundary != HADA_BOUNDARY_CIRCULAR, err));
    for (int i = 0; i < 2 * count; i++) {
        const int apart = i / count, r = i % count;
        judged now = {.guess = {.response = r, .apart = apart, .kind = lit ? HADA_LIGHT_SURFACE : HADA_LIGHT_NONE}};
        HADA_TRY_OR_DONE(hada_progress_step(&work.progress, NULL, err));
        judge(fit, &work, 1, &now);
        left[apart][r] = now.mean[COARSE];
        best_of[apart] = left[apart][r] < least[apart] ? r : best_of[apart];
        least[apart] = fmin(least[apart], left[apart][r]);
    }
    /* exposures alike tell more where they explain as much, but not beside light that was taken off each frame */
    const int apart = pairs->light || least[0] > least[1] + log(USUAL);
    *best = best_of[apart];
    for (int r = count - 1; r >= 0; r--)
        if ((responses[r] == HADA_RESPONSE_LINEAR || responses[r] == HADA_RESPONSE_SRGB) &&
            left[apart][r] < least[apart] + log(USUAL))
            *best = r;
done:
    hada_light_fit_destroy(&fit);
    hada_sample_end(&work);
    return status;
}
