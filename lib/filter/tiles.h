/* The half spectrum in tiles, and bands made of them: what a frame holds where, to know before an inverse transform
 * what leaving frequencies out can change. Internal.
 *
 * A tile is a strip of rows (both signs of ky) by eight columns. Band i is the rectangle |ky| <= row_last[i],
 * kx <= col_last[i]; it is made of whole tiles, and the last one is everything. */
#ifndef HADA_FILTER_TILES_H
#define HADA_FILTER_TILES_H

#include "fft/fft.h"

enum { HADA_BANDS = 32, HADA_TILE_COLS = 8 };

typedef struct hada_tiles {
    hada_spectrum_layout layout;
    int groups;                                     /* of eight columns */
    int row_last[HADA_BANDS], col_last[HADA_BANDS]; /* strip i ends at row_last[i] */
} hada_tiles;

hada_tiles hada_tiles_of(const hada_spectrum_layout *layout);

/* Tiles of one spectrum: [strip][group]. */
static inline size_t hada_tiles_count(const hada_tiles *tiles)
{
    return (size_t)HADA_BANDS * (size_t)tiles->groups;
}

/* Whether the tile lies wholly within a band. */
int hada_tiles_inside(const hada_tiles *tiles, size_t tile, int band_rows, int band_cols);

/* The smallest band that holds the tile wholly. */
int hada_tiles_band(const hada_tiles *tiles, size_t tile);

/* Share of the spectrum's values outside a band, 0 to 1. */
double hada_tiles_share_outside(const hada_tiles *tiles, int band_rows, int band_cols);

/* Measures the energy of filtered spectra on the device. Belongs to a slot. */
typedef struct hada_meter {
    hada_tiles tiles;
    hada_slot *slot;
    int channels;
    hada_buffer last, energy;
} hada_meter;

hada_status hada_meter_create(hada_meter **out, hada_slot *slot, const hada_spectrum_layout *layout, int channels,
                              hada_error *err);
void hada_meter_destroy(hada_meter **meter);

/* Enqueues: meter->energy = [channel][tile], sum of gain |B|^2 over the whole spectrum's values in the tile. `gains`:
 * [channel][layout.count] floats, finite everywhere. */
hada_status hada_meter_run(hada_meter *meter, cl_mem spectrum, cl_mem gains, hada_error *err);

#endif
