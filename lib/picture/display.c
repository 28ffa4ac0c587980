#include "picture/tone.h"

#include "io/encode.h"

/* The picture as bytes red, green, blue, and room behind them for the JPEG. */
static hada_status prepare(hada_display *display, const hada_image *image, hada_error *err)
{
    const size_t count = 3 * (size_t)image->rows * (size_t)image->cols;
    if (display->jpeg && !display->jpegs)
        HADA_TRY(hada_jpeg_begin(&display->jpegs, err));
    const size_t room = count + (display->jpeg ? hada_jpeg_room(image->rows, image->cols) : 0);
    if (display->room >= room)
        return HADA_OK;
    free(display->bytes);
    display->room = 0;
    HADA_TRY(hada_allocated(display->bytes = hada_alloc_raw(room, 1, "a picture", err)));
    display->room = room;
    return HADA_OK;
}

static double follow(double white, double now)
{
    return white > 0.0 ? white + (now - white) / 4.0 : now;
}

hada_status hada_display_draw(hada_display *display, const hada_image *image, double gamma, const unsigned char **bytes,
                              size_t *count, hada_error *err)
{
    const size_t pixels = (size_t)image->rows * (size_t)image->cols;
    uint32_t *shown = NULL;
    HADA_TRY(prepare(display, image, err));
    display->white = follow(display->white, hada_tone_white(image, 1));
    HADA_TRY(hada_tone_pixels(&shown, image->cols, image->rows, image, display->white, gamma, err));
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++)
            display->bytes[3 * i + c] = (unsigned char)(shown[i] >> (16 - 8 * c) & 255u);
    free(shown);
    *bytes = display->bytes;
    *count = 3 * pixels;
    if (!display->jpeg)
        return HADA_OK;
    *bytes += 3 * pixels;
    return hada_jpeg_encode(display->jpegs, display->bytes, image->rows, image->cols, display->bytes + 3 * pixels,
                            count, err);
}

void hada_display_end(hada_display *display)
{
    hada_jpeg_end(display->jpegs);
    free(display->bytes);
    *display = (hada_display){0};
}
