/* Stored samples to float. Internal. */
#ifndef HADA_IO_TIFF_SAMPLE_H
#define HADA_IO_TIFF_SAMPLE_H

#include <stddef.h>

#include "io/tiff_page.h"

/* Converts `count` samples of a row, from sample number `first` on, every `stride`-th. Indices of a palette are
 * converted unscaled. */
void hada_tiff_samples(const hada_tiff_page *page, const void *row, size_t first, size_t stride, size_t count,
                       float *out);

#endif
