/* Filters and transfer functions on the device, and the layout of their spectra there. Internal. */
#ifndef HADA_FILTER_BANK_H
#define HADA_FILTER_BANK_H

#include "fft/fft.h"
#include "model/model.h"

/* Between the row-major half spectra of the host and the column blocks of the device. Internal. */

/* One image of complex numbers (re, im interleaved), `layout->count` of them on the device side; padding becomes zero.
 */
void hada_layout_pack(const hada_spectrum_layout *layout, const float *rows, float *blocks);
void hada_layout_unpack(const hada_spectrum_layout *layout, const float *blocks, float *rows);

/* As hada_layout_unpack, for one real value per frequency. */
void hada_layout_unpack_real(const hada_spectrum_layout *layout, const float *blocks, float *rows);
void hada_layout_pack_real(const hada_spectrum_layout *layout, const float *rows, float *blocks);

/* weights[layout->count]: how often a value of the half spectrum stands in the whole one: 1 at kx = 0 and (even sizes)
 * kx = cols/2, else 2; 0 in the padding. */
void hada_layout_weights(const hada_spectrum_layout *layout, float *weights);

/* Filters and transfer functions on the device. Internal.
 *
 * A bank holds chosen depths of a model in the layout of the transforms, [depth][channel], in as few buffers as the
 * device's largest allocation allows: depths first ... first + per_buffer - 1 share one buffer. */

enum { HADA_BANK_FILTERS = 1, HADA_BANK_OTFS = 2 };

typedef struct hada_bank {
    hada_spectrum_layout layout;
    int depths, channels;
    int parts; /* HADA_BANK_FILTERS | HADA_BANK_OTFS */
    int half;  /* the filters are stored as half; transfer functions are always float */
    hada_fft_product product;
    int filter_depths, otf_depths; /* depths in one buffer */
    hada_buffer *filters, *otfs;   /* ceil(depths / ..._depths) of them, NULL where the part was not asked for */
} hada_bank;

/* `depths`: indices into the model, `count` of them; NULL: all. `half` stores filters as half (a half model always
 * does). Refuses values that are not finite (a damaged file): HADA_ERROR_MODEL. */
hada_status hada_bank_create(hada_bank **out, hada_slot *slot, const hada_model *model,
                             const hada_spectrum_layout *layout, const int *depths, int count, int parts, int half,
                             hada_error *err);
void hada_bank_destroy(hada_bank **bank); /* the slot's queue must be done with it */

/* Where a depth's filters or transfer functions (its channels one after the other) stand: the buffer and the number of
 * complex images before them. *left is the number of depths from this one on in the same buffer. */
cl_mem hada_bank_filter(const hada_bank *bank, int depth, size_t *first_image, int *left);
cl_mem hada_bank_otf(const hada_bank *bank, int depth, size_t *first_image, int *left);

/* Noise power over scene power within the window, per channel and frequency: what refinement takes as its prior,
 * [channel][layout->count] floats. The buffer stays empty where the model knows neither (made from PSFs, one pair). */
hada_status hada_bank_prior(hada_buffer *out, hada_slot *slot, const hada_model *model,
                            const hada_spectrum_layout *layout, hada_error *err);

#endif
