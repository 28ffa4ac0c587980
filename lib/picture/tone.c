/* Linear intensities to pixels of a screen, and a stream of pictures for a display. */
#include <hadalens/response.h>
#include <hadalens/scene.h>

#include "image/pixels.h"
#include "io/encode.h"
#include "io/text.h"
#include "picture/tone.h"

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
    HADA_TRY(HADA_NEW_RAW(display->bytes, room, "a picture", err));
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

/* gamma 0: as displays take it. */
static uint32_t byte_of(double value, double white, double gamma)
{
    const double light = fmin(fmax(value / white, 0), 1);
    const double shown = gamma > 0 ? pow(light, gamma) : hada_response_from_light(HADA_RESPONSE_SRGB, light);
    return (uint32_t)(shown * 255 + 0.5);
}

uint32_t hada_colormap(double at)
{
    at = fmin(fmax(at, 0), 1);
    double lightness = 0.32 + 0.61 * at, hue = (360 - 260 * at) * 3.14159265358979323846 / 180;
    double a = 0.115 * cos(hue), b = 0.115 * sin(hue);
    /* Oklab to linear sRGB, with the constants of its definition. */
    double l = pow(lightness + 0.3963377774 * a + 0.2158037573 * b, 3);
    double m = pow(lightness - 0.1055613458 * a - 0.0638541728 * b, 3);
    double s = pow(lightness - 0.0894841775 * a - 1.2914855480 * b, 3);
    const double red = 4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s;
    const double green = -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s;
    const double blue = -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s;
    return byte_of(red, 1, 0) << 16 | byte_of(green, 1, 0) << 8 | byte_of(blue, 1, 0);
}

/* The upper half of a positive float's bits sorts like the number and holds it to 1 in 128: 8 bits of exponent, 7 of
 * mantissa. 0 for what is not above 0, -1 for what is not finite. */
static int level_of(float value)
{
    uint32_t bits;
    if (!isfinite(value))
        return -1;
    value = value > 0 ? value : 0;
    memcpy(&bits, &value, sizeof bits);
    return (int)(bits >> 16 & 0x7fffu);
}

/* Counts exponents, or the mantissas of one exponent. Returns how many values are finite; *top is the highest level. */
static size_t count_levels(const hada_image *images, int count, int exponent, size_t *bins, int *top)
{
    size_t total = 0;
    for (int k = 0; k < count; k++)
        for (size_t i = 0, n = hada_image_count(&images[k]); i < n; i++) {
            const int level = level_of(images[k].data[i]);
            if (level < 0)
                continue;
            total++;
            *top = level > *top ? level : *top;
            if (exponent < 0)
                bins[level >> 7]++;
            else if (level >> 7 == exponent)
                bins[level & 127]++;
        }
    return total;
}

double hada_tone_white(const hada_image *images, int count)
{
    size_t exponents[256] = {0}, mantissas[128] = {0}, above = 0;
    int top = 0, exponent = 255, mantissa = 127;
    const size_t total = count_levels(images, count, -1, exponents, &top);
    for (; exponent > 0 && (above + exponents[exponent]) * 1000 <= total; exponent--)
        above += exponents[exponent];
    count_levels(images, count, exponent, mantissas, &top);
    for (; mantissa > 0 && (above += mantissas[mantissa]) * 1000 <= total; mantissa--)
        ;
    const int level = exponent << 7 | mantissa;
    const uint32_t bits = ((uint32_t)(level ? level : top) + 1) << 16; /* 0: a few bright pixels on black */
    float white;
    memcpy(&white, &bits, sizeof white);
    return (level || top) && white > 0 && isfinite(white) ? (double)white : 1;
}

/* Planes of floats to pixels. */
static void show(uint32_t *pixels, size_t count, const float *planes, int channels, double white, double gamma)
{
    for (size_t i = 0; i < count; i++) {
        uint32_t rgb[3];
        if (channels == 3) {
            for (size_t c = 0; c < 3; c++)
                rgb[c] = byte_of((double)planes[c * count + i], white, gamma);
        } else {
            double mean = 0;
            for (int c = 0; c < channels; c++)
                mean += (double)planes[(size_t)c * count + i] / channels;
            rgb[0] = rgb[1] = rgb[2] = byte_of(mean, white, gamma);
        }
        pixels[i] = rgb[0] << 16 | rgb[1] << 8 | rgb[2];
    }
}

hada_status hada_tone_pixels(uint32_t **pixels, int width, int height, const hada_image *image, double white,
                             double gamma, hada_error *err)
{
    const size_t count = (size_t)width * (size_t)height;
    hada_image finite = {0}, scaled = {0};
    hada_status status = HADA_OK;
    *pixels = NULL;
    HADA_TRY_OR_DONE(hada_image_copy(&finite, image, err));
    for (size_t i = 0; i < hada_image_count(&finite); i++)
        finite.data[i] = isfinite(finite.data[i]) ? finite.data[i] : 0.0f;
    if (width != image->cols || height != image->rows)
        HADA_TRY_OR_DONE(hada_image_resize(&scaled, &finite, height, width, err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(*pixels, count, "a picture", err));
    show(*pixels, count, scaled.data ? scaled.data : finite.data, image->channels, white > 0 ? white : 1, gamma);
done:
    hada_image_destroy(&finite);
    hada_image_destroy(&scaled);
    return status;
}
