#include "filter/tiles.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "launch/filter_tiles.h"

hada_tiles hada_tiles_of(const hada_spectrum_layout *layout)
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

int hada_tiles_inside(const hada_tiles *tiles, size_t tile, int band_rows, int band_cols)
{
    const size_t strip = tile / (size_t)tiles->groups;
    return tiles->row_last[strip] <= band_rows && last_column(tiles, tile) <= band_cols;
}

int hada_tiles_band(const hada_tiles *tiles, size_t tile)
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
    HADA_TRY_OR_DONE(hada_allocated(meter = hada_alloc(1, sizeof *meter, "the measure of spectra", err)));
    meter->tiles = hada_tiles_of(layout);
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
    if (!pointer || !*pointer)
        return;
    hada_meter *meter = *pointer;
    *pointer = NULL;
    hada_buffer_destroy(&meter->last);
    hada_buffer_destroy(&meter->energy);
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
