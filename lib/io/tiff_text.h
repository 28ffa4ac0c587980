/* The metadata that this library writes into TIFF files: docs/files.md describes them. Internal. */
#ifndef HADA_IO_TIFF_TEXT_H
#define HADA_IO_TIFF_TEXT_H

#include <hadalens/tiff.h>
#include <stdint.h>

typedef struct hada_tiff_text {
    char *description;    /* ImageDescription of the first page */
    size_t range_at;      /* where "min=" and "max=" stand in it: two numbers of HADA_RANGE_DIGITS; 0 = not there */
    unsigned char *extra; /* ImageJ's metadata (tag 50839), or NULL */
    size_t extra_bytes;
    uint32_t *counts; /* its parts (tag 50838) */
    uint32_t count;
    size_t display_at; /* where the display ranges (double pairs) stand in `extra` */
} hada_tiff_text;

/* The display range is known only after the last frame: its places hold numbers of a fixed width until then. */
#define HADA_RANGE_DIGITS 16
#define HADA_RANGE_GAP    5 /* "\nmax=" */

/* Builds the texts; `options` are complete (counts at least 1). */
hada_status hada_tiff_text_build(hada_tiff_text *text, int channels, int rows, int cols,
                                 const hada_tiff_write_options *options, hada_error *err);
void hada_tiff_text_free(hada_tiff_text *text);

#endif
