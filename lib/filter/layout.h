/* Between the row-major half spectra of the host and the column blocks of the device. Internal. */
#ifndef HADA_FILTER_LAYOUT_H
#define HADA_FILTER_LAYOUT_H

#include "fft/fft.h"

/* One image of complex numbers (re, im interleaved), `layout->count` of them on the device side; padding becomes zero.
 * The half versions take half on the row-major side, and on the device side with to_half. */
void hada_layout_pack(const hada_spectrum_layout *layout, const float *rows, float *blocks);
void hada_layout_unpack(const hada_spectrum_layout *layout, const float *blocks, float *rows);
void hada_layout_pack_half(const hada_spectrum_layout *layout, const uint16_t *rows, uint16_t *blocks);

/* As hada_layout_unpack, for one real value per frequency. */
void hada_layout_unpack_real(const hada_spectrum_layout *layout, const float *blocks, float *rows);
void hada_layout_pack_real(const hada_spectrum_layout *layout, const float *rows, float *blocks);

/* weights[layout->count]: how often a value of the half spectrum stands in the whole one: 1 at kx = 0 and (even sizes)
 * kx = cols/2, else 2; 0 in the padding. */
void hada_layout_weights(const hada_spectrum_layout *layout, float *weights);

#endif
