#include "io/canvas.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "io/font.h"

hada_status hada_canvas_create(hada_canvas *canvas, int width, int height, hada_colour paper, hada_error *err)
{
    *canvas = (hada_canvas){0};
    void *data;
    hada_status status =
        hada_alloc_raw(&data, hada_size_product((size_t)width, (size_t)height), 3, "a preview picture", err);
    if (status)
        return status;
    *canvas = (hada_canvas){width, height, data};
    hada_canvas_fill(canvas, 0, 0, width, height, paper);
    return HADA_OK;
}

void hada_canvas_destroy(hada_canvas *canvas)
{
    free(canvas->rgb);
    *canvas = (hada_canvas){0};
}

void hada_canvas_fill(hada_canvas *canvas, int x, int y, int width, int height, hada_colour colour)
{
    int right = x + width < canvas->width ? x + width : canvas->width;
    int bottom = y + height < canvas->height ? y + height : canvas->height;
    for (int row = y > 0 ? y : 0; row < bottom; row++)
        for (int column = x > 0 ? x : 0; column < right; column++)
            memcpy(canvas->rgb + ((size_t)row * (size_t)canvas->width + (size_t)column) * 3, &colour, 3);
}

void hada_canvas_frame(hada_canvas *canvas, int x, int y, int width, int height, int thick, hada_colour colour)
{
    hada_canvas_fill(canvas, x - thick, y - thick, width + 2 * thick, thick, colour);
    hada_canvas_fill(canvas, x - thick, y + height, width + 2 * thick, thick, colour);
    hada_canvas_fill(canvas, x - thick, y, thick, height, colour);
    hada_canvas_fill(canvas, x + width, y, thick, height, colour);
}

static int is_continuation(char byte)
{
    return ((unsigned char)byte & 0xc0u) == 0x80u;
}

int hada_text_width(const char *text, int scale)
{
    int count = 0;
    for (; *text; text++)
        count += !is_continuation(*text);
    return count ? (count * HADA_FONT_ADVANCE - 1) * scale : 0;
}

static void draw_glyph(hada_canvas *canvas, int x, int y, int scale, hada_colour colour, unsigned character)
{
    const unsigned char *glyph = hada_font_glyph(character);
    for (int row = 0; row < HADA_FONT_HEIGHT; row++)
        for (int column = 0; column < HADA_FONT_WIDTH; column++)
            if (glyph[row] >> (HADA_FONT_WIDTH - 1 - column) & 1)
                hada_canvas_fill(canvas, x + column * scale, y + row * scale, scale, scale, colour);
}

int hada_canvas_text(hada_canvas *canvas, int x, int y, int scale, int limit, hada_colour colour, const char *text)
{
    int cut = hada_text_width(text, scale) > limit, dots = hada_text_width("...", scale), at = x;
    for (; *text; text++) {
        if (is_continuation(*text))
            continue;
        if (cut && at - x + HADA_FONT_ADVANCE * scale + dots > limit) {
            for (int i = 0; i < 3; i++, at += HADA_FONT_ADVANCE * scale)
                draw_glyph(canvas, at, y, scale, colour, '.');
            break;
        }
        draw_glyph(canvas, at, y, scale, colour, (unsigned char)*text);
        at += HADA_FONT_ADVANCE * scale;
    }
    return at - x;
}
