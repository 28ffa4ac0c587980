#include "fit/window.h"

/* Weights to choose from, beside 1, which is the exact fit; and what another one must gain to be taken, in decibels:
 * more than choosing by so few pairs is uncertain (docs/explanation/learning-a-camera.md). */
static const double weights[] = {0.03, 0.06, 0.12, 0.25, 0.5};
enum { WEIGHTS = HADA_COUNT(weights) };
#define LEAST_GAIN 0.02

/* Folds in all; pairs that are left out in all of them together (at least one a fold), and at most in one: MOST_HELD of
 * a depth that has many pairs, SOME_HELD where it has some. */
enum { FOLDS = 4, PAIRS_IN_ALL = 8, MOST_HELD = 4, MANY_PAIRS = 16, SOME_HELD = 2, SOME_PAIRS = 4 };

/* Mean squared errors below this, 200 dB, count as this. */
#define LEAST_ERROR 1e-20

_Static_assert((int)WEIGHTS <= (int)HADA_FIT_WEIGHTS && (int)WEIGHTS + 1 == (int)HADA_FIT_OUTSIDES, "room for weights");

typedef struct passes {
    hada_fit_sums *sums;
    hada_fit_reader *from;
    hada_fit_window *window;
    hada_fit_setting setting;
    double sum[HADA_FIT_OUTSIDES]; /* squared errors: the exact fit's, and of the weights */
    int tried;                     /* pairs in them */
} passes;

/* Pairs of a depth that are left out; none for the filters themselves. */
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

/* Reads a pair: its pixels, and the spectra of its frame alone or of both. */
static hada_status bring(passes *with, int z, int64_t number, int64_t next, int both, hada_error *err)
{
    hada_fit_pair *pair = with->from->pair;
    HADA_TRY(hada_fit_read(with->from, z, number, next, err));
    return hada_fit_pair_transform(pair, pair->raw_pixels, both ? pair->scene_pixels : NULL, err);
}

/* Adds the squared errors of the pairs that are left out; weight -1: the exact fit's filters. */
static hada_status validate(passes *with, const fold *of, int first, int last, double *sums, hada_error *err)
{
    for (int i = 0; i < of->held; i++) {
        HADA_TRY(bring(with, of->z, of->pair[i], -1, 0, err));
        for (int s = first; s < last; s++) {
            double error;
            HADA_TRY(hada_fit_window_error(with->window, s, &error, err));
            sums[s - first] += error;
        }
    }
    return HADA_OK;
}

/* Takes the fold's pairs out of the sums on the device. */
static hada_status hold_out(passes *with, const fold *of, hada_error *err)
{
    if (!of->held)
        return hada_fit_sums_select(with->sums, of->z, err);
    HADA_TRY(hada_fit_sums_borrow(with->sums, of->z, err));
    for (int i = 0; i < of->held; i++) {
        HADA_TRY(bring(with, of->z, of->pair[i], -1, 1, err));
        HADA_TRY(hada_fit_sums_accumulate(with->sums, with->from->pair, -1.0, err));
    }
    return HADA_OK;
}

/* One product with T: all pairs but those of the fold. */
static hada_status pass(passes *with, const fold *of, hada_error *err)
{
    for (int64_t i = 0; i < with->sums->depth[of->z].pairs; i++) {
        if (is_held(of, i))
            continue;
        HADA_TRY(bring(with, of->z, i, i + 1, 0, err));
        HADA_TRY(hada_fit_window_pair(with->window, err));
    }
    return HADA_OK;
}

/* The filters of a depth without the pairs of a fold, for some weights. */
static hada_status solve(passes *with, const fold *of, const double *outside, int count, hada_error *err)
{
    int converged = 0;
    hada_fit_reader_clear(with->from);
    HADA_TRY(hold_out(with, of, err));
    HADA_TRY(hada_fit_window_begin(with->window, of->z, with->setting, outside, count, err));
    HADA_TRY(pass(with, of, err));
    HADA_TRY(hada_fit_reader_check(with->from, of->z, with->sums->depth[of->z].raw_energy, err));
    /* the residual is the exact fit's filter until the first iteration ends */
    HADA_TRY(validate(with, of, -1, 0, with->sum, err));
    HADA_TRY(hada_fit_window_iterate(with->window, &converged, err));
    while (!converged) {
        HADA_TRY(pass(with, of, err));
        HADA_TRY(hada_fit_window_iterate(with->window, &converged, err));
    }
    return validate(with, of, 0, count, with->sum + 1, err);
}

/* Depths with pairs to spare. */
static int count_spare(const hada_fit_sums *sums)
{
    int spare = 0;
    for (int z = 0; z < sums->grid->info.depths; z++)
        spare += sums->depth[z].pairs > 1;
    return spare;
}

/* The depth with that number among those with pairs to spare. */
static int spare_depth(const hada_fit_sums *sums, int number)
{
    int z = 0;
    while (number > 0 || sums->depth[z].pairs < 2)
        number -= sums->depth[z++].pairs > 1;
    return z;
}

/* Folds of a depth that is one of `depths`, each without so many of its pairs. */
static int64_t fold_count(int64_t pairs, int held, int depths)
{
    const int64_t share = PAIRS_IN_ALL / (held * depths), most = FOLDS / depths;
    const int64_t folds = share > most ? most : share;
    return folds > pairs / held ? pairs / held : folds < 1 ? 1 : folds;
}

/* Leaves pairs of up to four depths out, the depths spread over all that can spare some. */
static hada_status try_weights(passes *with, int spare, hada_error *err)
{
    const int depths = spare < FOLDS ? spare : FOLDS;
    const hada_communicator *ranks = &with->sums->grid->communicator;
    long number_of = 0; /* of the fold */
    for (int k = 0; k < depths; k++) {
        const int number = depths > 1 ? (k * (spare - 1) + (depths - 1) / 2) / (depths - 1) : 0;
        fold of = {.z = spare_depth(with->sums, number)};
        const int64_t pairs = with->sums->depth[of.z].pairs;
        of.held = pairs >= MANY_PAIRS ? MOST_HELD : pairs >= SOME_PAIRS ? SOME_HELD : 1;
        const int64_t folds = fold_count(pairs, of.held, depths);
        for (int64_t i = 0; i < folds; i++, with->tried += of.held) {
            for (int j = 0; j < of.held; j++)
                of.pair[j] = (i * of.held + j) * pairs / (folds * of.held);
            if (hada_is_mine(ranks, number_of++))
                HADA_TRY(solve(with, &of, weights, WEIGHTS, err));
        }
    }
    return hada_reduce(ranks, with->sum, HADA_FIT_OUTSIDES, err);
}

/* What was compared, the exact fit last, and the best. By the mean squared error of all pairs, which is what filters
 * are fitted by: a mean of decibels is led by smooth scenes, which ask for less detail. */
static void choose(const passes *with, hada_fit_outside *out)
{
    enum { EXACT = WEIGHTS };
    out->count = with->tried ? HADA_FIT_OUTSIDES : 0;
    out->chosen = EXACT;
    for (int s = 0; s < out->count; s++) {
        out->weight[s] = s < EXACT ? weights[s] : 1.0;
        out->psnr[s] = -10.0 * log10(fmax(with->sum[s < EXACT ? s + 1 : 0] / with->tried, LEAST_ERROR));
    }
    double most = out->psnr[EXACT] + LEAST_GAIN;
    for (int s = 0; s + 1 < out->count; s++)
        if (out->psnr[s] > most) {
            most = out->psnr[s];
            out->chosen = s;
        }
}

/* The filters of all depths. */
static hada_status solve_all(passes *with, double outside, float *filters, hada_error *err)
{
    const hada_fit_grid *grid = with->sums->grid;
    const size_t plane = hada_model_info_plane(&grid->info), channels = (size_t)grid->info.channels;
    const hada_communicator *ranks = &grid->communicator;
    float *blocks = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(blocks, 2 * grid->stride, "a filter", err));
    for (int z = 0; z < grid->info.depths; z++) {
        const fold whole = {.z = z};
        if (!with->sums->depth[z].pairs || !hada_is_mine(ranks, z))
            continue;
        HADA_TRY_OR_DONE(solve(with, &whole, &outside, 1, err));
        for (size_t c = 0; c < channels; c++)
            HADA_TRY_OR_DONE(hada_fit_read_plane(grid, hada_fit_window_filters(with->window, 0), c * grid->layout.count,
                                                 blocks, filters + ((size_t)z * channels + c) * plane * 2, "a filter",
                                                 err));
    }
    for (int z = 0; z < grid->info.depths; z++)
        if (with->sums->depth[z].pairs)
            HADA_TRY_OR_DONE(hada_broadcast(ranks, hada_owner(ranks, z), filters + (size_t)z * channels * plane * 2,
                                            channels * plane * 2 * sizeof *filters, err));
done:
    free(blocks);
    return status;
}

void hada_fit_outside_free(hada_fit_outside *outside)
{
    free(outside->filters);
    *outside = (hada_fit_outside){0};
}

double hada_fit_outside_gain(const hada_fit_outside *outside)
{
    return outside->count ? outside->psnr[outside->chosen] - outside->psnr[outside->count - 1] : 0.0;
}

hada_status hada_fit_outside_solve(hada_fit_outside *out, hada_fit_sums *sums, hada_fit_reader *from,
                                   hada_fit_setting setting, double weight, hada_error *err)
{
    const hada_model_info *info = &sums->grid->info;
    const size_t floats = (size_t)info->depths * (size_t)info->channels * hada_model_info_plane(info) * 2;
    const int search = weight < 0.0, spare = count_spare(sums);
    passes with = {.sums = sums, .from = from, .setting = setting};
    hada_status status = HADA_OK;
    *out = (hada_fit_outside){0};
    if (search ? !spare : weight == 1.0)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_fit_window_create(&with.window, sums, from->pair, search ? WEIGHTS : 1, err));
    HADA_TRY_OR_DONE(hada_fit_sums_pool(sums, err));
    if (search) {
        HADA_TRY_OR_DONE(try_weights(&with, spare, err));
        choose(&with, out);
        weight = out->weight[out->chosen];
    }
    if (weight < 1.0) {
        HADA_TRY_OR_DONE(HADA_NEW_RAW(out->filters, floats, "filters judged in the window", err));
        HADA_TRY_OR_DONE(solve_all(&with, weight, out->filters, err));
    }
done:
    hada_fit_window_destroy(&with.window);
    if (status)
        hada_fit_outside_free(out);
    return status;
}
