/* What the text of a TIFF file says: ImageJ hyperstacks, OME-XML, and the lines that this library writes. Internal. */
#ifndef HADA_IO_TIFF_META_H
#define HADA_IO_TIFF_META_H

#include <stddef.h>

#include "core/error.h"

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

/* The value of a "key=value" line: where it begins, NULL where there is none. */
const char *hada_text_line(const char *text, const char *key);
/* The response that such a line names (hadalens/response.h); 0 where there is none. */
double hada_text_response(const char *text, const char *key);

#endif
