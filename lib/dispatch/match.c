/* Whether a camera belongs to a frame: what its point spread functions leave unexplained, beside what the same ones
 * leave when they are turned or magnified, which explain no more than those of another camera. At a reduced size, where
 * noise averages out and a few steps cost little, and of fine structure, for smooth light fits any camera.
 * perf/results/real-captures.md has the figures that the constants come from. */
#include <hadalens/match.h>
#include <math.h>

#include "core/callers.h"
#include "dispatch/plan.h"
#include "image/mosaic.h"
#include "image/statistics.h"
#include "model/model.h"

#define CIRCLE 6.283185307179586
/* The longer side of the reduced grid, of one depth and of several, which all take part; and the least side of a
 * reduced frame that says anything. */
enum { SIDE = 256, SIDE_OF_SEVERAL = 192, LEAST_SIDE = 48 };
/* Refinement of each way: residuals part in the first steps, and this weight does for all cameras and any noise. */
enum { STEPS = 12 };
#define TV 3e-4
/* Fine structure: of the mean over 2 AROUND + 1 pixels a side, this share stays. */
enum { AROUND = 8 };
#define KEPT 0.1
/* Ways that correlate more with the camera as it is are the same one: a symmetric mask. */
#define ALIKE 0.9
/* The right way leaves less than all others by this at least: real cameras by 1.2 to 5, while ways of unrelated cameras
 * differ by up to 1.12. */
#define CLEAR 1.2
/* Where so many times the noise is left, noise does not explain it. */
#define ABOVE_NOISE 1.5

typedef struct way {
    hada_turn turn;
    double magnification;
} way;
enum { TURNS = 3, SIZES = 6, NEAR = 2, NEARS = 2 }; /* NEAR: the first of those that are near 1 */
static const way as_it_is = {HADA_TURN_NONE, 1.0};
static const way turns[TURNS] = {{HADA_TURN_MIRROR, 1.0}, {HADA_TURN_FLIP, 1.0}, {HADA_TURN_180, 1.0}};
static const way sizes[SIZES] = {{HADA_TURN_NONE, 0.9},  {HADA_TURN_NONE, 0.93}, {HADA_TURN_NONE, 0.96},
                                 {HADA_TURN_NONE, 1.04}, {HADA_TURN_NONE, 1.07}, {HADA_TURN_NONE, 1.1}};

/* A camera and a frame with larger pixels. */
typedef struct reduced {
    hada_context *context;
    const hada_model *model;
    hada_psf_options psf;
    hada_plan_options options;
    int rows, cols, kept_rows, kept_cols; /* of the frame; frequencies to either side of 0 */
    double pitch_rows, pitch_cols;        /* pixels of the camera for one of these */
    double noise;                         /* of the frame, as a share of its root mean square */
    hada_image frame, border;             /* border: weights, 0 where surroundings are not known */
    hada_image *psfs, *plain;             /* of the way at hand, and of the camera as it is */
    float *spectrum, *part, *wave; /* room: kept frequencies of a depth; after the first sum; cosines and sines */
} reduced;

/* What a mean over `pitch` pixels, taken twice, leaves of a frequency. */
static double averaged(int frequency, double pitch, int grid)
{
    const double x = 0.5 * CIRCLE * frequency * pitch / grid;
    return frequency ? sin(x) * sin(x) / (x * x) : 1.0;
}

/* The kept part of a depth's transfer function, sum over channels: [2 kept_rows + 1][kept_cols + 1]. */
static void take_spectrum(const reduced *of, int depth)
{
    const hada_model_info *info = &of->model->info;
    const size_t plane = hada_model_plane(of->model), half = (size_t)info->grid_cols / 2 + 1;
    const float *otf = of->model->otf + 2 * plane * (size_t)info->channels * (size_t)depth;
    float *to = of->spectrum;
    for (int u = -of->kept_rows; u <= of->kept_rows; u++) {
        const double of_row = averaged(u, of->pitch_rows, info->grid_rows);
        const float *row = otf + 2 * half * (size_t)(u < 0 ? u + info->grid_rows : u);
        for (int v = 0; v <= of->kept_cols; v++, to += 2) {
            const double weight = of_row * averaged(v, of->pitch_cols, info->grid_cols) * (v ? 2.0 : 1.0);
            const float *at = row + 2 * v;
            double re = 0.0, im = 0.0;
            for (int c = 0; c < info->channels; c++, at += 2 * plane) {
                re += at[0];
                im += at[1];
            }
            to[0] = (float)(weight * re);
            to[1] = (float)(weight * im);
        }
    }
}

/* Cosines and sines of `count` frequencies from `first` on at a place of the grid. */
static void make_wave(float *wave, int first, int count, double place, int grid)
{
    for (int k = 0; k < count; k++) {
        const double angle = CIRCLE * (first + k) * place / grid;
        wave[2 * k] = (float)cos(angle);
        wave[2 * k + 1] = (float)sin(angle);
    }
}

/* A point spread function at the reduced pixels, turned and magnified: its Fourier series there. */
static void sum_series(const reduced *of, const way *w, float *psf)
{
    const hada_model_info *info = &of->model->info;
    const int rows = 2 * of->kept_rows + 1, cols = of->kept_cols + 1;
    const double right = (w->turn & HADA_TURN_MIRROR ? -1.0 : 1.0) * of->pitch_cols / w->magnification;
    const double down = (w->turn & HADA_TURN_FLIP ? -1.0 : 1.0) * of->pitch_rows / w->magnification;
    float *part = of->part;
    for (int x = 0; x < of->cols; x++) {
        const float *h = of->spectrum;
        make_wave(of->wave, 0, cols, right * (x - of->cols / 2), info->grid_cols);
        for (int u = 0; u < rows; u++, part += 2) {
            float re = 0.0f, im = 0.0f;
            for (int v = 0; v < 2 * cols; v += 2, h += 2) {
                re += h[0] * of->wave[v] - h[1] * of->wave[v + 1];
                im += h[0] * of->wave[v + 1] + h[1] * of->wave[v];
            }
            part[0] = re;
            part[1] = im;
        }
    }
    for (int y = 0; y < of->rows; y++) {
        make_wave(of->wave, -of->kept_rows, rows, down * (y - of->rows / 2), info->grid_rows);
        part = of->part;
        for (int x = 0; x < of->cols; x++, part += 2 * (size_t)rows) {
            float sum = 0.0f;
            for (int u = 0; u < 2 * rows; u += 2)
                sum += part[u] * of->wave[u] - part[u + 1] * of->wave[u + 1];
            *psf++ = fmaxf(sum, 0.0f);
        }
    }
}

/* Takes the mean of a box off: what stays of it at a frequency is KEPT of the box's own share there. */
static double box_at(int frequency, int grid)
{
    double sum = 1.0;
    for (int k = 1; k <= AROUND; k++)
        sum += 2.0 * cos(CIRCLE * frequency * k / grid);
    return sum / (2 * AROUND + 1);
}

static void sharpen_model(hada_model *model)
{
    const hada_model_info *info = &model->info;
    const int half = info->grid_cols / 2 + 1;
    float *to = model->otf;
    for (int z = 0; z < info->depths; z++)
        for (int u = 0; u < info->grid_rows; u++) {
            const double of_row = (1.0 - KEPT) * box_at(u, info->grid_rows);
            for (int v = 0; v < half; v++, to += 2) {
                const float share = (float)(1.0 - of_row * box_at(v, info->grid_cols));
                to[0] *= share;
                to[1] *= share;
            }
        }
}

static int around(int at, int count, hada_boundary boundary)
{
    if (boundary == HADA_BOUNDARY_CIRCULAR)
        return (at + count) % count;
    return hada_within(at, count);
}

/* A pass along rows (step 1) or columns. */
static void box_lines(const float *from, float *to, int lines, int next, int count, int step, hada_boundary boundary)
{
    for (int line = 0; line < lines; line++)
        for (int i = 0; i < count; i++) {
            double sum = 0.0;
            for (int k = i - AROUND; k <= i + AROUND; k++)
                sum += from[(size_t)line * (size_t)next + (size_t)around(k, count, boundary) * (size_t)step];
            to[(size_t)line * (size_t)next + (size_t)i * (size_t)step] = (float)(sum / (2 * AROUND + 1));
        }
}

static void sharpen_frame(reduced *of)
{
    const size_t count = hada_image_count(&of->frame);
    float *room = of->plain[0].data, *box = of->psfs[0].data; /* not in use yet */
    box_lines(of->frame.data, room, of->rows, of->cols, of->cols, 1, of->psf.boundary);
    box_lines(room, box, of->cols, 1, of->rows, of->cols, of->psf.boundary);
    for (size_t i = 0; i < count; i++)
        of->frame.data[i] -= (float)(1.0 - KEPT) * box[i];
    if (of->psf.boundary == HADA_BOUNDARY_CIRCULAR)
        return;
    for (int y = AROUND; y < of->rows - AROUND; y++)
        for (int x = AROUND; x < of->cols - AROUND; x++)
            of->border.data[(size_t)y * (size_t)of->cols + (size_t)x] = 1.0f;
    of->options.pixel_weights = &of->border;
}

/* The mean over channels of the pixels that a reduced pixel covers. `dark` may be empty. */
static float mean_under(const hada_image *frame, const hada_image *dark, double top, double left, double bottom,
                        double right)
{
    const size_t area = (size_t)frame->rows * (size_t)frame->cols;
    double sum = 0.0, weights = 0.0;
    for (int row = (int)top; row < frame->rows && row < bottom; row++)
        for (int col = (int)left; col < frame->cols && col < right; col++) {
            const double weight = (fmin(row + 1, bottom) - fmax(row, top)) * (fmin(col + 1, right) - fmax(col, left));
            size_t at = (size_t)row * (size_t)frame->cols + (size_t)col;
            for (int c = 0; c < frame->channels; c++, at += area)
                if (isfinite(frame->data[at])) {
                    sum += weight * ((double)frame->data[at] - (dark->data ? (double)dark->data[at] : 0.0));
                    weights += weight;
                }
        }
    return (float)(weights > 0.0 ? sum / weights : 0.0);
}

static void reduce_frame(reduced *of, const hada_image *frame, const hada_image *dark)
{
    float *to = of->frame.data;
    for (int y = 0; y < of->rows; y++)
        for (int x = 0; x < of->cols; x++)
            *to++ = mean_under(frame, dark, y * of->pitch_rows, x * of->pitch_cols, (y + 1) * of->pitch_rows,
                               (x + 1) * of->pitch_cols);
}

static void take_dark_off(reduced *of, const hada_plan_options *options)
{
    const size_t count = hada_image_count(&of->frame);
    double level = options->dark == HADA_DARK_MODEL   ? of->model->info.dark
                   : options->dark == HADA_DARK_LEVEL ? options->dark_level
                                                      : 0.0;
    if (options->dark == HADA_DARK_AUTO || (options->dark == HADA_DARK_MODEL && level == HADA_AUTO))
        level = hada_first_percentile(of->frame.data, count, of->psfs[0].data);
    for (size_t i = 0; i < count; i++)
        of->frame.data[i] -= (float)level;
}

static void reduced_destroy(reduced *of)
{
    for (int z = 0; z < of->model->info.depths; z++) {
        if (of->psfs)
            hada_image_destroy(&of->psfs[z]);
        if (of->plain)
            hada_image_destroy(&of->plain[z]);
    }
    hada_image_destroy(&of->frame);
    hada_image_destroy(&of->border);
    HADA_FREE(of->psfs, of->plain, of->spectrum, of->part, of->wave);
}

static void choose_sizes(reduced *of)
{
    const hada_model_info *info = &of->model->info;
    const double side = info->depths > 1 ? SIDE_OF_SEVERAL : SIDE;
    const double pitch = fmax(1.0, fmax(info->grid_rows, info->grid_cols) / side);
    of->rows = (int)fmax(1.0, floor(info->raw_rows / pitch + 0.5));
    of->cols = (int)fmax(1.0, floor(info->raw_cols / pitch + 0.5));
    of->pitch_rows = info->raw_rows / (double)of->rows;
    of->pitch_cols = info->raw_cols / (double)of->cols;
    of->kept_rows = (int)((info->grid_rows - 1) / (2.0 * of->pitch_rows));
    of->kept_cols = (int)((info->grid_cols - 1) / (2.0 * of->pitch_cols));
    hada_psf_options_init(&of->psf);
    of->psf.boundary = info->boundary;
    of->psf.window_rows = (int)fmin(of->rows, ceil(info->window_rows / of->pitch_rows));
    of->psf.window_cols = (int)fmin(of->cols, ceil(info->window_cols / of->pitch_cols));
    of->psf.psf_dark = 0.0;
    hada_plan_options_init(&of->options);
    of->options.refine = STEPS;
    of->options.refine_tv = TV;
    of->options.refine_ridge = 0.0;
    of->options.occupied = HADA_OCCUPIED_ALL;
    of->options.scene = HADA_SCENE_PLANES;
    of->options.skip = 0;
}

static hada_status allocate(reduced *of, hada_error *err)
{
    const size_t rows = 2 * (size_t)of->kept_rows + 1, cols = (size_t)of->kept_cols + 1;
    const int depths = of->model->info.depths;
    HADA_TRY(hada_image_create(&of->frame, 1, of->rows, of->cols, err));
    HADA_TRY(hada_image_create(&of->border, 1, of->rows, of->cols, err));
    HADA_TRY(HADA_NEW(of->psfs, (size_t)depths, "point spread functions", err));
    HADA_TRY(HADA_NEW(of->plain, (size_t)depths, "point spread functions", err));
    for (int z = 0; z < depths; z++) {
        HADA_TRY(hada_image_create(&of->psfs[z], 1, of->rows, of->cols, err));
        HADA_TRY(hada_image_create(&of->plain[z], 1, of->rows, of->cols, err));
    }
    HADA_TRY(HADA_NEW(of->spectrum, 2 * rows * cols, "a transfer function", err));
    HADA_TRY(HADA_NEW(of->part, 2 * rows * (size_t)of->cols, "a point spread function", err));
    return HADA_NEW(of->wave, 2 * (rows + cols), "a point spread function", err);
}

/* Returns 0 where nothing but a constant is left of the frame. */
static int take_frame(reduced *of, const hada_image *frame, const hada_pixels *pixels, const hada_plan *plan)
{
    const size_t count = hada_image_count(&of->frame);
    double energy = 0.0;
    reduce_frame(of, frame, &plan->setup.dark_frame);
    take_dark_off(of, &plan->setup.options);
    sharpen_frame(of);
    for (size_t i = 0; i < count; i++)
        energy += (double)of->frame.data[i] * of->frame.data[i];
    of->noise =
        hada_noise_estimate(pixels, frame->channels > pixels->channels ? plan->setup.config.mosaic : HADA_MOSAIC_NONE) /
        sqrt(fmax(of->pitch_rows * of->pitch_cols * frame->channels * energy / (double)count, 1e-300));
    return energy > 0.0 && isfinite(energy);
}

/* Correlation with the camera as it is, mean over depths. */
static double likeness(const reduced *of)
{
    const size_t count = hada_image_count(&of->frame);
    double sum = 0.0;
    for (int z = 0; z < of->model->info.depths; z++) {
        double a = 0.0, b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
        for (size_t i = 0; i < count; i++) {
            const double p = of->plain[z].data[i], q = of->psfs[z].data[i];
            a += p;
            b += q;
            aa += p * p;
            bb += q * q;
            ab += p * q;
        }
        const double n = (double)count, spread = (aa - a * a / n) * (bb - b * b / n);
        sum += spread > 0.0 ? (ab - a * b / n) / sqrt(spread) : 1.0;
    }
    return sum / of->model->info.depths;
}

static void make_psfs(const reduced *of, const way *w, hada_image *psfs)
{
    for (int z = 0; z < of->model->info.depths; z++) {
        take_spectrum(of, z);
        sum_series(of, w, psfs[z].data);
    }
}

/* |what these point spread functions leave| / |frame|. */
static hada_status explain(const reduced *of, const hada_image *psfs, double *left, hada_error *err)
{
    hada_model *model = NULL;
    hada_plan *plan = NULL;
    hada_result result = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_model_from_psf(&model, of->context, psfs, of->model->info.depths,
                                         of->model->info.distances_mm, &of->psf, err));
    sharpen_model(model);
    HADA_TRY_OR_DONE(hada_plan_create(&plan, of->context, model, &of->options, err));
    HADA_TRY_OR_DONE(hada_plan_run(plan, &of->frame, &result, err));
    *left = result.report->residual;
done:
    hada_result_destroy(&result);
    hada_plan_destroy(&plan);
    hada_model_destroy(&model);
    return status;
}

/* The two of some ways that leave least; `best` NULL: all are the camera as it is. */
typedef struct leaders {
    const way *best;
    double left, second;
} leaders;

static hada_status try_ways(const reduced *of, const way *ways, int count, leaders *of_these, hada_error *err)
{
    *of_these = (leaders){.left = INFINITY, .second = INFINITY};
    for (int i = 0; i < count; i++) {
        double left;
        make_psfs(of, &ways[i], of->psfs);
        if (likeness(of) > ALIKE)
            continue;
        HADA_TRY(explain(of, of->psfs, &left, err));
        of_these->second = fmin(of_these->second, fmax(left, of_these->left));
        if (left < of_these->left) {
            of_these->left = left;
            of_these->best = &ways[i];
        }
    }
    return HADA_OK;
}

/* Whether the first leaves clearly less. */
static int is_clear(double left, double other)
{
    return CLEAR * left < other;
}

/* best: the way that is right, where that is not the camera as it is; else NULL. */
static void judge(hada_match *match, hada_match_verdict verdict, double left, const way *best)
{
    match->verdict = verdict;
    match->factor = match->unexplained / left;
    if (best) {
        match->turn = best->turn;
        match->magnification = best->magnification;
    }
}

/* Cameras of one depth, magnified: those of several depths are so by themselves. Where turns say that the camera
 * belongs, only a size near it can be better. */
static hada_status try_sizes(const reduced *of, int near, double mine, leaders *magnified, hada_error *err)
{
    *magnified = (leaders){.left = INFINITY, .second = INFINITY};
    if (of->model->info.depths > 1 || mine < ABOVE_NOISE * of->noise)
        return HADA_OK;
    if (near) {
        HADA_TRY(try_ways(of, sizes + NEAR, NEARS, magnified, err));
        if (!is_clear(magnified->left, mine))
            return HADA_OK;
    }
    return try_ways(of, sizes, SIZES, magnified, err);
}

static hada_status compare(const reduced *of, hada_match *match, hada_error *err)
{
    leaders turned, magnified;
    double mine;
    make_psfs(of, &as_it_is, of->plain);
    HADA_TRY(explain(of, of->plain, &mine, err));
    match->unexplained = mine;
    HADA_TRY(try_ways(of, turns, TURNS, &turned, err));
    if (is_clear(turned.left, fmin(mine, turned.second))) {
        judge(match, HADA_MATCH_TURNED, turned.left, turned.best);
        return HADA_OK;
    }
    const int belongs = turned.best && is_clear(mine, turned.left);
    HADA_TRY(try_sizes(of, belongs, mine, &magnified, err));
    const double least = fmin(turned.left, magnified.left);
    if (is_clear(magnified.left, fmin(mine, turned.left)))
        judge(match, HADA_MATCH_MAGNIFIED, magnified.left, magnified.best);
    else if (belongs || (magnified.best && is_clear(mine, least)))
        judge(match, HADA_MATCH_BELONGS, least, NULL);
    else if (mine < ABOVE_NOISE * of->noise || least > mine)
        judge(match, HADA_MATCH_UNKNOWN, least, NULL);
    else
        judge(match, HADA_MATCH_UNRELATED, least, NULL);
    return HADA_OK;
}

hada_status hada_plan_match(const hada_plan *plan, const hada_pixels *raw, hada_match *match, hada_error *err)
{
    HADA_NEED(plan && raw && match, err);
    HADA_TRY(HADA_REPORT_CHECK(match, hada_match, err));
    reduced of = {.context = plan->constants[0]->context, .model = plan->setup.model};
    hada_match own = {.size = sizeof own, .magnification = 1.0};
    hada_pixels pixels;
    hada_image binned = {0}, frame = {0}, colours = {0};
    hada_status status = HADA_OK;
    own.unexplained = NAN;
    HADA_TRY_OR_DONE(hada_pixels_take(&pixels, raw, err));
    const hada_frame_kind *kind = &plan->setup.config.kind;
    HADA_TRY_OR_DONE(hada_frame_check_size(&of.model->info, kind, pixels.channels, pixels.rows, pixels.cols, err));
    HADA_TRY_OR_DONE(hada_frame_bin(&pixels, &binned, &of.model->info, kind, err));
    choose_sizes(&of);
    if (of.model->otf && of.model->info.components < 2 && of.rows >= LEAST_SIDE && of.cols >= LEAST_SIDE) {
        HADA_TRY_OR_DONE(hada_pixels_copy(&pixels, &frame, err));
        if (pixels.channels < of.model->info.channels)
            HADA_TRY_OR_DONE(hada_mosaic_colours(plan->setup.config.mosaic, &frame, &colours, err));
        HADA_TRY_OR_DONE(allocate(&of, err));
        if (take_frame(&of, colours.data ? &colours : &frame, &pixels, plan))
            HADA_TRY_OR_DONE(compare(&of, &own, err));
    }
    HADA_REPORT_GIVE(match, &own);
done:
    hada_image_destroy(&frame);
    hada_image_destroy(&colours);
    hada_image_destroy(&binned);
    reduced_destroy(&of);
    return status;
}
