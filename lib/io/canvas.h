/* A sheet of sRGB pixels to draw on, saved as PNG. Internal. */
#ifndef HADA_IO_CANVAS_H
#define HADA_IO_CANVAS_H

#include "core/error.h"

typedef struct hada_canvas {
    int width, height;
    unsigned char *rgb; /* rows of width * 3 bytes */
} hada_canvas;

typedef struct hada_colour {
    unsigned char r, g, b;
} hada_colour;

hada_status hada_canvas_create(hada_canvas *canvas, int width, int height, hada_colour paper, hada_error *err);
void hada_canvas_destroy(hada_canvas *canvas);
/* Everything drawn outside the sheet is left out. */
void hada_canvas_fill(hada_canvas *canvas, int x, int y, int width, int height, hada_colour colour);
/* A frame of `thick` pixels round (outside) a rectangle. */
void hada_canvas_frame(hada_canvas *canvas, int x, int y, int width, int height, int thick, hada_colour colour);
/* Text with its top left at (x, y), `scale` pixels a dot; cut with "..." where it is wider than `limit` pixels. Bytes
 * that are not ASCII show as one '?' a character. Returns the width drawn. */
int hada_canvas_text(hada_canvas *canvas, int x, int y, int scale, int limit, hada_colour colour, const char *text);
int hada_text_width(const char *text, int scale);
/* Writes the sheet as PNG, beside the file and renamed. The bytes depend on the pixels alone. */
hada_status hada_canvas_save(const hada_canvas *canvas, const char *path, hada_error *err);

#endif
