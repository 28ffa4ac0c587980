/* What the frames of pairs hold without the scenes' light: a dark level, or light of the room as a smooth surface. */
#include <float.h>
#include <hadalens/response.h>

#include "core/numbers.h"
#include "fit/fitter.h"
#include "fit/sample.h"
#include "image/correct.h"
#include "image/statistics.h"

/* Dark levels are tried in so many steps up to the darkest place of all frames, then between the best one's neighbours;
 * below LEAST_DARK of full scale none is looked for. A level must leave less of the frames by this factor,
 * surely (perf/results/learning.md). */
enum { LEVELS = 6, SECTIONS = 10, RESPONSES = 3 };
#define LEAST_DARK  1e-3
#define DARK_BETTER 1.5
/* A surface's equations are solved with their diagonal so much larger, and it must leave less by this factor; whether
 * it is right, confirm.c says. */
enum { TERMS = HADA_SMOOTH_TERMS };
#define SOLVABLE       1e-9
#define SURFACE_BETTER 1.2
static const double responses[RESPONSES] = {HADA_RESPONSE_LINEAR, 1.5, HADA_RESPONSE_SRGB};

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

/* A smooth surface of each channel, sum over k of weight[c][k] term(k), and what is left without it. */
typedef struct surface {
    double *weight; /* [channel][TERMS] */
    left_over left;
    double energy[HADA_SAMPLE_MOST]; /* of the frames */
    float *residual;                 /* room: [1 + TERMS][channel][pair][plane] complex */
} surface;

/* Where row i of the reduced frame lies on the sensor. */
static double place(int i, int count, int factor, int whole)
{
    return hada_smooth_place((i + 0.5) * factor + (whole - count * factor) / 2, whole);
}

/* A frame that shows a term alone. */
static hada_status show_term(const hada_sample *work, int k, hada_image *out, hada_error *err)
{
    const hada_image *like = &work->frame[0];
    const size_t cols = (size_t)like->cols, area = cols * (size_t)like->rows;
    const int factor = work->reducer.factor;
    HADA_TRY(hada_image_create(out, like->channels, like->rows, like->cols, err));
    for (size_t i = 0; i < hada_image_count(out); i++)
        out->data[i] =
            (float)hada_smooth_term(k, place((int)(i % area / cols), like->rows, factor, work->options.raw_rows),
                                    place((int)(i % cols), like->cols, factor, work->options.raw_cols));
    return HADA_OK;
}

/* What is left of all pairs where their frames are so: term k, or (k = -1) as they are; [channel][pair][plane]. */
static hada_status leave(hada_sample *work, int k, int response, float *to, hada_error *err)
{
    hada_image shown = {0};
    if (k >= 0)
        HADA_TRY(show_term(work, k, &shown, err));
    for (int i = 0; i < work->count; i++)
        hada_pair_level_put(&work->level, i, work->depth[i], k < 0 ? &work->frame[i] : &shown,
                            &work->scene[i][response]);
    for (int c = 0; c < work->options.channels; c++)
        for (int i = 0; i < work->count; i++, to += 2 * work->level.plane)
            hada_pair_level_residual(&work->level, i, c, to);
    hada_image_destroy(&shown);
    return HADA_OK;
}

/* The weights of a channel: what is left of a pair is linear in them, so they follow from least squares, each pair by
 * its energy. Adds what is left. */
static void fit_channel(const hada_sample *work, int channel, surface *to)
{
    const hada_pair_level *level = &work->level;
    const size_t values = 2 * level->plane, own_pairs = (size_t)work->count * values;
    const size_t all = (size_t)work->options.channels * own_pairs; /* of a term */
    float *residual = to->residual + (size_t)channel * own_pairs;
    double a[TERMS][TERMS] = {{0.0}}, *weight = to->weight + channel * TERMS;
    for (int k = 0; k < TERMS; k++) {
        weight[k] = 0.0;
        for (int i = 0; i < work->count; i++) {
            const float *at = residual + (size_t)i * values, *own = at + (size_t)(k + 1) * all;
            weight[k] += hada_pair_level_product(level, own, at) / to->energy[i];
            for (int n = 0; n <= k; n++)
                a[k][n] += hada_pair_level_product(level, own, at + (size_t)(n + 1) * all) / to->energy[i];
        }
        a[k][k] *= 1.0 + SOLVABLE;
    }
    if (hada_cholesky_factor(a[0], TERMS))
        hada_cholesky_solve(a[0], TERMS, weight);
    else /* frames of nothing */
        memset(weight, 0, TERMS * sizeof *weight);
    for (int i = 0; i < work->count; i++) {
        float *at = residual + (size_t)i * values;
        for (int k = 0; k < TERMS; k++)
            for (size_t v = 0; v < values; v++)
                at[v] -= (float)weight[k] * at[(size_t)(k + 1) * all + v];
        to->left.log[i] += hada_pair_level_product(level, at, at);
    }
}

/* With the response that leaves least. */
static hada_status fit_surface(hada_sample *work, surface *best, surface *room, hada_error *err)
{
    const int channels = work->options.channels;
    const size_t all = (size_t)channels * (size_t)work->count * 2 * work->level.plane;
    best->left.mean = INFINITY;
    for (int r = 0; r < work->tried; r++) {
        room->left = (left_over){0};
        for (int k = 0; k <= TERMS; k++) {
            HADA_TRY(leave(work, k - 1, r, room->residual + (size_t)k * all, err));
            for (int i = 0; !k && i < work->count; i++)
                room->energy[i] = fmax(work->level.frame_energy[i], DBL_MIN);
        }
        for (int c = 0; c < channels; c++)
            fit_channel(work, c, room);
        for (int i = 0; i < work->count; i++) {
            room->left.log[i] = log(fmax(room->left.log[i], HADA_LEAST_SHARE * room->energy[i]));
            room->left.mean += room->left.log[i] / work->count;
        }
        if (room->left.mean >= best->left.mean)
            continue;
        best->left = room->left;
        memcpy(best->weight, room->weight, (size_t)channels * TERMS * sizeof *best->weight);
    }
    return HADA_OK;
}

/* The surface on the sensor, where less is left with it than otherwise, surely; no channel of it is dark in the mean.
 */
static hada_status draw(const hada_sample *work, const surface *from, const left_over *otherwise, hada_image *out,
                        hada_error *err)
{
    const hada_fit_options *options = &work->options;
    if (!(otherwise->mean - from->left.mean > log(SURFACE_BETTER)))
        return HADA_OK;
    for (int c = 0; c < options->channels; c++)
        if (!(hada_smooth_mean(from->weight + c * TERMS) > 0.0))
            return HADA_OK;
    HADA_TRY(hada_image_create(out, options->channels, options->raw_rows, options->raw_cols, err));
    hada_smooth_add(from->weight, 1.0, out);
    return HADA_OK;
}

static hada_status find_surface(hada_sample *work, const left_over *otherwise, hada_image *out, hada_error *err)
{
    const size_t weights = (size_t)work->options.channels * TERMS;
    surface best = {0}, room = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(best.weight, weights, "light of the room", err));
    HADA_TRY_OR_DONE(HADA_NEW(room.weight, weights, "light of the room", err));
    HADA_TRY_OR_DONE(HADA_NEW(
        room.residual, (1 + TERMS) * (size_t)work->options.channels * (size_t)work->count * 2 * work->level.plane,
        "light of the room", err));
    HADA_TRY_OR_DONE(fit_surface(work, &best, &room, err));
    HADA_TRY_OR_DONE(draw(work, &best, otherwise, out, err));
done:
    HADA_FREE(best.weight, room.weight, room.residual);
    return status;
}

hada_status hada_fit_find_dark(hada_fit_options *options, const hada_dataset *pairs, hada_image *found, hada_error *err)
{
    hada_sample work = {.options = *options, .pairs = pairs, .counts = hada_dataset_get_info(pairs)->counts};
    left_over none, level;
    hada_status status = HADA_OK;
    if (options->dark != 0.0 || hada_dataset_get_info(pairs)->dark_frame)
        options->find_dark = 0;
    if (!options->find_dark)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_sample_begin(&work, err));
    const double most = darkest(&work);
    if (work.count < HADA_SAMPLE_LEAST || (most < LEAST_DARK && !found))
        goto done;
    hada_sample_forget(&work);
    work.tried = options->scene_response == HADA_AUTO ? RESPONSES : 1;
    work.response = work.tried == 1 ? &options->scene_response : responses;
    HADA_TRY_OR_DONE(hada_sample_take(&work, err));
    none = level = try_level(&work, 0.0);
    if (most >= LEAST_DARK)
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
