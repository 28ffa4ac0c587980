#include "fit/pair_level.h"

#include <hadalens/response.h>
#include <hadalens/scene.h>

#include "image/statistics.h"

/* Reduced frames have about so many pixels a side, and windows at least so many: where more were kept (60, 80, 135) the
 * same response had the least share, on simulated and on real pairs (docs/explanation/learning-a-camera.md). */
enum { FRAME_SIDE = 32, WINDOW_LEAST = 8 };
/* A reduction that keeps some pixels of frame and window. */
static void choose_grid(hada_reducer *work)
{
    const hada_fit_options *options = work->options;
    const int frame = options->raw_rows > options->raw_cols ? options->raw_rows : options->raw_cols;
    const int window = options->window_rows > options->window_cols ? options->window_rows : options->window_cols;
    const int narrow = hada_least(options->window_rows, options->window_cols);
    const int whole =
        work->grid ? (frame + window + work->grid - 1) / work->grid : (frame + FRAME_SIDE - 1) / FRAME_SIDE;
    work->factor = hada_least(whole, narrow / WINDOW_LEAST);
    work->factor = work->factor > 1 ? work->factor : 1;
    for (work->grid = 1; work->grid < (frame + window) / work->factor;)
        work->grid *= 2;
}

/* The centre of an image, cut to whole blocks of factor x factor pixels, to one pixel a block. */
static hada_status reduce(const hada_reducer *work, const hada_image *image, int rows, int cols, double response,
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

hada_status hada_reducer_create(hada_reducer *reducer, const hada_fit_options *options, int grid, hada_error *err)
{
    *reducer = (hada_reducer){.options = options, .grid = grid, .response = HADA_RESPONSE_LINEAR};
    choose_grid(reducer);
    return HADA_NEW(reducer->room, (size_t)options->raw_rows * (size_t)options->raw_cols, "a raw frame", err);
}

void hada_reducer_destroy(hada_reducer *reducer)
{
    free(reducer->room);
    *reducer = (hada_reducer){0};
}

hada_status hada_reduce_frame(const hada_reducer *work, const hada_image *raw, hada_image *out, hada_error *err)
{
    const hada_fit_options *options = work->options;
    const size_t area = (size_t)raw->rows * (size_t)raw->cols;
    HADA_TRY(reduce(work, raw, raw->rows, raw->cols, work->response, out, err));
    const size_t small = (size_t)out->rows * (size_t)out->cols;
    for (size_t c = 0; c < (size_t)out->channels; c++) {
        const double dark =
            options->dark == HADA_AUTO ? hada_dark_estimate(raw->data + c * area, area, work->room) : options->dark;
        for (size_t i = 0; i < small; i++)
            out->data[c * small + i] -= (float)dark;
    }
    return HADA_OK;
}

hada_status hada_reduce_scene(const hada_reducer *work, const hada_image *scene, double response, hada_image *out,
                              hada_error *err)
{
    return reduce(work, scene, work->options->window_rows, work->options->window_cols, response, out, err);
}

int hada_reducer_fits(const hada_reducer *reducer, const hada_image *raw, const hada_image *scene)
{
    const hada_fit_options *options = reducer->options;
    const int whole = scene->rows == options->raw_rows && scene->cols == options->raw_cols;
    const int window = scene->rows == options->window_rows && scene->cols == options->window_cols;
    return raw->channels == options->channels && raw->rows == options->raw_rows && raw->cols == options->raw_cols &&
           scene->channels == options->channels && (whole || window) && !hada_image_count_not_finite(raw) &&
           !hada_image_count_not_finite(scene);
}

/* What is under a transfer function beside the scenes' power, as a share of its mean: frequencies where others of a
 * depth had no light explain nothing. */
#define FLOOR 1e-3
/* Frequencies up to this one are low. */
enum { LOW = 2 };
/* An exposure this far from the others of its depth is none: a frame or a scene was dark. */
#define MOST_GAIN 1e3

hada_status hada_pair_level_create(hada_pair_level *level, int size, int channels, int most, hada_error *err)
{
    const size_t side = (size_t)size, plane = side * (side / 2 + 1), pairs = (size_t)most;
    const size_t values = hada_size_product(pairs * (size_t)channels, 2 * plane);
    *level = (hada_pair_level){.channels = channels, .most = most, .plane = plane};
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

void hada_pair_level_destroy(hada_pair_level *level)
{
    hada_small_fft_destroy(&level->fft);
    HADA_FREE(level->depth, level->frame, level->scene, level->frame_energy, level->frame_light, level->scene_light,
              level->judged, level->sums, level->work);
    *level = (hada_pair_level){0};
}

/* How often a frequency of the half spectrum counts: it lies as [kx][ky] with kx from 0 to size / 2. */
static double weight_of(const hada_pair_level *level, size_t i)
{
    const size_t size = (size_t)level->fft.size, kx = i / size;
    return kx == 0 || 2 * kx == size ? 1.0 : 2.0;
}

/* Whether it is one of those where nearly all of a smooth surface is, cut off at the frame's edges. */
static int is_low(const hada_pair_level *level, size_t i)
{
    const size_t size = (size_t)level->fft.size, ky = i % size;
    return i / size <= LOW || ky <= LOW || size - ky <= LOW;
}

/* A channel into the real (0) or imaginary (1) part of the grid. Returns its sum. */
static double place_channel(const hada_pair_level *level, const hada_image *image, int channel, int part)
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

void hada_pair_level_put(hada_pair_level *level, int place, int depth, const hada_image *frame, const hada_image *scene)
{
    double energy = 0.0, frame_light = 0.0, scene_light = 0.0;
    for (int c = 0; c < level->channels; c++) {
        const size_t first = ((size_t)place * (size_t)level->channels + (size_t)c) * 2 * level->plane;
        frame_light += place_channel(level, frame, c, 0);
        scene_light += place_channel(level, scene, c, 1);
        hada_small_fft_run(&level->fft, level->work);
        hada_small_fft_part(&level->fft, level->work, level->frame + first, level->scene + first);
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

static size_t first_of(const hada_pair_level *level, int pair, int channel)
{
    return ((size_t)pair * (size_t)level->channels + (size_t)channel) * 2 * level->plane;
}

/* gain NULL: all are 1. */
static void add_up(hada_pair_level *level, int depth, int channel, const double *gain)
{
    for (size_t i = 0; i < 3 * level->plane; i++)
        level->sums[i] = 0.0;
    for (int k = 0; k < level->count; k++) {
        const size_t first = first_of(level, k, channel);
        const double own_gain = gain ? gain[k] : 1.0;
        if (level->depth[k] != depth || own_gain == 0.0)
            continue;
        for (size_t i = 0; i < level->plane; i++) {
            double own[3];
            products(level->frame + first + 2 * i, level->scene + first + 2 * i, own_gain, own);
            for (int s = 0; s < 3; s++)
                level->sums[3 * i + (size_t)s] += own[s];
        }
    }
}

/* The power of the other pairs' scenes, in the mean over frequencies. `taken`: the exposure that the pair itself has in
 * the sums, which is taken off. */
static double mean_power(const hada_pair_level *level, const float *frame, const float *scene, double taken)
{
    double own[3], mean = 0.0;
    for (size_t i = 0; i < level->plane; i++) {
        products(frame + 2 * i, scene + 2 * i, taken, own);
        mean += (level->sums[3 * i + 2] - own[2]) / (double)level->plane;
    }
    return mean;
}

/* What the others predict of value i of a frame's spectrum. */
static void predict(const hada_pair_level *level, const float *frame, const float *scene, double taken, double mean,
                    size_t i, double p[2])
{
    const double *sums = level->sums + 3 * i, x[2] = {(double)scene[2 * i], (double)scene[2 * i + 1]};
    double own[3];
    products(frame + 2 * i, scene + 2 * i, taken, own);
    const double under = sums[2] - own[2] + FLOOR * mean;
    const double re = under > 0.0 ? (sums[0] - own[0]) / under : 0.0;
    const double im = under > 0.0 ? (sums[1] - own[1]) / under : 0.0;
    p[0] = re * x[0] - im * x[1];
    p[1] = re * x[1] + im * x[0];
}

void hada_pair_level_residual(hada_pair_level *level, int pair, int channel, float *left)
{
    const size_t first = first_of(level, pair, channel);
    const float *frame = level->frame + first, *scene = level->scene + first;
    add_up(level, level->depth[pair], channel, NULL);
    const double mean = mean_power(level, frame, scene, 1.0);
    for (size_t i = 0; i < level->plane; i++) {
        double p[2];
        predict(level, frame, scene, 1.0, mean, i, p);
        left[2 * i] = (float)((double)frame[2 * i] - p[0]);
        left[2 * i + 1] = (float)((double)frame[2 * i + 1] - p[1]);
    }
}

void hada_pair_level_shares(hada_pair_level *level, int pair, int channel, float *shares)
{
    const float *scene = level->scene + first_of(level, pair, channel);
    add_up(level, level->depth[pair], channel, NULL);
    const double mean = mean_power(level, level->frame + first_of(level, pair, channel), scene, 1.0);
    for (int k = 0; k < level->count; k++) {
        const float *from = level->scene + first_of(level, k, channel);
        for (size_t i = 0; i < level->plane; i++, shares += 2) {
            const double own = (double)scene[2 * i] * scene[2 * i] + (double)scene[2 * i + 1] * scene[2 * i + 1];
            const double under = level->sums[3 * i + 2] - own + FLOOR * mean;
            const double times = level->depth[k] == level->depth[pair] && under > 0.0 ? -1.0 / under : 0.0;
            const double re = (double)scene[2 * i] * from[2 * i] + (double)scene[2 * i + 1] * from[2 * i + 1];
            const double im = (double)scene[2 * i + 1] * from[2 * i] - (double)scene[2 * i] * from[2 * i + 1];
            shares[0] = k == pair ? 1.0f : (float)(re * times);
            shares[1] = k == pair ? 0.0f : (float)(im * times);
        }
    }
}

double hada_pair_level_product(const hada_pair_level *level, const float *a, const float *b)
{
    const size_t size = (size_t)level->fft.size;
    double sum = 0.0;
    for (size_t first = 0; first < level->plane; first += size) {
        const double weight = weight_of(level, first); /* the same for all of a kx */
        for (size_t i = first; i < first + size; i++)
            sum += weight * ((double)a[2 * i] * b[2 * i] + (double)a[2 * i + 1] * b[2 * i + 1]);
    }
    return sum;
}

/* Adds a channel, whose sums are ready. */
static void judge_channel(const hada_pair_level *level, int pair, int channel, double gain, int itself,
                          hada_judgement *to)
{
    const float *frame = level->frame + first_of(level, pair, channel);
    const float *scene = level->scene + first_of(level, pair, channel);
    const double taken = itself ? 0.0 : gain, mean = mean_power(level, frame, scene, taken);
    for (size_t i = 0; i < level->plane; i++) {
        const double weight = level->sharp && is_low(level, i) ? 0.0 : weight_of(level, i),
                     b[2] = {(double)frame[2 * i], (double)frame[2 * i + 1]};
        double p[2];
        predict(level, frame, scene, taken, mean, i, p);
        const double off[2] = {b[0] - gain * p[0], b[1] - gain * p[1]};
        to->energy += weight * (b[0] * b[0] + b[1] * b[1]);
        to->left += weight * (off[0] * off[0] + off[1] * off[1]);
        to->cross += weight * (p[0] * b[0] + p[1] * b[1]);
        to->power += weight * (p[0] * p[0] + p[1] * p[1]);
    }
}

/* Whether a pair is the first of its depth. */
static int is_first(const hada_pair_level *level, int pair)
{
    for (int k = 0; k < pair; k++)
        if (level->depth[k] == level->depth[pair])
            return 0;
    return 1;
}

void hada_pair_level_judge(hada_pair_level *level, const double *gain, int itself, double *unexplained, double *better)
{
    for (int k = 0; k < level->count; k++)
        level->judged[k] = (hada_judgement){0};
    for (int k = 0; k < level->count; k++) {
        if (!is_first(level, k))
            continue;
        for (int c = 0; c < level->channels; c++) {
            add_up(level, level->depth[k], c, gain);
            for (int i = k; i < level->count; i++)
                if (level->depth[i] == level->depth[k])
                    judge_channel(level, i, c, gain[i], itself, &level->judged[i]);
        }
    }
    for (int k = 0; k < level->count; k++) {
        const hada_judgement *one = &level->judged[k];
        unexplained[k] = one->energy > 0.0 ? one->left / one->energy : 0.0;
        if (better)
            better[k] = one->power > 0.0 ? one->cross / one->power : 1.0;
    }
}

static double within(double gain)
{
    return isfinite(gain) && gain > 1.0 / MOST_GAIN ? fmin(gain, MOST_GAIN) : 1.0 / MOST_GAIN;
}

/* Divides by the geometric mean of each depth; 0 stays. */
static void normalise(const hada_pair_level *level, double *gain)
{
    for (int k = 0; k < level->count; k++) {
        double sum = 0.0;
        int members = 0;
        if (!is_first(level, k))
            continue;
        for (int i = k; i < level->count; i++)
            if (level->depth[i] == level->depth[k] && gain[i] > 0.0) {
                sum += log(gain[i]);
                members++;
            }
        const double mean = members ? exp(sum / members) : 1.0;
        for (int i = k; i < level->count; i++)
            if (level->depth[i] == level->depth[k])
                gain[i] /= mean;
    }
}

void hada_pair_level_even(hada_pair_level *level, int rounds, double *gain, double *unexplained, double *room)
{
    for (int round = 0; round < rounds; round++) {
        hada_pair_level_judge(level, gain, 0, unexplained, room);
        for (int k = 0; k < level->count; k++)
            gain[k] = gain[k] > 0.0 ? within(room[k]) : 0.0;
        normalise(level, gain);
    }
}

void hada_pair_level_expose(hada_pair_level *level, double *gain, double *unexplained, double *room)
{
    for (int k = 0; k < level->count; k++)
        gain[k] =
            within(level->scene_light[k] > 0.0 && !level->sharp ? level->frame_light[k] / level->scene_light[k] : 1.0);
    normalise(level, gain);
    hada_pair_level_even(level, HADA_PAIR_LEVEL_ROUNDS, gain, unexplained, room);
    hada_pair_level_judge(level, gain, 0, unexplained, NULL);
}

void hada_pair_level_brighten(hada_pair_level *level, const double *gain)
{
    for (int k = 0; k < level->count; k++)
        for (size_t i = first_of(level, k, 0); i < first_of(level, k + 1, 0); i++)
            level->scene[i] *= (float)gain[k];
}
