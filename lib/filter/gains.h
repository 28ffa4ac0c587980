/* Leaving frequencies out: bands of the half spectrum, the energy of a frame in them, and what that can change.
 * Internal.
 */
#ifndef HADA_FILTER_GAINS_H
#define HADA_FILTER_GAINS_H

#include "fft/fft.h"
#include "model/model.h"

/* The half spectrum in tiles, and bands made of them: what a frame holds where, to know before an inverse transform
 * what leaving frequencies out can change. Internal.
 *
 * A tile is a strip of rows (both signs of ky) by eight columns. Band i is the rectangle |ky| <= row_last[i],
 * kx <= col_last[i]; it is made of whole tiles, and the last one is everything. */

enum { HADA_BANDS = 32, HADA_TILE_COLS = 8 };

typedef struct hada_tiles {
    hada_spectrum_layout layout;
    int groups;                                     /* of eight columns */
    int row_last[HADA_BANDS], col_last[HADA_BANDS]; /* strip i ends at row_last[i] */
} hada_tiles;

/* Tiles of one spectrum: [strip][group]. */
static inline size_t hada_tiles_count(const hada_tiles *tiles)
{
    return (size_t)HADA_BANDS * (size_t)tiles->groups;
}

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

/* What frequencies can do to the planes of a plan: bounds of what leaving some of them out changes, before any inverse
 * transform. Internal; docs/explanation/speed-and-accuracy.md derives them.
 *
 * By Parseval's theorem a frequency k of a frame's channel, B(k), puts |W(k) B(k)|^2 / (rows cols) into the sum of
 * squares of a plane, taken over the whole grid. Added up over the depths that is gain(k) |B(k)|^2 / (rows cols): one
 * number a frequency, however many depths there are. */

typedef struct hada_gains {
    hada_tiles tiles;
    int channels;
    float *gain;   /* [channel], row-major half spectra: sum over depths of |W|^2 */
    double halved; /* largest ratio of sum |W - half(W)|^2 to sum |W|^2 of all frequencies and channels */
} hada_gains;

/* Whether half filters can be made of `count` depths of a model (indices; NULL: all). */
int hada_gains_fits_half(const hada_model *model, const int *depths, int count);

/* Of `count` depths. with_half: `halved` is filled as well; the filters must fit. */
hada_status hada_gains_create(hada_gains **out, const hada_model *model, const hada_spectrum_layout *layout,
                              const int *depths, int count, int with_half, hada_error *err);
void hada_gains_destroy(hada_gains **gains);

/* The gains of so many channels for a hada_meter of this layout. On a dry context `gains` is not read. */
hada_status hada_gains_upload(hada_buffer *out, hada_slot *slot, const hada_gains *gains,
                              const hada_spectrum_layout *layout, int channels, hada_error *err);

/* The following are sums of squares over all planes on the whole grid; `energy` is what a hada_meter measured with
 * the gains. They are rounded up: no less than in exact arithmetic. */

/* What all frequencies put there. */
double hada_gains_light(const hada_gains *gains, const float *energy);

/* What the frequencies outside band i put there, as dropped[i]. */
void hada_gains_dropped(const hada_gains *gains, const float *energy, double dropped[HADA_BANDS]);

/* The same for any band; tiles that are partly outside count as a whole. */
double hada_gains_outside(const hada_gains *gains, const float *energy, int band_rows, int band_cols);

#endif
