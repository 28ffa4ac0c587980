/* What the text of a TIFF file says: ImageJ hyperstacks, OME-XML, and the lines that this library writes. Internal. */
#ifndef HADA_IO_TIFF_META_H
#define HADA_IO_TIFF_META_H

#include <hadalens/tiff.h>

typedef struct hada_tiff_stack {
    int known;                               /* 1 where the text says how the pages are ordered */
    int imagej;                              /* the text is ImageJ's */
    int images;                              /* pages that the text speaks of */
    int channels, slices, times;             /* per-page channels; product == images */
    int channel_step, slice_step, time_step; /* page = sum of index * step, unless `pages` says otherwise */
    int *pages;                              /* page of [time][slice][channel], or NULL */
    double unit_um;                          /* the unit of ImageJ's resolution and spacing, 0 where unknown */
    double spacing_um, width_um, height_um;  /* 0 where unknown */
} hada_tiff_stack;

/* `pages`: of the file. A text that places other planes says nothing about the order of its pages. */
hada_status hada_tiff_stack_parse(hada_tiff_stack *stack, const char *text, size_t pages, hada_error *err);
void hada_tiff_stack_free(hada_tiff_stack *stack);

/* The value of a "key=value" line: its first character, NULL if there is none. */
const char *hada_text_line(const char *text, const char *key);
/* The response in such a line (hadalens/response.h); 0 if there is none. */
double hada_text_response(const char *text, const char *key);

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
