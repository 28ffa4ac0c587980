/* The metadata that this library writes into TIFF files: docs/files.md describes them. Internal. */
#ifndef HADA_IO_TIFF_TEXT_H
#define HADA_IO_TIFF_TEXT_H

#include <hadalens/tiff.h>
#include <stdint.h>

typedef struct hada_tiff_text {
    char *description;    /* ImageDescription of the first page */
    unsigned char *extra; /* ImageJ's metadata (tag 50839), or NULL */
    size_t extra_bytes;
    uint32_t *counts; /* its parts (tag 50838) */
    uint32_t count;
} hada_tiff_text;

/* Builds the texts; `options` are complete (counts at least 1). `range`: lowest and highest stored number for display,
 * NULL where that is not known; the size of the texts does not depend on the numbers. */
hada_status hada_tiff_text_build(hada_tiff_text *text, int channels, int rows, int cols,
                                 const hada_tiff_write_options *options, const double *range, hada_error *err);
void hada_tiff_text_free(hada_tiff_text *text);

#endif
