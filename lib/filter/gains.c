#include "filter/gains.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "filter/bank.h"
#include "launch/filter_tiles.h"

static hada_tiles tiles_of(const hada_spectrum_layout *layout)
{
    const int rows = layout->rows / 2, cols = layout->cols / 2;
    hada_tiles tiles = {.layout = *layout, .groups = cols / HADA_TILE_COLS + 1};
    for (int i = 0; i < HADA_BANDS; i++) {
        const int groups = ((i + 1) * tiles.groups + HADA_BANDS - 1) / HADA_BANDS;
        tiles.row_last[i] = (int)((long long)(i + 1) * rows / HADA_BANDS);
        tiles.col_last[i] = groups * HADA_TILE_COLS - 1 < cols ? groups * HADA_TILE_COLS - 1 : cols;
    }
    return tiles;
}

static int smallest(const int *last, int value)
{
    int i = 0;
    while (i < HADA_BANDS - 1 && last[i] < value)
        i++;
    return i;
}

static int last_column(const hada_tiles *tiles, size_t tile)
{
    const int last = (int)(tile % (size_t)tiles->groups) * HADA_TILE_COLS + HADA_TILE_COLS - 1;
    return last < tiles->layout.cols / 2 ? last : tiles->layout.cols / 2;
}

/* Whether the tile lies wholly within a band. */
static int tiles_inside(const hada_tiles *tiles, size_t tile, int band_rows, int band_cols)
{
    const size_t strip = tile / (size_t)tiles->groups;
    return tiles->row_last[strip] <= band_rows && last_column(tiles, tile) <= band_cols;
}

/* The smallest band that holds the tile wholly. */
static int tiles_band(const hada_tiles *tiles, size_t tile)
{
    const int strip = (int)(tile / (size_t)tiles->groups);
    const int by_column = smallest(tiles->col_last, last_column(tiles, tile));
    return strip > by_column ? strip : by_column;
}

double hada_tiles_share_outside(const hada_tiles *tiles, int band_rows, int band_cols)
{
    const int rows = tiles->layout.rows, cols = tiles->layout.cols / 2 + 1;
    const int high = 2 * band_rows + 1 < rows ? 2 * band_rows + 1 : rows,
              wide = band_cols + 1 < cols ? band_cols + 1 : cols;
    return 1.0 - (double)high * wide / ((double)rows * cols);
}

hada_status hada_meter_create(hada_meter **out, hada_slot *slot, const hada_spectrum_layout *layout, int channels,
                              hada_error *err)
{
    hada_meter *meter = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(meter, 1, "the measure of spectra", err));
    meter->tiles = tiles_of(layout);
    meter->slot = slot;
    meter->channels = channels;
    HADA_TRY_OR_DONE(hada_buffer_create_from(&meter->last, slot, meter->tiles.row_last, sizeof meter->tiles.row_last,
                                             "the measure of spectra", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&meter->energy, slot->context,
                                        (size_t)channels * hada_tiles_count(&meter->tiles) * sizeof(float),
                                        "the measure of spectra", err));
done:
    if (status)
        hada_meter_destroy(&meter);
    *out = meter;
    return status;
}

void hada_meter_destroy(hada_meter **pointer)
{
    hada_meter *meter = hada_taken(pointer);
    if (!meter)
        return;
    HADA_DESTROY_BUFFERS(&meter->last, &meter->energy);
    free(meter);
}

hada_status hada_meter_run(hada_meter *meter, cl_mem spectrum, cl_mem gains, hada_error *err)
{
    const hada_spectrum_layout *layout = &meter->tiles.layout;
    const size_t count = meter->energy.bytes / sizeof(float);
    const hada_range range = hada_range_of(count, 64, 1, 1);
    const double values = (double)layout->count * meter->channels;
    hada_slot_cost(meter->slot, 12.0 * values, 5.0 * values);
    return hada_launch_filter_tiles(meter->slot, HADA_PROGRAM_FILTER_TILES_DEFAULT, &range, err, .in = spectrum,
                                    .gains = gains, .shape = hada_spectrum_shape_of(layout), .strips = HADA_BANDS,
                                    .groups = meter->tiles.groups, .last = meter->last.ints, .out = meter->energy.mem,
                                    .count = (cl_uint)count);
}

/* The device sums up some thousand products of floats: each operation rounds by 2^-24 at most. */
static const double rounding = 1.001;

/* |W|^2 as it acts on |B|^2: the split form multiplies real and imaginary parts apart. */
static double square(double re, double im, int split)
{
    return split ? fmax(re * re, im * im) : re * re + im * im;
}

/* Adds a filter's |W|^2 to gain[], and what half takes from it to lost[] (NULL: not asked for). */
static void add_filter(const hada_model *model, size_t first, size_t count, double *gain, double *lost)
{
    const int split = model->info.form == HADA_FORM_SPLIT;
    for (size_t i = 0; i < count; i++) {
        const size_t at = first + 2 * i;
        if (!model->filter) {
            gain[i] += square(hada_float_from_half(model->filter_half[at]),
                              hada_float_from_half(model->filter_half[at + 1]), split);
            continue;
        }
        const float re = model->filter[at], im = model->filter[at + 1];
        gain[i] += square(re, im, split);
        if (lost)
            lost[i] += square(re - hada_float_from_half(hada_half_from_float(re)),
                              im - hada_float_from_half(hada_half_from_float(im)), split);
    }
}

/* One channel; `room` holds two values a frequency. */
static void add_channel(hada_gains *gains, const hada_model *model, int channel, const int *depths, int count,
                        int with_half, double *room)
{
    const size_t plane = hada_model_plane(model), channels = (size_t)gains->channels;
    double *gain = room, *lost = with_half ? room + plane : NULL;
    float *rows = gains->gain + (size_t)channel * plane;
    memset(room, 0, 2 * plane * sizeof *room);
    for (int i = 0; i < count; i++)
        add_filter(model, 2 * plane * ((size_t)depths[i] * channels + (size_t)channel), plane, gain, lost);
    for (size_t i = 0; i < plane; i++) {
        rows[i] = (float)gain[i];
        if (lost && lost[i] > gains->halved * gain[i])
            gains->halved = lost[i] / gain[i];
    }
}

int hada_gains_fits_half(const hada_model *model, const int *depths, int count)
{
    const size_t plane = 2 * hada_model_plane(model);
    uint16_t *room = NULL;
    if (model->filter_half)
        return 1;
    int fits = !HADA_NEW_RAW(room, plane, "the filters' gains", NULL);
    for (int i = 0; fits && i < count * model->info.channels; i++) {
        const int depth = i / model->info.channels;
        const size_t image = (size_t)(depths ? depths[depth] : depth) * (size_t)model->info.channels +
                             (size_t)(i % model->info.channels);
        fits = !hada_filter_to_half(model->filter + image * plane, plane, room, NULL);
    }
    free(room);
    return fits;
}

hada_status hada_gains_create(hada_gains **out, const hada_model *model, const hada_spectrum_layout *layout,
                              const int *depths, int count, int with_half, hada_error *err)
{
    const size_t channels = (size_t)model->info.channels;
    hada_gains *gains = NULL;
    double *room = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(gains, 1, "the filters' gains", err));
    gains->tiles = tiles_of(layout);
    gains->channels = model->info.channels;
    HADA_TRY_OR_DONE(HADA_NEW(gains->gain, channels * hada_model_plane(model), "the filters' gains", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(room, 2 * hada_model_plane(model), "the filters' gains", err));
    for (int c = 0; c < gains->channels; c++)
        add_channel(gains, model, c, depths, count, with_half, room);
done:
    free(room);
    if (status)
        hada_gains_destroy(&gains);
    *out = gains;
    return status;
}

hada_status hada_gains_upload(hada_buffer *out, hada_slot *slot, const hada_gains *gains,
                              const hada_spectrum_layout *layout, int channels, hada_error *err)
{
    const size_t plane = (size_t)layout->rows * (size_t)(layout->cols / 2 + 1), images = (size_t)channels;
    const size_t bytes = images * layout->count * sizeof(float);
    float *packed;
    HADA_TRY(HADA_NEW(packed, images * layout->count, "the filters' gains", err));
    for (size_t c = 0; c < images && !slot->context->dry; c++)
        hada_layout_pack_real(layout, gains->gain + c * plane, packed + c * layout->count);
    const hada_status status = hada_buffer_create_from(out, slot, packed, bytes, "the filters' gains", err);
    free(packed);
    return status;
}

void hada_gains_destroy(hada_gains **pointer)
{
    hada_gains *gains = hada_taken(pointer);
    if (gains)
        HADA_FREE(gains->gain, gains);
}

/* From a sum over the whole spectrum to one over pixels. */
static double to_pixels(const hada_gains *gains, double sum)
{
    return sum * rounding / ((double)gains->tiles.layout.rows * gains->tiles.layout.cols);
}

static double of_tile(const hada_gains *gains, const float *energy, size_t tile)
{
    const size_t count = hada_tiles_count(&gains->tiles);
    double sum = 0.0;
    for (int c = 0; c < gains->channels; c++)
        sum += energy[(size_t)c * count + tile];
    return sum;
}

double hada_gains_light(const hada_gains *gains, const float *energy)
{
    return hada_gains_outside(gains, energy, -1, -1);
}

void hada_gains_dropped(const hada_gains *gains, const float *energy, double dropped[HADA_BANDS])
{
    double ring[HADA_BANDS] = {0.0}, sum = 0.0;
    for (size_t t = 0; t < hada_tiles_count(&gains->tiles); t++)
        ring[tiles_band(&gains->tiles, t)] += of_tile(gains, energy, t);
    for (int i = HADA_BANDS - 1; i >= 0; i--) {
        dropped[i] = to_pixels(gains, sum);
        sum += ring[i];
    }
}

double hada_gains_outside(const hada_gains *gains, const float *energy, int band_rows, int band_cols)
{
    double sum = 0.0;
    for (size_t t = 0; t < hada_tiles_count(&gains->tiles); t++)
        if (!tiles_inside(&gains->tiles, t, band_rows, band_cols))
            sum += of_tile(gains, energy, t);
    return to_pixels(gains, sum);
}
