/* What the passes of a transform need at least, for profiles: hada_slot_cost() of the launch that follows. Internal to
 * lib/fft.
 *
 * Operations: 5 n log2 n for a complex transform of n points, half of that for a real one (the usual count: M. Frigo,
 * S. G. Johnson, Proceedings of the IEEE 93(2), 216 (2005)), whatever the radices. Traffic: each value within the
 * rectangle and the band is read once and written once; a spectrum that several filters share is read once. */
#ifndef HADA_FFT_FFT_COST_H
#define HADA_FFT_FFT_COST_H

#include "fft/fft.h"

/* `images` images through the pass along rows, or along columns, or through both in one launch, where nothing is
 * written between them. `use`: of an inverse, as hada_fft_resolve() gives it; NULL: forward. */
void hada_fft_cost_rows(hada_slot *slot, const hada_fft_desc *desc, int images, const hada_fft_filter *use);
void hada_fft_cost_columns(hada_slot *slot, const hada_fft_desc *desc, int images, const hada_fft_filter *use);
void hada_fft_cost_image(hada_slot *slot, const hada_fft_desc *desc, int images, const hada_fft_filter *use);

#endif
