/* One page of a TIFF file: what its samples are, and reading them as float planes. Internal. */
#ifndef HADA_IO_TIFF_PAGE_H
#define HADA_IO_TIFF_PAGE_H

#include <stdint.h>

#include "io/tiff_handle.h"

typedef struct hada_tiff_page {
    int rows, cols;
    int samples;  /* per pixel in the file */
    int channels; /* kept: alpha left out, a palette looked up */
    int bits, is_float, is_signed;
    int separate; /* samples stand in planes of their own */
    int inverted; /* 0 is white */
    int palette;  /* samples are indices; the colours come from the file */
    int compression;
    double scale; /* what a stored number is divided by */
} hada_tiff_page;

/* Reads and checks the tags of the current directory; what cannot be read is refused by name. Sizes that a file of
 * `file_bytes` cannot hold are refused before anything is allocated. `keep_indices`: a palette is only a way to show
 * grey values (as in ImageJ files), the indices are the image. */
hada_status hada_tiff_page_check(TIFF *tif, uint64_t file_bytes, int keep_indices, hada_tiff_page *page,
                                 hada_error *err);

/* Reads the pixels: `channels` planes of rows * cols. */
hada_status hada_tiff_page_read(TIFF *tif, const hada_tiff_handle *handle, const hada_tiff_page *page, float *out,
                                hada_error *err);

/* Bytes of an uncompressed page, and the fewest that it can have in a file. */
uint64_t hada_tiff_page_bytes(const hada_tiff_page *page);
uint64_t hada_tiff_page_least(const hada_tiff_page *page);
/* What a file claims, against the limits: `values` numbers in memory at once, and the bytes of a piece that is read. */
hada_status hada_tiff_budget(uint64_t values, uint64_t piece_bytes, uint64_t file_bytes, hada_error *err);
/* Converts an uncompressed page that was read from the file as it stands; `raw` is put into the machine's byte order
 * in place when `swapped`. Not for palettes. */
void hada_tiff_page_convert(const hada_tiff_page *page, void *raw, int swapped, float *out);

#endif
