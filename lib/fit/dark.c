/* What the frames of pairs hold without the scenes' light: a dark level, or light of the room as a smooth surface, of
 * all frames or of each. Whichever leaves clearly least of frames that are held out, with the response and exposures
 * that suit it, is taken; the simplest where several do. */
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
/* Pairs of a depth from which on what lies beyond the sensor's edge follows from them. With so many and fewer a level
 * or a surface is looked for as well as if no light left the sensor, which says more of each pair. */
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

#define NEARLY 1.3

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

/* A camera that is said to be circular loses no light. */
static int may_crop(const hada_sample *work)
{
    return work->options.boundary != HADA_BOUNDARY_CIRCULAR;
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

/* Assumptions as they were judged, once for each. */
typedef struct judgements {
    int known[HADA_COUNT(assumptions)];
    judged of[HADA_COUNT(assumptions)];
} judgements;

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
        HADA_TRY_OR_DONE(hada_light_fit_create(&fit, &work, may_crop(&work) && most_of(&work) >= MANY, err));
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

static const judged *judgement(judgements *all, hada_light_fit *fit, const hada_sample *work, size_t a)
{
    if (!all->known[a])
        all->of[a] = judge_responses(fit, work, assumptions[a].kind, assumptions[a].apart);
    all->known[a] = 1;
    return &all->of[a];
}

/* Whether nothing leaves much less than what is chosen: the most general kind of each measure holds all others. */
static int is_least(judgements *all, hada_light_fit *fit, const hada_sample *work, hada_light_kind most,
                    const judged *chosen)
{
    for (size_t a = 0; a < HADA_COUNT(assumptions); a++) {
        const hada_light_kind kind = assumptions[a].kind;
        const int m = measure_of(kind);
        if ((kind == most || (kind == HADA_LIGHT_SURFACE && most > kind)) &&
            chosen->mean[m] - judgement(all, fit, work, a)->mean[m] > log(NEARLY))
            return 0;
    }
    return 1;
}

/* Kinds up to `most`. What leaves nearly as little as anything is taken at once. */
static hada_status choose_of_many(hada_light_fit *fit, hada_sample *work, hada_light_kind most, judged *chosen,
                                  hada_error *err)
{
    judgements all = {.known = {0}};
    for (size_t a = 0; a < HADA_COUNT(assumptions); a++) {
        HADA_TRY(hada_progress_step(&work->progress, NULL, err));
        const int m = measure_of(assumptions[a].kind);
        double less[HADA_SAMPLE_MOST];
        if (assumptions[a].kind > most)
            continue;
        const judged *now = judgement(&all, fit, work, a);
        for (int k = 0; k < work->count; k++)
            less[k] = chosen->log[m][k] - now->log[m][k];
        if (!a || hada_sample_is_better(less, work->count, log(assumptions[a].less)))
            *chosen = *now;
        if (is_least(&all, fit, work, most, chosen))
            break;
    }
    return HADA_OK;
}

/* No light leaves the sensor: a level, or a surface, that leaves less than nothing does. A surface, which lost light
 * looks like, and with many pairs a level leave less than nothing does if light may leave, too. */
static hada_status choose_of_few(hada_light_fit *fit, hada_sample *work, hada_light_kind most, judged *chosen,
                                 hada_error *err)
{
    judged before = judge_responses(fit, work, HADA_LIGHT_NONE, 0);
    double crop[HADA_SAMPLE_MOST];
    memcpy(crop, chosen->log[COARSE], sizeof crop);
    const int many = most_of(work) >= MANY;
    for (size_t a = 1; a < HADA_COUNT(assumptions); a++) {
        const hada_light_kind kind = assumptions[a].kind;
        if (kind > most || kind == HADA_LIGHT_OWN)
            continue;
        HADA_TRY(hada_progress_step(&work->progress, NULL, err));
        const int also = many || kind == HADA_LIGHT_SURFACE;
        const judged now = judge_responses(fit, work, kind, assumptions[a].apart);
        double less[HADA_SAMPLE_MOST];
        for (int k = 0; k < work->count; k++)
            less[k] = fmin(before.log[COARSE][k], also ? crop[k] : INFINITY) - now.log[COARSE][k];
        if (hada_sample_is_better(less, work->count, log(assumptions[a].less)))
            *chosen = before = now;
    }
    return HADA_OK;
}

static hada_status choose(hada_sample *work, hada_light_kind most, judged *chosen, hada_error *err)
{
    const int count = most_of(work), crops = may_crop(work);
    hada_light_fit *fit = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_light_fit_create(&fit, work, crops, err));
    if (count >= MANY || !crops)
        HADA_TRY_OR_DONE(choose_of_many(fit, work, most, chosen, err));
    else
        *chosen = judge_responses(fit, work, HADA_LIGHT_NONE, 0);
    if (!crops || count > MANY || chosen->guess.kind != HADA_LIGHT_NONE || chosen->guess.apart)
        goto done;
    hada_light_fit_destroy(&fit);
    HADA_TRY(hada_light_fit_create(&fit, work, 0, err));
    HADA_TRY_OR_DONE(choose_of_few(fit, work, most, chosen, err));
done:
    hada_light_fit_destroy(&fit);
    return status;
}

static hada_status take(hada_fit_options *options, const hada_dataset *pairs, const double *response,
                        hada_light_guess guess, double darkest_place, hada_image *surface, hada_error *err)
{
    double level;
    int lit;
    HADA_TRY(find_exactly(options, pairs, response, guess, &level, surface, &lit, err));
    if (guess.kind == HADA_LIGHT_LEVEL && level > 0.0 && level < MOST_DARK * darkest_place)
        options->dark = level;
    else if (guess.kind == HADA_LIGHT_SURFACE && !lit)
        hada_image_destroy(surface);
    return HADA_OK;
}

hada_status hada_fit_find_dark(hada_fit_options *options, const hada_dataset *pairs, hada_image *surface,
                               hada_own_light *own, hada_error *err)
{
    hada_sample work = {
        .options = *options, .pairs = pairs, .counts = hada_dataset_get_info(pairs)->counts, .grid = COMPARED_ON};
    judged chosen = {.mean = {0.0}};
    double least = 0.0;
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
    else if (chosen.guess.kind == HADA_LIGHT_SURFACE || (chosen.guess.kind == HADA_LIGHT_LEVEL && most >= least))
        HADA_TRY_OR_DONE(take(options, pairs, &response, chosen.guess, most, surface, err));
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
