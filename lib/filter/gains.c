#include "filter/gains.h"

#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "filter/half_filter.h"
#include "io/safetensors.h"

/* The device sums up at most some thousand squares as floats: each addition rounds by 2^-24 at most. */
static const double rounding = 1.001;

static hada_status make_arrays(hada_gains *gains, hada_error *err)
{
    const size_t count = hada_tiles_count(&gains->tiles) * (size_t)gains->channels;
    hada_status status = hada_alloc((void **)&gains->most, count, sizeof(double), "the filters' gains", err);
    if (!status)
        status = hada_alloc((void **)&gains->mean, count, sizeof(double), "the filters' gains", err);
    if (!status)
        status = hada_alloc((void **)&gains->half, count, sizeof(double), "the filters' gains", err);
    if (!status)
        status = hada_alloc((void **)&gains->sharp, (size_t)gains->channels, sizeof(double), "the filters' gains", err);
    return status;
}

/* A filter's values of eight columns, a row of a tile. */
typedef struct tile_values {
    float most, half;
    double sum;
    int count;
} tile_values;

/* |W|^2 as it acts on |B|^2: the split form multiplies real and imaginary parts apart. */
static float square(float re, float im, int split)
{
    return split ? fmaxf(re * re, im * im) : re * re + im * im;
}

static void take_value(tile_values *tile, float re, float im, int split)
{
    const float gain = square(re, im, split);
    tile->most = fmaxf(tile->most, gain);
    tile->sum += gain;
    tile->count++;
}

static void take_rounding(tile_values *tile, float re, float im, int split)
{
    const float half_re = hada_float_from_half(hada_half_from_float(re)),
                half_im = hada_float_from_half(hada_half_from_float(im));
    tile->half = fmaxf(tile->half, square(re - half_re, im - half_im, split));
}

/* One depth and channel: `values` where the model has floats, else `halves`. */
static void add_filter(hada_gains *gains, const float *values, const uint16_t *halves, int channel, int split,
                       int with_half, tile_values *room)
{
    const int rows = gains->tiles.layout.rows, cols = gains->tiles.layout.cols / 2 + 1;
    const size_t count = hada_tiles_count(&gains->tiles), base = (size_t)channel * count;
    float sharp = 0.0f;
    for (size_t t = 0; t < count; t++)
        room[t] = (tile_values){0};
    for (int ky = 0; ky < rows; ky++)
        for (int kx = 0; kx < cols; kx++) {
            const size_t at = 2 * ((size_t)ky * (size_t)cols + (size_t)kx);
            tile_values *tile = &room[hada_tiles_index(&gains->tiles, ky, kx)];
            if (values) {
                take_value(tile, values[at], values[at + 1], split);
                if (with_half)
                    take_rounding(tile, values[at], values[at + 1], split);
            } else {
                take_value(tile, hada_float_from_half(halves[at]), hada_float_from_half(halves[at + 1]), split);
            }
        }
    for (size_t t = 0; t < count; t++) {
        gains->most[base + t] += room[t].most;
        gains->half[base + t] += room[t].half;
        gains->mean[base + t] += room[t].count ? room[t].sum / room[t].count : 0.0;
        sharp = fmaxf(sharp, room[t].most);
    }
    gains->sharp[channel] += sharp;
}

int hada_gains_fits_half(const hada_model *model, const int *depths, int count)
{
    const size_t plane = 2 * hada_model_plane(model);
    uint16_t *room = NULL;
    if (model->filter_half)
        return 1;
    int fits = !hada_alloc_raw((void **)&room, plane, sizeof *room, "the filters' gains", NULL);
    for (int i = 0; fits && i < count * model->info.channels; i++) {
        const int depth = i / model->info.channels;
        const size_t image = (size_t)(depths ? depths[depth] : depth) * (size_t)model->info.channels +
                             (size_t)(i % model->info.channels);
        fits = !hada_filter_to_half(model->filter + image * plane, plane, room, NULL);
    }
    hada_model_forget(model);
    free(room);
    return fits;
}

hada_status hada_gains_create(hada_gains **out, const hada_model *model, const hada_spectrum_layout *layout,
                              const int *depths, int count, int with_half, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t plane = 2 * hada_model_plane(model);
    hada_gains *gains;
    tile_values *room = NULL;
    *out = NULL;
    hada_status status = hada_alloc((void **)&gains, 1, sizeof *gains, "the filters' gains", err);
    if (status)
        return status;
    gains->tiles = hada_tiles_of(layout);
    gains->channels = info->channels;
    status = make_arrays(gains, err);
    if (!status)
        status =
            hada_alloc_raw((void **)&room, hada_tiles_count(&gains->tiles), sizeof *room, "the filters' gains", err);
    for (int i = 0; !status && i < count; i++) {
        for (int c = 0; c < info->channels; c++) {
            const size_t at = ((size_t)depths[i] * (size_t)info->channels + (size_t)c) * plane;
            add_filter(gains, model->filter ? model->filter + at : NULL,
                       model->filter_half ? model->filter_half + at : NULL, c, info->form == HADA_FORM_SPLIT, with_half,
                       room);
        }
        hada_model_forget(model);
    }
    free(room);
    if (status)
        hada_gains_destroy(&gains);
    *out = gains;
    return status;
}

void hada_gains_destroy(hada_gains **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_gains *gains = *pointer;
    *pointer = NULL;
    free(gains->most);
    free(gains->mean);
    free(gains->half);
    free(gains->sharp);
    free(gains);
}

/* Parseval: a sum over the whole spectrum is rows * cols times the sum over pixels; the inverse transform's scale is in
 * it. */
static double pixels(const hada_gains *gains)
{
    return (double)gains->tiles.layout.rows * gains->tiles.layout.cols;
}

static double weigh(const hada_gains *gains, const double *weights, const float *energy)
{
    const size_t count = hada_tiles_count(&gains->tiles) * (size_t)gains->channels;
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += weights[i] * energy[i];
    return sum * rounding / pixels(gains);
}

void hada_gains_dropped(const hada_gains *gains, const float *energy, double dropped[HADA_BANDS])
{
    const size_t count = hada_tiles_count(&gains->tiles);
    double ring[HADA_BANDS] = {0.0}, sum = 0.0;
    for (size_t t = 0; t < count; t++) {
        double here = 0.0;
        for (int c = 0; c < gains->channels; c++)
            here += gains->most[(size_t)c * count + t] * energy[(size_t)c * count + t];
        ring[hada_tiles_band(&gains->tiles, t)] += here;
    }
    for (int i = HADA_BANDS - 1; i >= 0; i--) {
        dropped[i] = sum * rounding / pixels(gains);
        sum += ring[i];
    }
}

double hada_gains_outside(const hada_gains *gains, const float *energy, int band_rows, int band_cols)
{
    const size_t count = hada_tiles_count(&gains->tiles);
    double sum = 0.0;
    for (size_t t = 0; t < count; t++)
        for (int c = 0; c < gains->channels && !hada_tiles_inside(&gains->tiles, t, band_rows, band_cols); c++)
            sum += gains->most[(size_t)c * count + t] * energy[(size_t)c * count + t];
    return sum * rounding / pixels(gains);
}

double hada_gains_half(const hada_gains *gains, const float *energy)
{
    return weigh(gains, gains->half, energy);
}

double hada_gains_most(const hada_gains *gains, const float *energy)
{
    return weigh(gains, gains->most, energy);
}

double hada_gains_about(const hada_gains *gains, const float *energy)
{
    return weigh(gains, gains->mean, energy);
}
