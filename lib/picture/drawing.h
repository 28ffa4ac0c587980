/* A sheet to draw on, for previews and plots alike: cairo's, with real type. Internal.
 *
 * Lengths are pixels, y runs down; colours are sRGB. Everything is recorded, and saved as PNG or SVG by the name's
 * ending. What goes wrong on the way (memory) is kept and reported by hada_drawing_save(). In a build without cairo
 * hada_drawing_create() fails with HADA_ERROR_UNSUPPORTED. */
#ifndef HADA_PICTURE_DRAWING_H
#define HADA_PICTURE_DRAWING_H

#include "core/base.h"

typedef struct hada_drawing hada_drawing;

/* 0xRRGGBB */
typedef uint32_t hada_colour;

/* Where a text, or anything else, lies from its x. */
typedef enum hada_anchor { HADA_ANCHOR_LEFT, HADA_ANCHOR_MIDDLE, HADA_ANCHOR_RIGHT } hada_anchor;

/* The step of a scale: 1, 2 or 5 times a power of ten, which divides `range` in at most `most` parts. */
static inline double hada_drawing_step(double range, int most)
{
    const double least = range / most, power = pow(10, floor(log10(least))), digit = least / power;
    return power * (digit <= 1 ? 1 : digit <= 2 ? 2 : digit <= 5 ? 5 : 10);
}

hada_status hada_drawing_create(hada_drawing **out, double width, double height, hada_colour paper, hada_error *err);
void hada_drawing_destroy(hada_drawing **drawing);

void hada_drawing_fill(hada_drawing *drawing, double x, double y, double width, double height, hada_colour colour);
/* A frame of `thick` pixels round (outside) a rectangle. */
void hada_drawing_frame(hada_drawing *drawing, double x, double y, double width, double height, double thick,
                        hada_colour colour);
/* points[2 k], points[2 k + 1]: x and y. Dashes of 5 pixels with gaps of 3. */
void hada_drawing_line(hada_drawing *drawing, const double *points, int count, hada_colour colour, double thick,
                       int dashed);
/* Closed, filled and outlined. */
void hada_drawing_polygon(hada_drawing *drawing, const double *points, int count, hada_colour fill, hada_colour edge,
                          double thick);
void hada_drawing_disc(hada_drawing *drawing, double x, double y, double radius, hada_colour fill, hada_colour edge,
                       double thick);
/* Pixels as they are, 0xRRGGBB each, in rows of `width`; copied. */
void hada_drawing_pixels(hada_drawing *drawing, int x, int y, int width, int height, const uint32_t *pixels);

/* UTF-8 on the baseline y, `size` pixels high; where it is wider than `limit` (0: none) it is cut, with an ellipsis.
 * Returns the width drawn. */
double hada_drawing_text(hada_drawing *drawing, double x, double y, hada_anchor anchor, double size, double limit,
                         hada_colour colour, const char *text);
/* Upwards, its middle at y. */
void hada_drawing_text_up(hada_drawing *drawing, double x, double y, double size, hada_colour colour, const char *text);
double hada_drawing_text_width(hada_drawing *drawing, double size, const char *text);

/* What is drawn between the two shows within the rectangle alone. */
void hada_drawing_clip(hada_drawing *drawing, double x, double y, double width, double height);
void hada_drawing_unclip(hada_drawing *drawing);

/* Writes NAME.png or NAME.svg, beside the file and renamed. The bytes depend on what was drawn, and on the fonts and
 * the version of cairo alone. */
hada_status hada_drawing_save(hada_drawing *drawing, const char *path, hada_error *err);

#endif
