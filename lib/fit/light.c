/* Light in the frames of pairs that comes from no scene and differs from frame to frame: a smooth surface of each. What
 * is left of a pair when the others of its depth predict it is linear in these surfaces, so they follow from least
 * squares, each pair by its energy. */
#include <float.h>

#include "core/numbers.h"
#include "fit/fitter.h"
#include "fit/sample.h"
#include "image/correct.h"

enum { TERMS = HADA_SMOOTH_TERMS };
/* The diagonal of the equations is so much larger: what is as bright as its scene might as well be a wide part of the
 * point spread function, then there shall be no light. */
#define LITTLE 1e-3

/* Pairs that are compared with each other at most, and at least. */
enum { TOGETHER = 10, OWN_LEAST = 3 };
/* Turns in which exposures that differ are found beside light. */
enum { TURNS = 6 };
_Static_assert((int)TOGETHER <= (int)HADA_SAMPLE_MOST, "room for pairs");

typedef struct equations {
    hada_sample *work;
    int unknowns;           /* of a channel */
    float *term;            /* [TERMS][plane] complex: what each shows */
    float *share;           /* [pair][plane] complex: of each frame that is left of a pair */
    float *left;            /* [1 + unknowns][plane] complex: of a pair, as it is and if an unknown showed */
    double *normal, *right; /* of each pair, [pair][unknowns][unknowns] and [pair][unknowns] */
    double *sum, *solution; /* of all */
    double energy[HADA_SAMPLE_MOST], rest[HADA_SAMPLE_MOST]; /* of each pair's frame, and what is left of that */
} equations;

/* The spectrum of a frame that shows a term alone. */
static hada_status show_term(const equations *of, int k, hada_error *err)
{
    hada_sample *work = of->work;
    const hada_image *like = &work->frame[0];
    const size_t cols = (size_t)like->cols, area = cols * (size_t)like->rows;
    hada_image shown;
    HADA_TRY(hada_image_create(&shown, like->channels, like->rows, like->cols, err));
    for (size_t i = 0; i < hada_image_count(&shown); i++)
        shown.data[i] = (float)hada_sample_term(work, k, (int)(i % area / cols), (int)(i % cols));
    hada_pair_level_put(&work->level, 0, 0, &shown, &work->scene[0][0]);
    memcpy(of->term + (size_t)k * 2 * work->level.plane, work->level.frame, 2 * work->level.plane * sizeof(float));
    hada_image_destroy(&shown);
    return HADA_OK;
}

static hada_status begin(equations *of, hada_sample *work, hada_error *err)
{
    static const char what[] = "light in the frames of pairs";
    const size_t pairs = (size_t)work->count, n = pairs * TERMS, plane = 2 * work->level.plane;
    *of = (equations){.work = work, .unknowns = (int)n};
    HADA_TRY(HADA_NEW_RAW(of->term, TERMS * plane, what, err));
    HADA_TRY(HADA_NEW_RAW(of->share, pairs * plane, what, err));
    HADA_TRY(HADA_NEW_RAW(of->left, (1 + n) * plane, what, err));
    HADA_TRY(HADA_NEW(of->normal, pairs * n * n, what, err));
    HADA_TRY(HADA_NEW(of->right, pairs * n, what, err));
    HADA_TRY(HADA_NEW(of->sum, n * n, what, err));
    HADA_TRY(HADA_NEW(of->solution, n, what, err));
    work->level.count = 0;
    for (int k = 0; k < TERMS; k++)
        HADA_TRY(show_term(of, k, err));
    return HADA_OK;
}

static void end(equations *of)
{
    HADA_FREE(of->term, of->share, of->left, of->normal, of->right, of->sum, of->solution);
}

/* What is left of a pair as it is, and if each unknown were 1 and all else 0. */
static void leave(equations *of, int pair, int channel)
{
    hada_pair_level *level = &of->work->level;
    const size_t plane = level->plane;
    hada_pair_level_residual(level, pair, channel, of->left);
    hada_pair_level_shares(level, pair, channel, of->share);
    memset(of->left + 2 * plane, 0, (size_t)of->unknowns * 2 * plane * sizeof *of->left);
    for (int j = 0; j < level->count; j++) {
        const float *share = of->share + (size_t)j * 2 * plane;
        for (int k = 0; k < TERMS && level->depth[j] == level->depth[pair]; k++) {
            const float *term = of->term + (size_t)k * 2 * plane;
            float *to = of->left + (size_t)(1 + j * TERMS + k) * 2 * plane;
            for (size_t i = 0; i < 2 * plane; i += 2) {
                to[i] += share[i] * term[i] - share[i + 1] * term[i + 1];
                to[i + 1] += share[i] * term[i + 1] + share[i + 1] * term[i];
            }
        }
    }
}

/* The weights of a channel, [pair][channel][term]. Adds what is left of each pair. */
static void solve_channel(equations *of, int channel, double *weight)
{
    hada_sample *work = of->work;
    const hada_pair_level *level = &work->level;
    const size_t n = (size_t)of->unknowns, plane = 2 * level->plane;
    double *x = of->solution;
    memset(of->sum, 0, n * n * sizeof *of->sum);
    memset(x, 0, n * sizeof *x);
    for (int p = 0; p < work->count; p++) {
        double *normal = of->normal + (size_t)p * n * n, *right = of->right + (size_t)p * n;
        leave(of, p, channel);
        of->rest[p] += hada_pair_level_product(level, of->left, of->left);
        for (size_t a = 0; a < n; a++) {
            const float *at = of->left + (1 + a) * plane;
            right[a] = hada_pair_level_product(level, at, of->left);
            x[a] += right[a] / of->energy[p];
            for (size_t b = 0; b <= a; b++) {
                normal[a * n + b] = normal[b * n + a] = hada_pair_level_product(level, at, of->left + (1 + b) * plane);
                of->sum[a * n + b] += normal[a * n + b] / of->energy[p];
            }
        }
    }
    for (size_t a = 0; a < n; a++)
        of->sum[a * n + a] = of->sum[a * n + a] * (1.0 + LITTLE) + DBL_MIN;
    if (hada_cholesky_factor(of->sum, of->unknowns))
        hada_cholesky_solve(of->sum, of->unknowns, x);
    else
        memset(x, 0, n * sizeof *x);
    for (int p = 0; p < work->count; p++)
        for (size_t a = 0; a < n; a++) {
            of->rest[p] -= 2.0 * x[a] * of->right[(size_t)p * n + a];
            for (size_t b = 0; b < n; b++)
                of->rest[p] += x[a] * x[b] * of->normal[((size_t)p * n + a) * n + b];
        }
    for (size_t a = 0; a < n; a++)
        weight[(a / TERMS * (size_t)work->options.channels + (size_t)channel) * TERMS + a % TERMS] = x[a];
}

static void put_pairs(equations *of, int response)
{
    hada_sample *work = of->work;
    for (int i = 0; i < work->count; i++) {
        hada_pair_level_put(&work->level, i, work->depth[i], &work->frame[i], &work->scene[i][response]);
        of->energy[i] = fmax(work->level.frame_energy[i], DBL_MIN);
        of->rest[i] = 0.0;
    }
}

/* The weights of all channels; gain: exposures of the pairs, NULL: alike. */
static void solve(equations *of, int response, const double *gain, double *weight)
{
    put_pairs(of, response);
    if (gain)
        hada_pair_level_brighten(&of->work->level, gain);
    for (int c = 0; c < of->work->options.channels; c++)
        solve_channel(of, c, weight);
}

/* Takes light off the frames of the level. */
static void take_off(equations *of, const double *weight)
{
    hada_pair_level *level = &of->work->level;
    const size_t plane = 2 * level->plane, channels = (size_t)level->channels;
    for (size_t p = 0; p < (size_t)level->count; p++)
        for (size_t c = 0; c < channels; c++)
            for (size_t k = 0; k < TERMS; k++) {
                const float w = (float)weight[(p * channels + c) * TERMS + k];
                for (size_t i = 0; i < plane; i++)
                    level->frame[(p * channels + c) * plane + i] -= w * of->term[k * plane + i];
            }
}

/* The same with exposures that differ: they are first found without low frequencies, where light is, and then from
 * frames without the light that is found with them, in turns. */
static void solve_apart(equations *of, int response, double *weight)
{
    hada_pair_level *level = &of->work->level;
    double gain[HADA_SAMPLE_MOST], now[HADA_SAMPLE_MOST], unexplained[HADA_SAMPLE_MOST], room[HADA_SAMPLE_MOST];
    put_pairs(of, response);
    for (int k = 0; k < of->work->count; k++)
        gain[k] = 1.0;
    for (int turn = 0; turn < TURNS; turn++) {
        level->sharp = !turn;
        if (turn)
            take_off(of, weight);
        for (int k = 0; k < of->work->count; k++)
            now[k] = 1.0;
        hada_pair_level_even(level, HADA_PAIR_LEVEL_ROUNDS, now, unexplained, room);
        level->sharp = 0;
        for (int k = 0; k < of->work->count; k++)
            gain[k] *= now[k];
        solve(of, response, gain, weight);
    }
}

/* The lights of the sample's pairs, [pair][channel][TERMS], with the response (*best, its number) that leaves least:
 * the mean logarithm of what is left. */
static hada_status find_light(hada_sample *work, int apart, double *light, int *best, hada_error *err)
{
    const size_t weights = (size_t)work->count * (size_t)work->options.channels * TERMS;
    equations of = {0};
    double *now = NULL, least = INFINITY;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(now, weights, "light in the frames of pairs", err));
    HADA_TRY_OR_DONE(begin(&of, work, err));
    for (int r = 0; r < work->tried; r++) {
        double mean = 0.0;
        if (apart)
            solve_apart(&of, r, now);
        else
            solve(&of, r, NULL, now);
        for (int i = 0; i < work->count; i++)
            mean += log(fmax(of.rest[i], HADA_LEAST_SHARE * of.energy[i])) / work->count;
        if (mean < least) {
            least = mean;
            *best = r;
            memcpy(light, now, weights * sizeof *now);
        }
    }
done:
    end(&of);
    free(now);
    return status;
}

/* A group of pairs of a depth, from `first` on. The response of the first group is that of the others. *found: whether
 * they are pairs that fit. */
static hada_status find_group(hada_sample *work, int depth, int first, int count, int apart, double *light, int *found,
                              hada_error *err)
{
    int best = 0;
    hada_status status = HADA_OK;
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(hada_sample_take_pair(work, depth, first + i, err));
    *found = work->count == count;
    if (!*found)
        goto done;
    HADA_TRY_OR_DONE(find_light(work, apart, light, &best, err));
    hada_sample_forget(work);
    work->response += best;
    work->tried = 1;
done:
    hada_sample_forget(work);
    return status;
}

hada_status hada_fit_find_own_light(const hada_fit_options *fit, const hada_dataset *pairs, int apart, double **light,
                                    hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    const size_t each = (size_t)fit->channels * TERMS;
    hada_sample work = {.options = *fit, .pairs = pairs, .counts = info->counts};
    int found = 1;
    double *room = NULL;
    hada_status status = HADA_OK;
    *light = NULL;
    hada_sample_try_responses(&work);
    for (int z = 0; z < info->depths; z++)
        found = found && info->counts[z] >= OWN_LEAST;
    if (!found)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_reducer_create(&work.reducer, &work.options, 0, err));
    HADA_TRY_OR_DONE(hada_pair_level_create(&work.level, work.reducer.grid, fit->channels, TOGETHER, err));
    HADA_TRY_OR_DONE(HADA_NEW(room, TOGETHER * each, "light in the frames of pairs", err));
    HADA_TRY_OR_DONE(HADA_NEW(*light, (size_t)pairs->store->pairs * each, "light in the frames of pairs", err));
    for (int z = 0; z < info->depths && found; z++) {
        const int count = info->counts[z], groups = (count + TOGETHER - 1) / TOGETHER;
        for (int g = 0; g < groups && found; g++) {
            const int first = count * g / groups, in_group = count * (g + 1) / groups - first;
            HADA_TRY_OR_DONE(find_group(&work, z, first, in_group, apart, room, &found, err));
            for (int i = 0; i < in_group; i++)
                memcpy(*light + (size_t)hada_pair_number(pairs, z, first + i) * each, room + (size_t)i * each,
                       each * sizeof *room);
        }
    }
done:
    if (status || !found) {
        free(*light);
        *light = NULL;
    }
    free(room);
    hada_sample_end(&work);
    return status;
}
