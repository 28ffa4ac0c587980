/* Filters judged in the window: the passes over the pairs, and the choice of the weight outside it. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "fit/window.h"

/* Weights to choose from, beside 1, which is the exact fit; and what another one must gain to be taken, in decibels. */
static const double weights[] = {0.03, 0.06, 0.12, 0.25, 0.5};
enum { WEIGHTS = HADA_COUNT(weights), MOST_HELD = 4, PAIRS_IN_ALL = 8, FOLDS = 4 };
#define LEAST_GAIN 0.02

_Static_assert((int)WEIGHTS <= (int)HADA_FIT_WEIGHTS && (int)WEIGHTS + 1 == (int)HADA_FIT_JUDGED, "room for weights");

typedef struct judge {
    hada_fitter *fitter;
    hada_fit_show show;
    void *user;
    hada_fit_window *window;
    double alpha, lambda;
    double *energy;              /* per channel, of the frames shown */
    double sum[HADA_FIT_JUDGED]; /* squared errors: the exact fit's, and of the weights */
    int tried;                   /* pairs in them */
} judge;

/* Pairs of a depth that stand aside; none for the filters themselves. */
typedef struct fold {
    int z, held;
    int64_t pair[MOST_HELD];
} fold;

static int is_held(const fold *of, int64_t pair)
{
    for (int i = 0; i < of->held; i++)
        if (of->pair[i] == pair)
            return 1;
    return 0;
}

/* Shows a pair: its pixels, and the spectra of its frame alone or of both. */
static hada_status look(judge *with, int z, int64_t pair, int both, hada_error *err)
{
    const hada_image *raw = NULL, *scene = NULL;
    hada_fitter *fitter = with->fitter;
    hada_status status = with->show(with->user, z, pair, &raw, &scene, err);
    if (!status)
        status = hada_fitter_check_pair(fitter, z, raw, scene, err);
    if (status)
        return status;
    hada_fitter_take(fitter, raw, scene);
    for (int c = 0; c < fitter->info.channels; c++)
        with->energy[c] += fitter->raw_energy[c];
    return hada_fitter_transform(fitter, fitter->raw_pixels, both ? fitter->scene_pixels : NULL, err);
}

/* After every pair of a depth was shown once. */
static hada_status check_energy(const judge *with, int z, hada_error *err)
{
    const hada_fitter_depth *depth = &with->fitter->depth[z];
    for (int c = 0; c < with->fitter->info.channels; c++)
        if (fabs(with->energy[c] - depth->raw_energy[c]) > 1e-6 * depth->raw_energy[c])
            return hada_fail(
                err, HADA_ERROR_STATE,
                "the pairs shown for depth %d (%g mm) are not those in its sums; sums from files cannot be "
                "judged in the window without their pairs: set outside to 1",
                z, with->fitter->distances[z]);
    return HADA_OK;
}

/* Adds the squared errors of the pairs that stand aside; weight -1: the exact fit's filters. */
static hada_status compare(judge *with, const fold *of, int first, int last, double *sums, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < of->held; i++) {
        status = look(with, of->z, of->pair[i], 0, err);
        for (int s = first; !status && s < last; s++) {
            double error;
            status = hada_fit_window_error(with->window, s, &error, err);
            sums[s - first] += status ? 0.0 : error;
        }
    }
    return status;
}

/* Takes the fold's pairs out of the sums on the device. */
static hada_status hold_out(judge *with, const fold *of, hada_error *err)
{
    hada_fitter *fitter = with->fitter;
    hada_status status = hada_fitter_select(fitter, of->z, err);
    if (!status && of->held && fitter->changed)
        status = hada_fitter_put_back(fitter, err);
    if (!status && of->held)
        fitter->current = -1; /* the host's copy is the true one from here on */
    for (int i = 0; !status && i < of->held; i++) {
        status = look(with, of->z, of->pair[i], 1, err);
        if (!status)
            status = hada_fitter_accumulate(fitter, -1.0, err);
    }
    return status;
}

/* The filters of a depth without the pairs of a fold, for some weights. */
static hada_status solve(judge *with, const fold *of, const double *outside, int count, hada_error *err)
{
    const int64_t pairs = with->fitter->depth[of->z].pairs;
    hada_status status = HADA_OK;
    for (int c = 0; c < with->fitter->info.channels; c++)
        with->energy[c] = 0.0;
    status = hold_out(with, of, err);
    if (!status)
        status = hada_fit_window_begin(with->window, of->z, with->alpha, with->lambda, outside, count, err);
    for (int settled = 0, round = 0; !status && !settled; round++) {
        for (int64_t i = 0; !status && i < pairs; i++) {
            if (is_held(of, i))
                continue;
            status = look(with, of->z, i, 0, err);
            if (!status)
                status = hada_fit_window_pair(with->window, err);
        }
        if (!status && !round)
            status = check_energy(with, of->z, err);
        if (!status && !round) /* the residual is the exact fit's filter until the first round ends */
            status = compare(with, of, -1, 0, with->sum, err);
        if (!status)
            status = hada_fit_window_round(with->window, &settled, err);
    }
    return status ? status : compare(with, of, 0, count, with->sum + 1, err);
}

/* The depth with pairs to spare that has that number among them. */
static int spare_depth(const hada_fitter *fitter, int number)
{
    int z = 0;
    while (number > 0 || fitter->depth[z].pairs < 2)
        number -= fitter->depth[z++].pairs > 1;
    return z;
}

/* Leaves pairs of up to four depths out, the depths spread over all that can spare some. */
static hada_status try_weights(judge *with, int spare, hada_error *err)
{
    const int depths = spare < FOLDS ? spare : FOLDS;
    hada_status status = HADA_OK;
    for (int k = 0; !status && k < depths; k++) {
        const int number = depths > 1 ? (k * (spare - 1) + (depths - 1) / 2) / (depths - 1) : 0;
        fold of = {.z = spare_depth(with->fitter, number)};
        const int64_t pairs = with->fitter->depth[of.z].pairs;
        of.held = pairs >= 16 ? MOST_HELD : pairs >= 4 ? 2 : 1;
        int64_t folds = PAIRS_IN_ALL / (of.held * depths);
        folds = folds > FOLDS / depths ? FOLDS / depths : folds;
        folds = folds > pairs / of.held ? pairs / of.held : folds < 1 ? 1 : folds;
        for (int64_t i = 0; !status && i < folds; i++, with->tried += of.held) {
            for (int j = 0; j < of.held; j++)
                of.pair[j] = (i * of.held + j) * pairs / (folds * of.held);
            status = solve(with, &of, weights, WEIGHTS, err);
        }
    }
    return status;
}

/* Into fitter->judged: what was compared, the exact fit last, and the best. By the mean squared error of all pairs,
 * which is what filters are fitted by: a mean of decibels is led by smooth scenes, which ask for less detail. */
static void choose(judge *with)
{
    hada_fitter_judged *judged = &with->fitter->judged;
    judged->count = with->tried ? WEIGHTS + 1 : 0;
    judged->chosen = WEIGHTS;
    for (int s = 0; s < judged->count; s++) {
        judged->outside[s] = s < (int)WEIGHTS ? weights[s] : 1.0;
        judged->psnr[s] = -10.0 * log10(fmax(with->sum[s < (int)WEIGHTS ? s + 1 : 0] / with->tried, 1e-20));
    }
    double most = judged->psnr[WEIGHTS] + LEAST_GAIN;
    for (int s = 0; s + 1 < judged->count; s++)
        if (judged->psnr[s] > most) {
            most = judged->psnr[s];
            judged->chosen = s;
        }
}

/* The filters of all depths, into fitter->judged. */
static hada_status solve_all(judge *with, double outside, hada_error *err)
{
    hada_fitter *fitter = with->fitter;
    const size_t plane = hada_model_info_plane(&fitter->info), channels = (size_t)fitter->info.channels;
    float *blocks = NULL, *to = NULL;
    hada_status status = hada_alloc_raw((void **)&blocks, 2 * fitter->stride, sizeof *blocks, "a filter", err);
    if (!status)
        status = hada_alloc_raw((void **)&to, (size_t)fitter->info.depths * channels * plane * 2, sizeof *to,
                                "filters judged in the window", err);
    for (int z = 0; !status && z < fitter->info.depths; z++) {
        const fold whole = {.z = z};
        status = fitter->depth[z].pairs ? solve(with, &whole, &outside, 1, err) : HADA_OK;
        for (size_t c = 0; !status && c < channels && fitter->depth[z].pairs; c++)
            status = hada_fitter_read_plane(fitter, hada_fit_window_filters(with->window, 0), c * fitter->layout.count,
                                            blocks, to + ((size_t)z * channels + c) * plane * 2, "a filter", err);
    }
    free(blocks);
    if (status)
        free(to);
    else
        fitter->judged.filters = to;
    return status;
}

void hada_fitter_drop_judged(hada_fitter *fitter)
{
    free(fitter->judged.filters);
    fitter->judged = (hada_fitter_judged){0};
}

hada_status hada_fitter_judge(hada_fitter *fitter, hada_fit_show show, void *user, hada_error *err)
{
    if (!fitter || !show)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_fitter_judge: a fitter and a function that shows pairs are "
                         "needed");
    const int search = fitter->options.outside < 0.0;
    double outside = search ? 1.0 : fitter->options.outside;
    int spare = 0, scored;
    for (int z = 0; z < fitter->info.depths; z++)
        spare += fitter->depth[z].pairs > 1;
    hada_fitter_drop_judged(fitter);
    if (search ? !spare : outside == 1.0)
        return HADA_OK;
    judge with = {.fitter = fitter, .show = show, .user = user};
    hada_fitter_choice(fitter, &with.alpha, &with.lambda, &scored);
    hada_status status =
        hada_alloc((void **)&with.energy, (size_t)fitter->info.channels, sizeof *with.energy, "a fit", err);
    if (!status)
        status = hada_fit_window_create(&with.window, fitter, search ? WEIGHTS : 1, err);
    if (!status)
        status = hada_fitter_pool(fitter, err);
    if (!status && search) {
        status = try_weights(&with, spare, err);
        if (!status) {
            choose(&with);
            outside = fitter->judged.outside[fitter->judged.chosen];
        }
    }
    if (!status && outside < 1.0)
        status = solve_all(&with, outside, err);
    hada_fit_window_destroy(&with.window);
    free(with.energy);
    if (status)
        hada_fitter_drop_judged(fitter);
    return status;
}
