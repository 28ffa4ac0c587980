#include "fit/coarse.h"

#include <float.h>

#include "filter/bank.h"
#include "fit/cropped.h"

/* Sides of cells, in pixels. The smallest that leaves at most so many of them is taken, else the largest. */
enum { LEAST_CELL = 2, MOST_CELL = 8, MOST_CELLS = 160 * 160 };

/* q, iterations, and the part of the first residual's square, in the preconditioner's norm, that ends them. */
#define REGULARISATION 0.1
enum { ITERATIONS = 60 };
#define CONVERGED 1e-8

struct hada_fit_coarse {
    const hada_fit_grid *fine;
    int cell;
    hada_fit_grid grid;
    hada_fit_sums sums; /* empty: gathering needs its grid alone */
    hada_fit_pair pair;
    hada_fit_cropped *cropped;
    hada_fit_stored *stored;
    size_t count;
    hada_buffer dark; /* a frame of zeros */
    float *often, *spectra, *rows;
    double *power, *h, *residual, *direction, *product; /* [channel][count], the last four complex */
    double *weight, *first, *norm; /* of each channel: q m; the residual's square, at first and now */
};

/* The side of cells that divide both sides of a grid; 0: there is none. */
static int cell_of(const hada_model_info *info)
{
    int found = 0;
    for (int cell = LEAST_CELL; cell <= MOST_CELL; cell++) {
        if (info->grid_rows % cell || info->grid_cols % cell)
            continue;
        found = cell;
        if ((int64_t)(info->grid_rows / cell) * (info->grid_cols / cell) <= MOST_CELLS)
            break;
    }
    return found;
}

static void forget(hada_fit_coarse *coarse)
{
    for (size_t i = 0; i < coarse->count; i++)
        hada_fit_stored_free(&coarse->stored[i]);
    free(coarse->stored);
    coarse->stored = NULL;
    coarse->count = 0;
}

hada_status hada_fit_coarse_begin(hada_fit_coarse *coarse, int64_t pairs, hada_error *err)
{
    forget(coarse);
    return HADA_NEW(coarse->stored, (size_t)pairs, "pairs", err);
}

void hada_fit_coarse_destroy(hada_fit_coarse **pointer)
{
    hada_fit_coarse *coarse = hada_taken(pointer);
    if (!coarse)
        return;
    if (coarse->grid.slot)
        hada_slot_finish(coarse->grid.slot, NULL);
    forget(coarse);
    hada_fit_cropped_destroy(&coarse->cropped);
    hada_buffer_destroy(&coarse->dark);
    hada_fit_pair_destroy(&coarse->pair);
    hada_fit_grid_destroy(&coarse->grid);
    HADA_FREE(coarse->often, coarse->spectra, coarse->rows, coarse->power, coarse->h, coarse->residual,
              coarse->direction, coarse->product, coarse->weight, coarse->first, coarse->norm, coarse);
}

/* Cells stand for frame and window alike; what is beyond the sensor weighs nothing. */
static hada_status make_grid(hada_fit_coarse *coarse, hada_error *err)
{
    const hada_model_info *info = &coarse->fine->info;
    hada_fit_options options;
    hada_fit_options_init(&options);
    options.depths = 1;
    options.distances_mm = info->distances_mm;
    options.channels = info->channels;
    options.raw_rows = options.window_rows = info->grid_rows / coarse->cell;
    options.raw_cols = options.window_cols = info->grid_cols / coarse->cell;
    options.boundary = HADA_BOUNDARY_CIRCULAR;
    options.form = HADA_FORM_COMPLEX;
    options.dark = 0.0;
    return hada_fit_grid_create(&coarse->grid, coarse->fine->slot->context, &options, err);
}

static hada_status make_room(hada_fit_coarse *coarse, hada_error *err)
{
    const hada_fit_grid *grid = &coarse->grid;
    const size_t channels = (size_t)grid->info.channels, count = grid->layout.count, values = 2 * channels * count;
    HADA_TRY(HADA_NEW(coarse->often, count, "a fit", err));
    hada_layout_weights(&grid->layout, coarse->often);
    HADA_TRY(HADA_NEW(coarse->spectra, values, "coarse transfer functions", err));
    HADA_TRY(HADA_NEW(coarse->rows, 2 * hada_model_info_plane(&grid->info), "coarse transfer functions", err));
    HADA_TRY(HADA_NEW(coarse->power, channels * count, "coarse transfer functions", err));
    HADA_TRY(HADA_NEW(coarse->weight, channels, "a fit", err));
    HADA_TRY(HADA_NEW(coarse->first, channels, "a fit", err));
    HADA_TRY(HADA_NEW(coarse->norm, channels, "a fit", err));
    HADA_TRY(HADA_NEW(coarse->h, values, "coarse transfer functions", err));
    HADA_TRY(HADA_NEW(coarse->residual, values, "coarse transfer functions", err));
    HADA_TRY(HADA_NEW(coarse->direction, values, "coarse transfer functions", err));
    HADA_TRY(HADA_NEW(coarse->product, values, "coarse transfer functions", err));
    HADA_TRY(hada_buffer_create(&coarse->dark, grid->slot->context, hada_fit_raw_floats(grid) * sizeof(float), "cells",
                                err));
    return hada_buffer_clear(&coarse->dark, grid->slot, 0, coarse->dark.bytes, err);
}

hada_status hada_fit_coarse_create(hada_fit_coarse **out, const hada_fit_grid *fine, const hada_monitor *monitor,
                                   hada_error *err)
{
    hada_fit_coarse *coarse = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    if (!cell_of(&fine->info))
        return HADA_OK;
    HADA_TRY(HADA_NEW(coarse, 1, "coarse transfer functions", err));
    coarse->fine = fine;
    coarse->cell = cell_of(&fine->info);
    HADA_TRY_OR_DONE(make_grid(coarse, err));
    hada_slot_watch(coarse->grid.slot, monitor);
    coarse->sums.grid = &coarse->grid;
    HADA_TRY_OR_DONE(hada_fit_pair_create(&coarse->pair, &coarse->grid, err));
    HADA_TRY_OR_DONE(hada_fit_cropped_create(&coarse->cropped, &coarse->sums, &coarse->pair, NULL, err));
    HADA_TRY_OR_DONE(make_room(coarse, err));
done:
    if (status)
        hada_fit_coarse_destroy(&coarse);
    *out = coarse;
    return status;
}

/* Means of known values over cells, and the cells' weights. The image is `rows` x `cols` and stands on the fine grid at
 * (row0, col0). weights NULL: all are known. to_weights NULL: what is beyond the image is dark, and known. */
static void average(const hada_fit_coarse *coarse, const float *from, const float *weights, int rows, int cols,
                    int row0, int col0, float *to, float *to_weights)
{
    const int cell = coarse->cell, high = coarse->grid.info.grid_rows, wide = coarse->grid.info.grid_cols;
    for (int r = 0; r < high; r++)
        for (int c = 0; c < wide; c++) {
            const int top = r * cell - row0, left = c * cell - col0;
            const int inside = top >= 0 && left >= 0 && top + cell <= rows && left + cell <= cols;
            int known = 0;
            double sum = 0.0;
            for (int k = 0; k < cell * cell; k++) {
                const int row = top + k / cell, col = left + k % cell;
                if (row < 0 || row >= rows || col < 0 || col >= cols)
                    continue;
                const size_t i = (size_t)row * (size_t)cols + (size_t)col;
                if (weights && weights[i] != 1.0f)
                    continue;
                sum += (double)from[i];
                known++;
            }
            const size_t at = (size_t)r * (size_t)wide + (size_t)c;
            to[at] = (float)(sum / (to_weights ? hada_most(known, 1) : cell * cell));
            if (to_weights)
                to_weights[at] = inside && known ? 1.0f : 0.0f;
        }
}

static void reduce(hada_fit_coarse *coarse, const hada_fit_pair *from)
{
    const hada_model_info *info = &coarse->fine->info;
    const hada_geometry *at = &coarse->fine->geometry;
    const size_t raw = (size_t)info->raw_rows * (size_t)info->raw_cols,
                 window = (size_t)info->window_rows * (size_t)info->window_cols,
                 cells = (size_t)coarse->grid.info.grid_rows * (size_t)coarse->grid.info.grid_cols;
    coarse->pair.weighted = 1;
    for (size_t c = 0; c < (size_t)info->channels; c++) {
        average(coarse, from->raw_pixels + c * raw, from->weighted ? from->raw_weights + c * raw : NULL, info->raw_rows,
                info->raw_cols, at->raw_row, at->raw_col, coarse->pair.raw_pixels + c * cells,
                coarse->pair.raw_weights + c * cells);
        average(coarse, from->scene_pixels + c * window, NULL, info->window_rows, info->window_cols, at->window_row,
                at->window_col, coarse->pair.scene_pixels + c * cells, NULL);
    }
}

hada_status hada_fit_coarse_add(hada_fit_coarse *coarse, const hada_fit_pair *pair, hada_error *err)
{
    hada_fit_stored *last = &coarse->stored[coarse->count];
    reduce(coarse, pair);
    HADA_TRY(hada_fit_stored_create(last, &coarse->pair, err));
    coarse->count++;
    return hada_fit_pair_upload(&coarse->pair, &last->raw, &last->weights, &last->spectrum, err);
}

/* Sxx of the pairs that have a part, and its mean over frequencies times q. */
static hada_status add_power(hada_fit_coarse *coarse, const unsigned char *left_out, double *weight, hada_error *err)
{
    const size_t count = coarse->grid.layout.count, channels = (size_t)coarse->grid.info.channels;
    double all = 0.0;
    memset(coarse->power, 0, channels * count * sizeof *coarse->power);
    for (size_t k = 0; k < coarse->count; k++) {
        if (left_out[k])
            continue;
        HADA_TRY(hada_buffer_read(&coarse->stored[k].spectrum, coarse->grid.slot, 0, coarse->spectra,
                                  2 * channels * count * sizeof(float), err));
        for (size_t i = 0; i < channels * count; i++) {
            const double re = coarse->spectra[2 * i], im = coarse->spectra[2 * i + 1];
            coarse->power[i] += re * re + im * im;
        }
    }
    for (size_t i = 0; i < count; i++)
        all += (double)coarse->often[i];
    for (size_t c = 0; c < channels; c++) {
        double sum = 0.0;
        for (size_t i = 0; i < count; i++)
            sum += (double)coarse->often[i] * coarse->power[c * count + i];
        weight[c] = REGULARISATION * sum / all + DBL_MIN;
    }
    return HADA_OK;
}

/* sum conj(X) F(crop F^-1(H X)) of the directions, or (NULL) sum conj(X) F(b), of all channels. */
static hada_status apply(hada_fit_coarse *coarse, const unsigned char *left_out, const double *directions, double *out,
                         hada_error *err)
{
    const size_t values = 2 * coarse->grid.layout.count * (size_t)coarse->grid.info.channels;
    for (size_t i = 0; i < values; i++)
        coarse->spectra[i] = directions ? (float)directions[i] : 0.0f;
    HADA_TRY(hada_fit_cropped_gather(coarse->cropped, coarse->spectra, err));
    for (size_t k = 0; k < coarse->count; k++) {
        const hada_fit_stored *at = &coarse->stored[k];
        if (!left_out[k])
            HADA_TRY(hada_fit_cropped_pair(coarse->cropped, directions ? coarse->dark.mem : at->raw.mem,
                                           at->weights.mem, at->spectrum.mem, err));
    }
    HADA_TRY(hada_fit_cropped_gathered(coarse->cropped, coarse->spectra, err));
    for (size_t i = 0; i < values; i++)
        out[i] = directions ? (double)coarse->spectra[i] : -(double)coarse->spectra[i];
    return HADA_OK;
}

/* Sum over all frequencies of Re conj(a) b of a channel; inverse: by 1 / (Sxx + weight). */
static double product_of(const hada_fit_coarse *coarse, size_t c, const double *a, const double *b, int inverse,
                         double weight)
{
    const size_t count = coarse->grid.layout.count, first = c * count;
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        const size_t k = first + i;
        const double often = (double)coarse->often[i];
        if (often > 0.0)
            sum += often * (a[2 * k] * b[2 * k] + a[2 * k + 1] * b[2 * k + 1]) /
                   (inverse ? coarse->power[k] + weight : 1.0);
    }
    return sum;
}

/* An iteration of a channel, after the product of its direction. norm: of the residual, before and after. */
static void step(hada_fit_coarse *coarse, size_t c, double weight, double *norm)
{
    const size_t count = coarse->grid.layout.count, first = 2 * c * count;
    double *p = coarse->direction, *ap = coarse->product, *r = coarse->residual;
    for (size_t i = first; i < first + 2 * count; i++)
        ap[i] += weight * p[i];
    const double curvature = product_of(coarse, c, p, ap, 0, weight);
    if (!(curvature > 0.0) || !(*norm > 0.0))
        return;
    const double length = *norm / curvature;
    for (size_t i = first; i < first + 2 * count; i++) {
        coarse->h[i] += length * p[i];
        r[i] -= length * ap[i];
    }
    const double now = product_of(coarse, c, r, r, 1, weight), keep = now / *norm;
    for (size_t i = first; i < first + 2 * count; i++)
        p[i] = keep * p[i] + (coarse->often[i / 2 - c * count] > 0.0f ? r[i] / (coarse->power[i / 2] + weight) : 0.0);
    *norm = now;
}

/* A coarse transfer function as that of the fine grid. */
static void refine(const hada_fit_coarse *coarse, const float *from, float *to)
{
    const hada_model_info *small = &coarse->grid.info, *large = &coarse->fine->info;
    const int rows = (small->grid_rows + 1) / 2, cols = (small->grid_cols + 1) / 2; /* below the highest frequency */
    const size_t from_pitch = (size_t)small->grid_cols / 2 + 1, to_pitch = (size_t)large->grid_cols / 2 + 1;
    memset(to, 0, 2 * hada_model_info_plane(large) * sizeof *to);
    for (int k = 1 - rows; k < rows; k++) {
        const size_t source = (size_t)(k < 0 ? k + small->grid_rows : k),
                     target = (size_t)(k < 0 ? k + large->grid_rows : k);
        memcpy(to + 2 * target * to_pitch, from + 2 * source * from_pitch, 2 * (size_t)cols * sizeof *to);
    }
}

hada_status hada_fit_coarse_solve(hada_fit_coarse *coarse, const unsigned char *left_out, float *otf, hada_error *err)
{
    const size_t count = coarse->grid.layout.count, channels = (size_t)coarse->grid.info.channels;
    const size_t plane = hada_model_info_plane(&coarse->fine->info);
    double *weight = coarse->weight, *first = coarse->first, *norm = coarse->norm;
    int more = 1;
    HADA_TRY(add_power(coarse, left_out, weight, err));
    memset(coarse->h, 0, 2 * channels * count * sizeof *coarse->h);
    HADA_TRY(apply(coarse, left_out, NULL, coarse->residual, err));
    for (size_t i = 0; i < 2 * channels * count; i++)
        coarse->direction[i] = coarse->often[i / 2 % count] > 0.0f
                                   ? coarse->residual[i] / (coarse->power[i / 2] + weight[i / 2 / count])
                                   : 0.0;
    for (size_t c = 0; c < channels; c++)
        first[c] = norm[c] = product_of(coarse, c, coarse->residual, coarse->residual, 1, weight[c]);
    for (int k = 0; k < ITERATIONS && more; k++) {
        more = 0;
        HADA_TRY(apply(coarse, left_out, coarse->direction, coarse->product, err));
        for (size_t c = 0; c < channels; c++) {
            step(coarse, c, weight[c], &norm[c]);
            more |= norm[c] > CONVERGED * first[c];
        }
    }
    for (size_t c = 0; c < channels; c++) {
        for (size_t i = 0; i < 2 * count; i++)
            coarse->spectra[i] = (float)coarse->h[2 * c * count + i];
        hada_layout_unpack(&coarse->grid.layout, coarse->spectra, coarse->rows);
        refine(coarse, coarse->rows, otf + 2 * c * plane);
    }
    return HADA_OK;
}
