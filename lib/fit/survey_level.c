#include "fit/survey_level.h"

#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"

/* What stands under a transfer function beside the scenes' power, as a share of its mean: frequencies where others of a
 * depth had no light explain nothing. */
#define FLOOR 1e-3
/* Exposures from each other, after those from the light alone: on simulated and real pairs the third changed them by
 * less than a percent. */
enum { ROUNDS = 3 };
/* An exposure this far from the others of its depth is none: a frame or a scene was dark. */
#define MOST_GAIN 1e3

hada_status hada_survey_level_create(hada_survey_level *level, int size, int channels, int most, hada_error *err)
{
    const size_t side = (size_t)size, plane = side * (side / 2 + 1), pairs = (size_t)most;
    const size_t values = hada_size_product(pairs * (size_t)channels, 2 * plane);
    *level = (hada_survey_level){.channels = channels, .most = most, .plane = plane};
    HADA_TRY(hada_small_fft_create(&level->fft, size, err));
    HADA_TRY(hada_allocated(level->depth = hada_alloc(pairs, sizeof *level->depth, "a survey of pairs", err)));
    HADA_TRY(hada_allocated(level->frame = hada_alloc(values, sizeof(float), "a survey of pairs", err)));
    HADA_TRY(hada_allocated(level->scene = hada_alloc(values, sizeof(float), "a survey of pairs", err)));
    HADA_TRY(hada_allocated(level->frame_energy = hada_alloc(pairs, sizeof(double), "a survey of pairs", err)));
    HADA_TRY(hada_allocated(level->frame_light = hada_alloc(pairs, sizeof(double), "a survey of pairs", err)));
    HADA_TRY(hada_allocated(level->scene_light = hada_alloc(pairs, sizeof(double), "a survey of pairs", err)));
    HADA_TRY(hada_allocated(level->judged = hada_alloc(pairs, sizeof *level->judged, "a survey of pairs", err)));
    HADA_TRY(hada_allocated(level->sums = hada_alloc(3 * plane, sizeof(double), "a survey of pairs", err)));
    return hada_allocated(level->work = hada_alloc(2 * side * side, sizeof(float), "a survey of pairs", err));
}

void hada_survey_level_destroy(hada_survey_level *level)
{
    hada_small_fft_destroy(&level->fft);
    free(level->depth);
    free(level->frame);
    free(level->scene);
    free(level->frame_energy);
    free(level->frame_light);
    free(level->scene_light);
    free(level->judged);
    free(level->sums);
    free(level->work);
    *level = (hada_survey_level){0};
}

/* How often a frequency of the half spectrum counts: it stands [kx][ky] with kx from 0 to size / 2. */
static double weight_of(const hada_survey_level *level, size_t i)
{
    const size_t size = (size_t)level->fft.size, kx = i / size;
    return kx == 0 || 2 * kx == size ? 1.0 : 2.0;
}

/* A channel into the real (0) or imaginary (1) part of the grid. Returns its sum. */
static double place_channel(const hada_survey_level *level, const hada_image *image, int channel, int part)
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
static void part_spectra(const hada_survey_level *level, float *frame, float *scene)
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

void hada_survey_level_put(hada_survey_level *level, int place, int depth, const hada_image *frame,
                           const hada_image *scene)
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

static size_t first_of(const hada_survey_level *level, int pair, int channel)
{
    return ((size_t)pair * (size_t)level->channels + (size_t)channel) * 2 * level->plane;
}

static void add_up(hada_survey_level *level, int depth, int channel, const double *gain)
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

/* Adds a channel, whose sums stand ready. */
static void judge_channel(const hada_survey_level *level, int pair, int channel, double gain, hada_survey_judgement *to)
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
static int is_first(const hada_survey_level *level, int pair)
{
    for (int k = 0; k < pair; k++)
        if (level->depth[k] == level->depth[pair])
            return 0;
    return 1;
}

void hada_survey_level_judge(hada_survey_level *level, const double *gain, double *unexplained, double *better)
{
    for (int k = 0; k < level->count; k++)
        level->judged[k] = (hada_survey_judgement){0};
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
        const hada_survey_judgement *one = &level->judged[k];
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
static void normalise(const hada_survey_level *level, double *gain)
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

void hada_survey_level_expose(hada_survey_level *level, double *gain, double *unexplained, double *room)
{
    for (int k = 0; k < level->count; k++)
        gain[k] = within(level->scene_light[k] > 0.0 ? level->frame_light[k] / level->scene_light[k] : 1.0);
    normalise(level, gain);
    for (int round = 0; round < ROUNDS; round++) {
        hada_survey_level_judge(level, gain, unexplained, room);
        for (int k = 0; k < level->count; k++)
            gain[k] = within(room[k]);
        normalise(level, gain);
    }
    hada_survey_level_judge(level, gain, unexplained, NULL);
}
