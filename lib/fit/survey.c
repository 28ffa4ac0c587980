/* What pairs say before a fit: the response of their scenes, and exposures that differ. First pairs on a small grid,
 * and how much of a frame a convolution that the others of its depth give leaves unexplained, and with which exposure;
 * then the survey itself. */
#include <hadalens/scene.h>
#include <hadalens/survey.h>

#include "core/callers.h"
#include "dataset/dataset.h"
#include "image/small_fft.h"
#include "image/statistics.h"

/* Of one pair: what is left of its frame, and the products of frame and prediction, and of the prediction with itself,
 * at exposure 1. */
typedef struct judgement {
    double left, cross, power;
} judgement;

typedef struct pair_level {
    hada_small_fft fft;
    int channels, most, count; /* pairs: room, and how many there are */
    size_t plane;              /* frequencies of half a spectrum */
    int *depth;                /* of each pair */
    float *frame, *scene;      /* [pair][channel][plane] complex */
    double *frame_energy;      /* per pair: over all frequencies, both halves */
    double *frame_light, *scene_light;
    judgement *judged;
    double *sums; /* room: of a channel, [plane][3] */
    float *work;  /* room: a transform */
} pair_level;

/* What is under a transfer function beside the scenes' power, as a share of its mean: frequencies where others of a
 * depth had no light explain nothing. */
#define FLOOR 1e-3
/* Exposures from each other, after those from the light alone: on simulated and real pairs the third changed them by
 * less than a percent. */
enum { ROUNDS = 3 };
/* An exposure this far from the others of its depth is none: a frame or a scene was dark. */
#define MOST_GAIN 1e3

/* size: a side of the grid, a power of two. */
static hada_status level_create(pair_level *level, int size, int channels, int most, hada_error *err)
{
    const size_t side = (size_t)size, plane = side * (side / 2 + 1), pairs = (size_t)most;
    const size_t values = hada_size_product(pairs * (size_t)channels, 2 * plane);
    *level = (pair_level){.channels = channels, .most = most, .plane = plane};
    HADA_TRY(hada_small_fft_create(&level->fft, size, err));
    HADA_TRY(HADA_NEW(level->depth, pairs, "a survey of pairs", err));
    HADA_TRY(HADA_NEW(level->frame, values, "a survey of pairs", err));
    HADA_TRY(HADA_NEW(level->scene, values, "a survey of pairs", err));
    HADA_TRY(HADA_NEW(level->frame_energy, pairs, "a survey of pairs", err));
    HADA_TRY(HADA_NEW(level->frame_light, pairs, "a survey of pairs", err));
    HADA_TRY(HADA_NEW(level->scene_light, pairs, "a survey of pairs", err));
    HADA_TRY(HADA_NEW(level->judged, pairs, "a survey of pairs", err));
    HADA_TRY(HADA_NEW(level->sums, 3 * plane, "a survey of pairs", err));
    return HADA_NEW(level->work, 2 * side * side, "a survey of pairs", err);
}

static void level_destroy(pair_level *level)
{
    hada_small_fft_destroy(&level->fft);
    HADA_FREE(level->depth, level->frame, level->scene, level->frame_energy, level->frame_light, level->scene_light,
              level->judged, level->sums, level->work);
    *level = (pair_level){0};
}

/* How often a frequency of the half spectrum counts: it lies as [kx][ky] with kx from 0 to size / 2. */
static double weight_of(const pair_level *level, size_t i)
{
    const size_t size = (size_t)level->fft.size, kx = i / size;
    return kx == 0 || 2 * kx == size ? 1.0 : 2.0;
}

/* A channel into the real (0) or imaginary (1) part of the grid. Returns its sum. */
static double place_channel(const pair_level *level, const hada_image *image, int channel, int part)
{
    const size_t size = (size_t)level->fft.size, rows = (size_t)image->rows, cols = (size_t)image->cols;
    const float *from = image->data + (size_t)channel * rows * cols;
    double light = 0.0;
    for (size_t row = 0; row < size; row++)
        for (size_t col = 0; col < size; col++) {
            const float value = row < rows && col < cols ? from[row * cols + col] : 0.0f;
            level->work[2 * (row * size + col) + (size_t)part] = value;
            light += (double)value;
        }
    return light;
}

/* Two real images went through one transform: their spectra, from Z(k) and Z(-k). */
static void part_spectra(const pair_level *level, float *frame, float *scene)
{
    const size_t size = (size_t)level->fft.size;
    for (size_t kx = 0; kx <= size / 2; kx++)
        for (size_t ky = 0; ky < size; ky++) {
            const float *at = level->work + 2 * (kx * size + ky);
            const float *opposite = level->work + 2 * ((size - kx) % size * size + (size - ky) % size);
            float *b = frame + 2 * (kx * size + ky), *x = scene + 2 * (kx * size + ky);
            b[0] = 0.5f * (at[0] + opposite[0]);
            b[1] = 0.5f * (at[1] - opposite[1]);
            x[0] = 0.5f * (at[1] + opposite[1]);
            x[1] = -0.5f * (at[0] - opposite[0]);
        }
}

/* Puts a pair at a place: frame without dark level, scene in light, of the level's channels; both fit on the grid. */
static void level_put(pair_level *level, int place, int depth, const hada_image *frame, const hada_image *scene)
{
    double energy = 0.0, frame_light = 0.0, scene_light = 0.0;
    for (int c = 0; c < level->channels; c++) {
        const size_t first = ((size_t)place * (size_t)level->channels + (size_t)c) * 2 * level->plane;
        frame_light += place_channel(level, frame, c, 0);
        scene_light += place_channel(level, scene, c, 1);
        hada_small_fft_run(&level->fft, level->work);
        part_spectra(level, level->frame + first, level->scene + first);
        for (size_t i = 0; i < level->plane; i++) {
            const float *b = level->frame + first + 2 * i;
            energy += weight_of(level, i) * ((double)b[0] * b[0] + (double)b[1] * b[1]);
        }
    }
    level->depth[place] = depth;
    level->frame_energy[place] = energy;
    level->frame_light[place] = frame_light;
    level->scene_light[place] = scene_light;
    level->count = place < level->count ? level->count : place + 1;
}

/* What one pair adds to the sums of a channel at a frequency: conj(g X) B, and |g X|^2. */
static void products(const float *b, const float *x, double gain, double out[3])
{
    const double re = gain * (double)x[0], im = gain * (double)x[1];
    out[0] = re * (double)b[0] + im * (double)b[1];
    out[1] = re * (double)b[1] - im * (double)b[0];
    out[2] = re * re + im * im;
}

static size_t first_of(const pair_level *level, int pair, int channel)
{
    return ((size_t)pair * (size_t)level->channels + (size_t)channel) * 2 * level->plane;
}

static void add_up(pair_level *level, int depth, int channel, const double *gain)
{
    for (size_t i = 0; i < 3 * level->plane; i++)
        level->sums[i] = 0.0;
    for (int k = 0; k < level->count; k++) {
        const size_t first = first_of(level, k, channel);
        if (level->depth[k] != depth || gain[k] == 0.0)
            continue;
        for (size_t i = 0; i < level->plane; i++) {
            double own[3];
            products(level->frame + first + 2 * i, level->scene + first + 2 * i, gain[k], own);
            for (int s = 0; s < 3; s++)
                level->sums[3 * i + (size_t)s] += own[s];
        }
    }
}

/* Adds a channel, whose sums are ready. */
static void judge_channel(const pair_level *level, int pair, int channel, double gain, judgement *to)
{
    const float *frame = level->frame + first_of(level, pair, channel);
    const float *scene = level->scene + first_of(level, pair, channel);
    double own[3], mean = 0.0;
    for (size_t i = 0; i < level->plane; i++) {
        products(frame + 2 * i, scene + 2 * i, gain, own);
        mean += (level->sums[3 * i + 2] - own[2]) / (double)level->plane;
    }
    for (size_t i = 0; i < level->plane; i++) {
        const double *sums = level->sums + 3 * i, weight = weight_of(level, i);
        const double b[2] = {(double)frame[2 * i], (double)frame[2 * i + 1]};
        const double x[2] = {(double)scene[2 * i], (double)scene[2 * i + 1]};
        products(frame + 2 * i, scene + 2 * i, gain, own);
        const double under = sums[2] - own[2] + FLOOR * mean;
        const double re = under > 0.0 ? (sums[0] - own[0]) / under : 0.0;
        const double im = under > 0.0 ? (sums[1] - own[1]) / under : 0.0;
        const double p[2] = {re * x[0] - im * x[1], re * x[1] + im * x[0]};
        const double off[2] = {b[0] - gain * p[0], b[1] - gain * p[1]};
        to->left += weight * (off[0] * off[0] + off[1] * off[1]);
        to->cross += weight * (p[0] * b[0] + p[1] * b[1]);
        to->power += weight * (p[0] * p[0] + p[1] * p[1]);
    }
}

/* Whether a pair is the first of its depth. */
static int is_first(const pair_level *level, int pair)
{
    for (int k = 0; k < pair; k++)
        if (level->depth[k] == level->depth[pair])
            return 0;
    return 1;
}

/* Per pair: the unexplained share of its frame, and (unless NULL) the exposure that would explain it best, when the
 * other pairs of its depth are taken with their exposures `gain`. Pairs of exposure 0 say nothing to others. */
static void level_judge(pair_level *level, const double *gain, double *unexplained, double *better)
{
    for (int k = 0; k < level->count; k++)
        level->judged[k] = (judgement){0};
    for (int k = 0; k < level->count; k++) {
        if (!is_first(level, k))
            continue;
        for (int c = 0; c < level->channels; c++) {
            add_up(level, level->depth[k], c, gain);
            for (int i = k; i < level->count; i++)
                if (level->depth[i] == level->depth[k])
                    judge_channel(level, i, c, gain[i], &level->judged[i]);
        }
    }
    for (int k = 0; k < level->count; k++) {
        const judgement *one = &level->judged[k];
        unexplained[k] = level->frame_energy[k] > 0.0 ? one->left / level->frame_energy[k] : 0.0;
        if (better)
            better[k] = one->power > 0.0 ? one->cross / one->power : 1.0;
    }
}

static double within(double gain)
{
    return isfinite(gain) && gain > 1.0 / MOST_GAIN ? fmin(gain, MOST_GAIN) : 1.0 / MOST_GAIN;
}

/* Divides by the geometric mean of each depth. */
static void normalise(const pair_level *level, double *gain)
{
    for (int k = 0; k < level->count; k++) {
        double sum = 0.0;
        int members = 0;
        if (!is_first(level, k))
            continue;
        for (int i = k; i < level->count; i++)
            if (level->depth[i] == level->depth[k]) {
                sum += log(gain[i]);
                members++;
            }
        const double mean = exp(sum / members);
        for (int i = k; i < level->count; i++)
            if (level->depth[i] == level->depth[k])
                gain[i] /= mean;
    }
}

/* Exposures of all pairs, from their light, then from each other, and what is unexplained with them. Their geometric
 * mean within a depth is 1. `room`: a number per pair. */
static void level_expose(pair_level *level, double *gain, double *unexplained, double *room)
{
    for (int k = 0; k < level->count; k++)
        gain[k] = within(level->scene_light[k] > 0.0 ? level->frame_light[k] / level->scene_light[k] : 1.0);
    normalise(level, gain);
    for (int round = 0; round < ROUNDS; round++) {
        level_judge(level, gain, unexplained, room);
        for (int k = 0; k < level->count; k++)
            gain[k] = within(room[k]);
        normalise(level, gain);
    }
    level_judge(level, gain, unexplained, NULL);
}

/* Reduced frames have about so many pixels a side, and windows at least so many: where more were kept (60, 80, 135) the
 * same response had the least share, on simulated and on real pairs (docs/explanation/learning-a-camera.md). */
enum { FRAME_SIDE = 32, WINDOW_LEAST = 8 };
/* Pairs that are looked at: of the nearest, the middle and the farthest depth. Fewer than LEAST of a depth leave too
 * few to learn from when one is held out. */
enum { DEPTHS = 3, PAIRS_EACH = 6, MOST_PAIRS = DEPTHS * PAIRS_EACH, LEAST = 3 };
/* Of a depth, pairs from which exposures are found; further ones are held against these. */
enum { EXPOSED_TOGETHER = 32 };

/* From nothing to what displays and cameras use, and beyond; pairs showed exponents a tenth apart. */
static const double responses[] = {HADA_RESPONSE_LINEAR, 1.25, 1.5, 1.8, 2.0, HADA_RESPONSE_SRGB, 2.2, 2.6};
enum { RESPONSES = sizeof responses / sizeof *responses };

/* Another response than linear must leave less unexplained by about this share (a difference of logarithms), and by so
 * many standard errors of the difference over pairs. */
#define BETTER_BY     0.1
#define BETTER_ERRORS 2.0
/* Exposures are taken apart where that leaves less than this share of what is unexplained otherwise. On frames that
 * were exposed alike it takes off a few percent, on those exposed by a factor of two it left a fiftieth. */
#define APART_BELOW 0.5

/* Shares below this, of frames without noise, count as this. */
#define LEAST_SHARE 1e-9

/* A survey and what it points to. */
typedef struct owned_survey {
    hada_survey survey;
    hada_survey_row row[RESPONSES];
    const hada_survey_row *list[RESPONSES + 1];
    int depths;
    double **gain; /* of each depth; NULL: exposures are alike */
} owned_survey;

/* The work of a survey. */
typedef struct surveying {
    hada_fit_options options;
    const hada_dataset *pairs;
    const int *counts; /* pairs of each depth */
    hada_progress progress;
    int factor, grid; /* pixels that become one; a side of the small grid */
    int tried;        /* responses: 1 where it is given */
    const double *response;
    pair_level level;
    int count, depth[MOST_PAIRS];
    hada_image frame[MOST_PAIRS], scene[MOST_PAIRS][RESPONSES];
    double unexplained[RESPONSES][2][MOST_PAIRS]; /* exposures alike, and apart */
    float *room;                                  /* a channel of a frame */
} surveying;

/* A reduction that keeps some pixels of frame and window. */
static void choose_grid(surveying *work)
{
    const hada_fit_options *options = &work->options;
    const int frame = options->raw_rows > options->raw_cols ? options->raw_rows : options->raw_cols;
    const int window = options->window_rows > options->window_cols ? options->window_rows : options->window_cols;
    const int narrow = hada_least(options->window_rows, options->window_cols);
    work->factor = hada_least((frame + FRAME_SIDE - 1) / FRAME_SIDE, narrow / WINDOW_LEAST);
    work->factor = work->factor > 1 ? work->factor : 1;
    for (work->grid = 1; work->grid < (frame + window) / work->factor;)
        work->grid *= 2;
}

/* The centre of an image, cut to whole blocks of factor x factor pixels, to one pixel a block. */
static hada_status reduce(const surveying *work, const hada_image *image, int rows, int cols, double response,
                          hada_image *out, hada_error *err)
{
    const int high = rows / work->factor, wide = cols / work->factor;
    const int whole_rows = high * work->factor, whole_cols = wide * work->factor;
    hada_image centre = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_crop(&centre, image, (image->rows - whole_rows) / 2, (image->cols - whole_cols) / 2,
                                     whole_rows, whole_cols, err));
    hada_response_convert(centre.data, hada_image_count(&centre), response, HADA_RESPONSE_LINEAR);
    HADA_TRY_OR_DONE(hada_image_resize(out, &centre, high, wide, err));
done:
    hada_image_destroy(&centre);
    return status;
}

static hada_status reduce_frame(const surveying *work, const hada_image *raw, hada_image *out, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    const size_t area = (size_t)raw->rows * (size_t)raw->cols;
    HADA_TRY(reduce(work, raw, raw->rows, raw->cols, HADA_RESPONSE_LINEAR, out, err));
    const size_t small = (size_t)out->rows * (size_t)out->cols;
    for (size_t c = 0; c < (size_t)out->channels; c++) {
        const double dark =
            options->dark == HADA_AUTO ? hada_dark_estimate(raw->data + c * area, area, work->room) : options->dark;
        for (size_t i = 0; i < small; i++)
            out->data[c * small + i] -= (float)dark;
    }
    return HADA_OK;
}

/* Whether a pair is one that the fit will take. */
static int fits(const hada_fit_options *options, const hada_image *raw, const hada_image *scene)
{
    const int whole = scene->rows == options->raw_rows && scene->cols == options->raw_cols;
    const int window = scene->rows == options->window_rows && scene->cols == options->window_cols;
    return raw->channels == options->channels && raw->rows == options->raw_rows && raw->cols == options->raw_cols &&
           scene->channels == options->channels && (whole || window) && !hada_image_count_not_finite(raw) &&
           !hada_image_count_not_finite(scene);
}

/* Reads pair number `pair` of a depth, its scene in all responses tried. */
static hada_status take_pair(surveying *work, int depth, int pair, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    hada_pair taken = {0};
    hada_status status = HADA_OK;
    if (!work->progress.what)
        work->progress = hada_progress_begin(options->monitor, "looks at pairs, for the response of their scenes", 0);
    HADA_TRY(hada_progress_step(&work->progress, NULL, err));
    HADA_TRY(hada_pair_take(&taken, work->pairs, depth, pair, err));
    if (!fits(options, taken.raw, taken.scene))
        goto done;
    HADA_TRY_OR_DONE(reduce_frame(work, taken.raw, &work->frame[work->count], err));
    work->depth[work->count] = depth;
    work->count++; /* from here on it is freed */
    for (int r = 0; r < work->tried; r++)
        HADA_TRY_OR_DONE(reduce(work, taken.scene, options->window_rows, options->window_cols, work->response[r],
                                &work->scene[work->count - 1][r], err));
done:
    hada_pair_return(&taken);
    return status;
}

static void forget_pairs(surveying *work)
{
    for (int k = 0; k < work->count; k++) {
        hada_image_destroy(&work->frame[k]);
        for (int r = 0; r < work->tried; r++)
            hada_image_destroy(&work->scene[k][r]);
    }
    work->count = 0;
}

/* Up to PAIRS_EACH pairs, evenly spread, of the depths that are looked at. */
static hada_status take_pairs(surveying *work, hada_error *err)
{
    const int depths = work->options.depths, looked = hada_least(depths, DEPTHS);
    for (int k = 0; k < looked; k++) {
        const int z = looked == 1 ? 0 : k * (depths - 1) / (looked - 1), all = work->counts[z];
        const int count = all < LEAST ? 0 : hada_least(all, PAIRS_EACH);
        for (int i = 0; i < count; i++)
            HADA_TRY(take_pair(work, z, (int)((long)i * all / count), err));
    }
    return HADA_OK;
}

static void compare(surveying *work)
{
    double gain[MOST_PAIRS], room[MOST_PAIRS];
    for (int r = 0; r < work->tried; r++) {
        for (int k = 0; k < work->count; k++) {
            level_put(&work->level, k, work->depth[k], &work->frame[k], &work->scene[k][r]);
            gain[k] = 1.0;
        }
        level_judge(&work->level, gain, work->unexplained[r][0], NULL);
        level_expose(&work->level, gain, work->unexplained[r][1], room);
    }
}

/* The geometric mean: shares of one response differ by ten from pair to pair, and their mean is that of the worst. */
static double mean_of(const double *shares, int count)
{
    double sum = 0.0;
    for (int k = 0; k < count; k++)
        sum += log(fmax(shares[k], LEAST_SHARE)) / count;
    return exp(sum);
}

/* The response with the least share, exposures alike (0) or apart (1); the first one, linear, unless there is
 * evidence. */
static int best_response(const surveying *work, int apart)
{
    int best = 0;
    for (int r = 1; r < work->tried; r++)
        if (mean_of(work->unexplained[r][apart], work->count) < mean_of(work->unexplained[best][apart], work->count))
            best = r;
    const double *linear = work->unexplained[0][apart], *other = work->unexplained[best][apart];
    const double gain = log(mean_of(linear, work->count) / mean_of(other, work->count));
    double spread = 0.0;
    for (int k = 0; k < work->count; k++) {
        const double off = log(fmax(linear[k], LEAST_SHARE) / fmax(other[k], LEAST_SHARE)) - gain;
        spread += off * off;
    }
    const double error = sqrt(spread / ((double)work->count * fmax(1.0, work->count - 1.0)));
    return gain > BETTER_BY && gain > BETTER_ERRORS * error ? best : 0;
}

/* Fills the rows; returns whether exposures are to be taken apart. */
static int choose(owned_survey *own, const surveying *work, hada_exposure exposure)
{
    const int alike = best_response(work, 0), apart = best_response(work, 1);
    const int exposed =
        exposure == HADA_EXPOSURE_EACH ||
        (exposure == HADA_EXPOSURE_AUTO && mean_of(work->unexplained[apart][1], work->count) <
                                               APART_BELOW * mean_of(work->unexplained[alike][0], work->count));
    const int chosen = exposed ? apart : alike;
    own->survey.response = work->response[chosen];
    for (int r = 0; r < work->tried; r++) {
        own->row[r] = (hada_survey_row){.response = work->response[r],
                                        .unexplained = mean_of(work->unexplained[r][0], work->count),
                                        .unexplained_apart = mean_of(work->unexplained[r][1], work->count),
                                        .chosen = r == chosen};
        own->list[r] = &own->row[r];
    }
    return exposed;
}

/* Exposures of all pairs of a depth, which are 1 to begin with: some together, each further one against these. */
static hada_status expose_depth(surveying *work, int z, double *exposure, hada_error *err)
{
    enum { PLACES = EXPOSED_TOGETHER + 1 };
    double gain[PLACES] = {0.0}, unexplained[PLACES], room[PLACES];
    int pair_at[PLACES], together = 0;
    hada_status status = HADA_OK;
    work->level.count = 0;
    for (int i = 0; i < work->counts[z]; i++) {
        if (i == EXPOSED_TOGETHER)
            level_expose(&work->level, gain, unexplained, room);
        forget_pairs(work);
        HADA_TRY_OR_DONE(take_pair(work, z, i, err));
        if (!work->count)
            continue;
        level_put(&work->level, together, z, &work->frame[0], &work->scene[0][0]);
        if (i < EXPOSED_TOGETHER) {
            pair_at[together++] = i;
        } else {
            gain[together] = 0.0;
            level_judge(&work->level, gain, unexplained, room);
            exposure[i] = room[together] > 0.0 ? room[together] : 1.0;
        }
    }
    if (together < 2)
        goto done;
    if (work->counts[z] <= EXPOSED_TOGETHER)
        level_expose(&work->level, gain, unexplained, room);
    for (int k = 0; k < together; k++)
        exposure[pair_at[k]] = gain[k];
done:
    forget_pairs(work);
    return status;
}

static hada_status expose_all(owned_survey *own, surveying *work, hada_error *err)
{
    work->response = &own->survey.response;
    work->tried = 1;
    level_destroy(&work->level);
    HADA_TRY(level_create(&work->level, work->grid, work->options.channels, EXPOSED_TOGETHER + 1, err));
    HADA_TRY(HADA_NEW(own->gain, (size_t)own->depths, "exposures", err));
    for (int z = 0; z < own->depths; z++) {
        HADA_TRY(HADA_NEW(own->gain[z], (size_t)work->counts[z], "exposures", err));
        for (int i = 0; i < work->counts[z]; i++)
            own->gain[z][i] = 1.0;
        HADA_TRY(expose_depth(work, z, own->gain[z], err));
    }
    own->survey.gains = (const double *const *)own->gain;
    return HADA_OK;
}

static hada_status make(owned_survey *own, surveying *work, hada_exposure exposure, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    hada_survey *survey = &own->survey;
    own->depths = options->depths;
    survey->rows = own->list;
    survey->response = options->scene_response == HADA_AUTO ? HADA_RESPONSE_LINEAR : options->scene_response;
    work->tried = options->scene_response == HADA_AUTO ? RESPONSES : 1;
    work->response = work->tried == 1 ? &options->scene_response : responses;
    choose_grid(work);
    HADA_TRY(HADA_NEW(work->room, (size_t)options->raw_rows * (size_t)options->raw_cols, "a raw frame", err));
    HADA_TRY(level_create(&work->level, work->grid, options->channels, MOST_PAIRS, err));
    HADA_TRY(take_pairs(work, err));
    survey->exposed = exposure == HADA_EXPOSURE_EACH;
    if (work->count >= LEAST) {
        compare(work);
        survey->exposed = choose(own, work, exposure);
    }
    forget_pairs(work);
    return survey->exposed ? expose_all(own, work, err) : HADA_OK;
}

static hada_status check(const hada_fit_options *options, const hada_dataset_info *pairs, hada_error *err)
{
    if (options->depths != pairs->depths || options->channels < 1 || options->window_rows < 1 ||
        options->window_cols < 1 || options->window_rows > options->raw_rows ||
        options->window_cols > options->raw_cols)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "hada_survey_create: the depths of the data set and the sizes of frames and windows are needed");
    if (options->scene_response != HADA_AUTO && !hada_response_is_known(options->scene_response))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the response of the scenes, %g, is none (hadalens/response.h)",
                         options->scene_response);
    return HADA_OK;
}

hada_status hada_survey_create(hada_survey **out, const hada_fit_options *callers, const hada_dataset *pairs,
                               hada_exposure exposure, hada_error *err)
{
    surveying work = {.pairs = pairs};
    owned_survey *own = NULL;
    hada_status status = HADA_OK;
    HADA_NEED(out && callers && pairs, err);
    *out = NULL;
    hada_fit_options_init(&work.options);
    HADA_TRY(HADA_OPTIONS_TAKE(&work.options, callers, hada_fit_options, err));
    HADA_TRY(check(&work.options, hada_dataset_get_info(pairs), err));
    work.counts = hada_dataset_get_info(pairs)->counts;
    HADA_TRY(HADA_NEW(own, 1, "a survey of pairs", err));
    *out = &own->survey;
    HADA_TRY_OR_DONE(make(own, &work, exposure, err));
done:
    if (work.progress.what)
        hada_progress_end(&work.progress);
    forget_pairs(&work);
    level_destroy(&work.level);
    free(work.room);
    if (status)
        hada_survey_destroy(out);
    return status;
}

void hada_survey_destroy(hada_survey **pointer)
{
    owned_survey *own = pointer ? (owned_survey *)*pointer : NULL; /* its first member */
    if (!own)
        return;
    *pointer = NULL;
    for (int z = 0; own->gain && z < own->depths; z++)
        free(own->gain[z]);
    HADA_FREE(own->gain, own);
}

hada_status hada_survey_apply(hada_dataset **out, const hada_survey *survey, const hada_dataset *pairs, hada_error *err)
{
    HADA_NEED(out && survey && pairs, err);
    return hada_dataset_brighten(out, pairs, survey->gains, survey->response, err);
}
