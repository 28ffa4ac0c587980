/* Previews: one sheet of everything that a frame gave. */
#include <hadalens/preview.h>
#include <hadalens/response.h>

#include "core/callers.h"
#include "io/text.h"
#include "picture/drawing.h"
#include "picture/tone.h"

/* Pixels. The sheet is as wide as a screen shows, panels and tiles as large as leaves the whole on one or two. */
enum {
    WIDTH = 1600,
    MARGIN = 24,
    GAP = 16,
    CAPTION = 30,     /* text above a panel */
    PANEL_MOST = 560, /* height of raw, all-in-focus and map */
    TILE_MOST = 420,  /* either side of a refocused image */
    BAR = 28,         /* width of the colour scale */
    BAR_TEXT = 110,
    MOST_ROWS_HEIGHT = 1100,
    TITLE = 26, /* sizes of text */
    TEXT = 17,
    HATCH = 12, /* from one diagonal to the next, */
    HATCHED = 2 /* and how wide they are */
};

static const hada_colour paper = 0x16181c, ink = 0xeceef2, dim = 0x80858e, line = 0x3a3e46, found = 0xffb828,
                         nothing = 0x2e3035, hatch = 0x404349;

/* What is shown, and where. */
typedef struct hada_sheet {
    const hada_preview *p;
    hada_drawing *drawing;
    double gamma;
    double near, far;            /* ends of the colour scale, mm */
    hada_image brightest, coded; /* of a volume: its projections */
    const hada_image *panels[3]; /* raw, all in focus, distances; NULL: not shown */
    int header, panels_y, panel_height, stack_y, columns, tile_width, tile_height, height;
} hada_sheet;

static double aspect(const hada_image *image)
{
    return (double)image->cols / image->rows;
}

static int width_of(const hada_image *image, int height)
{
    int width = (int)(aspect(image) * height + 0.5);
    return width < 1 ? 1 : width > WIDTH - 2 * MARGIN ? WIDTH - 2 * MARGIN : width;
}

/* The colours span the distances of the stack, or what the map holds where there is no stack. */
static void find_range(hada_sheet *sheet)
{
    const hada_preview *p = sheet->p;
    sheet->near = INFINITY;
    sheet->far = -INFINITY;
    for (int i = 0; p->distances_mm && i < p->depths; i++) {
        sheet->near = fmin(sheet->near, p->distances_mm[i]);
        sheet->far = fmax(sheet->far, p->distances_mm[i]);
    }
    const hada_image *map = p->distance_map;
    size_t count = map ? (size_t)map->rows * (size_t)map->cols : 0;
    const int spread = sheet->far > sheet->near; /* distances that say something are not overruled by the map */
    for (size_t i = 0; i < count && !spread; i++)
        if (isfinite(map->data[i])) {
            sheet->near = fmin(sheet->near, (double)map->data[i]);
            sheet->far = fmax(sheet->far, (double)map->data[i]);
        }
    if (!(sheet->near <= sheet->far)) {
        sheet->near = 0;
        sheet->far = 1;
    }
    if (sheet->far <= sheet->near) {
        sheet->near -= 0.5;
        sheet->far += 0.5;
    }
}

/* Of a share of the scale. Where brightness is light, colours are as bright as they can be. */
static hada_colour shade_of(const hada_sheet *sheet, double at)
{
    const hada_colour colour = hada_colormap(at), red = colour >> 16, green = colour >> 8 & 255, blue = colour & 255;
    const hada_colour most = red > green ? (red > blue ? red : blue) : green > blue ? green : blue;
    return sheet->p->volume ? red * 255 / most << 16 | green * 255 / most << 8 | blue * 255 / most : colour;
}

static hada_colour colour_of(const hada_sheet *sheet, double distance)
{
    return shade_of(sheet, (distance - sheet->near) / (sheet->far - sheet->near));
}

/* Light of a pixel over channels. */
static double light_of(const hada_image *plane, size_t i)
{
    const size_t pixels = (size_t)plane->rows * (size_t)plane->cols;
    double sum = 0;
    for (size_t c = 0; c < (size_t)plane->channels; c++)
        sum += (double)plane->data[c * pixels + i];
    return isfinite(sum) ? sum / plane->channels : 0;
}

/* The brightest voxel of each pixel, as it is and in the colour of its distance. */
static hada_status project(hada_sheet *sheet, hada_error *err)
{
    const hada_preview *p = sheet->p;
    const hada_image *first = &p->planes[0];
    const size_t pixels = (size_t)first->rows * (size_t)first->cols;
    HADA_TRY(hada_image_create(&sheet->brightest, first->channels, first->rows, first->cols, err));
    HADA_TRY(hada_image_create(&sheet->coded, 3, first->rows, first->cols, err));
    for (size_t i = 0; i < pixels; i++) {
        int best = 0;
        for (int z = 1; z < p->depths; z++)
            best = light_of(&p->planes[z], i) > light_of(&p->planes[best], i) ? z : best;
        const double light = light_of(&p->planes[best], i);
        const hada_colour colour = p->distances_mm ? colour_of(sheet, p->distances_mm[best])
                                                   : shade_of(sheet, (double)best / fmax(p->depths - 1, 1));
        for (size_t c = 0; c < (size_t)first->channels; c++)
            sheet->brightest.data[c * pixels + i] = p->planes[best].data[c * pixels + i];
        for (size_t c = 0; c < 3; c++)
            sheet->coded.data[c * pixels + i] =
                (float)(light * hada_response_to_light(HADA_RESPONSE_SRGB, (colour >> (16 - 8 * c) & 255) / 255.0));
    }
    sheet->panels[1] = &sheet->brightest;
    sheet->panels[2] = &sheet->coded;
    return HADA_OK;
}

static void place_stack(hada_sheet *sheet)
{
    const hada_preview *p = sheet->p;
    if (!p->planes || p->depths < 1)
        return;
    double shape = aspect(&p->planes[0]);
    int room = WIDTH - 2 * MARGIN;
    /* four side by side are large enough for a look: fewer would leave half the sheet empty */
    for (int columns = p->depths < 4 ? p->depths : 4; columns <= p->depths; columns++) {
        int width = (room - (columns - 1) * GAP) / columns;
        width = width < TILE_MOST ? width : TILE_MOST;
        width = shape < 1 && width > TILE_MOST * shape ? (int)(TILE_MOST * shape) : width;
        width = width < 1 ? 1 : width;
        int height = (int)(width / shape + 0.5);
        /* Images at their largest may leave room for more of them in a row; rows then share them out evenly. */
        int fit = (room + GAP) / (width + GAP), rows = (p->depths + fit - 1) / fit;
        sheet->columns = (p->depths + rows - 1) / rows;
        sheet->tile_width = width;
        sheet->tile_height = height < 1 ? 1 : height;
        if (rows * (height + CAPTION + GAP) <= MOST_ROWS_HEIGHT)
            break;
    }
}

static void place(hada_sheet *sheet)
{
    const hada_preview *p = sheet->p;
    double shapes = 0;
    int panels = 0, room = WIDTH - 2 * MARGIN;
    for (int i = 0; i < 3; i++)
        if (sheet->panels[i]) {
            shapes += aspect(sheet->panels[i]);
            panels++;
        }
    room -= (panels - 1) * GAP + (sheet->panels[2] ? BAR + BAR_TEXT + GAP : 0);
    sheet->header = p->title && *p->title ? 64 : MARGIN;
    sheet->panels_y = sheet->header + CAPTION;
    sheet->panel_height = panels ? (int)fmax(1, fmin(PANEL_MOST, room / shapes)) : 0;
    sheet->stack_y = panels ? sheet->panels_y + sheet->panel_height + 40 : sheet->header;
    place_stack(sheet);
    sheet->height = sheet->stack_y;
    if (sheet->columns) {
        int rows = (p->depths + sheet->columns - 1) / sheet->columns;
        sheet->height += CAPTION + 8 + rows * (sheet->tile_height + CAPTION + GAP);
    }
    sheet->height += MARGIN / 2;
}

static double text(const hada_sheet *sheet, double x, double y, double limit, hada_colour colour, const char *words)
{
    return hada_drawing_text(sheet->drawing, x, y, HADA_ANCHOR_LEFT, TEXT, limit, colour, words);
}

static hada_status draw_image(const hada_sheet *sheet, int x, int y, int width, int height, const hada_image *image,
                              double white, hada_error *err)
{
    uint32_t *pixels = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tone_pixels(&pixels, width, height, image, white, sheet->gamma, err));
    hada_drawing_pixels(sheet->drawing, x, y, width, height, pixels);
done:
    free(pixels);
    return status;
}

/* Nearest neighbour: distances are not mixed. Where nothing is in focus the paper shows diagonal lines. */
static hada_status draw_map(const hada_sheet *sheet, int x, int y, int width, int height, hada_error *err)
{
    const hada_image *map = sheet->p->distance_map;
    hada_status status = HADA_OK;
    uint32_t *pixels = NULL;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(pixels, (size_t)width * (size_t)height, "a picture", err));
    uint32_t *to = pixels;
    for (int row = 0; row < height; row++)
        for (int column = 0; column < width; column++) {
            const int from_row = (int)((row + 0.5) * map->rows / height),
                      from_column = (int)((column + 0.5) * map->cols / width);
            const double value = (double)map->data[(size_t)from_row * (size_t)map->cols + (size_t)from_column];
            *to++ = isfinite(value) ? colour_of(sheet, value) : (row + column) % HATCH < HATCHED ? hatch : nothing;
        }
    hada_drawing_pixels(sheet->drawing, x, y, width, height, pixels);
done:
    free(pixels);
    return status;
}

static void draw_tick(const hada_sheet *sheet, int x, int y, int height, double distance)
{
    char number[32], label[40];
    const double at = (distance - sheet->near) / (sheet->far - sheet->near) * (height - 2);
    const double baseline = fmin(fmax(at + 0.36 * TEXT, 0.72 * TEXT), height); /* 0.72: about a digit's height */
    hada_format_number(number, sizeof number, "%.4g", distance);
    snprintf(label, sizeof label, "%s mm", number);
    hada_drawing_fill(sheet->drawing, x, y + floor(at), 6, 2, dim);
    text(sheet, x + 12, y + baseline, BAR_TEXT - 12, ink, label);
}

/* Far more than steps make; above 2^53 a number and the next are one, and counting would not end. */
enum { MOST_TICKS = 64 };

static void draw_bar(const hada_sheet *sheet, int x, int y, int height)
{
    const double range = sheet->far - sheet->near, step = hada_drawing_step(range, height >= 300 ? 8 : 4);
    for (int row = 0; row < height; row++)
        hada_drawing_fill(sheet->drawing, x, y + row, BAR, 1,
                          shade_of(sheet, height > 1 ? (double)row / (height - 1) : 0));
    hada_drawing_frame(sheet->drawing, x, y, BAR, height, 1, line);
    draw_tick(sheet, x + BAR, y, height, sheet->near);
    draw_tick(sheet, x + BAR, y, height, sheet->far);
    /* Round numbers between the ends, where their text does not touch that of the ends. */
    const double clear = 1.2 * TEXT * range / height;
    const double first = ceil((sheet->near + clear) / step);
    for (int i = 0; i < MOST_TICKS && (first + i) * step <= sheet->far - clear; i++)
        draw_tick(sheet, x + BAR, y, height, (first + i) * step);
}

static void caption(const hada_sheet *sheet, int x, int y, int width, const char *words)
{
    text(sheet, x, y - 9, width, ink, words);
}

static hada_status draw_panels(const hada_sheet *sheet, hada_error *err)
{
    const int volume = sheet->coded.data != NULL;
    const char *const names[2] = {"raw", volume ? "maximum projection" : "all in focus"};
    const int y = sheet->panels_y, height = sheet->panel_height;
    int x = MARGIN;
    for (int i = 0; i < 2; i++) {
        const hada_image *shown = sheet->panels[i];
        if (!shown)
            continue;
        const int width = width_of(shown, height);
        char words[80];
        snprintf(words, sizeof words, "%s, %d × %d", names[i], shown->cols, shown->rows);
        caption(sheet, x, y, width, words);
        HADA_TRY(draw_image(sheet, x, y, width, height, shown, hada_tone_white(shown, 1), err));
        hada_drawing_frame(sheet->drawing, x, y, width, height, 1, line);
        x += width + GAP;
    }
    if (sheet->panels[2]) {
        const char *const long_words =
            volume ? "maximum projection, coloured by distance" : "distance (hatched: nothing in focus)";
        const int width = width_of(sheet->panels[2], height), room = width + GAP + BAR + BAR_TEXT;
        caption(sheet, x, y, room,
                hada_drawing_text_width(sheet->drawing, TEXT, long_words) <= room ? long_words : "distance");
        if (volume)
            HADA_TRY(draw_image(sheet, x, y, width, height, &sheet->coded, hada_tone_white(&sheet->brightest, 1), err));
        else
            HADA_TRY(draw_map(sheet, x, y, width, height, err));
        hada_drawing_frame(sheet->drawing, x, y, width, height, 1, line);
        draw_bar(sheet, x + width + GAP, y, height);
    }
    return HADA_OK;
}

/* Its distance, with the colour that the map has for it. */
static void label_tile(const hada_sheet *sheet, int index, int x, int y, hada_colour colour)
{
    const hada_preview *p = sheet->p;
    char number[32] = "", label[48];
    if (p->distances_mm)
        hada_format_number(number, sizeof number, "%.6g", p->distances_mm[index]);
    else
        snprintf(number, sizeof number, "depth %d", index + 1);
    snprintf(label, sizeof label, "%s%s", number, p->distances_mm ? " mm" : "");
    if (p->distances_mm && sheet->panels[2]) {
        hada_drawing_fill(sheet->drawing, x, y - 13, 14, 14, colour_of(sheet, p->distances_mm[index]));
        hada_drawing_frame(sheet->drawing, x, y - 13, 14, 14, 1, dim);
        x += 24;
    }
    text(sheet, x, y, sheet->tile_width, colour, label);
}

/* One refocused image, framed where the scene was found. */
static hada_status draw_tile(const hada_sheet *sheet, int index, double white, hada_error *err)
{
    const hada_preview *p = sheet->p;
    const int width = sheet->tile_width, height = sheet->tile_height;
    const int x = MARGIN + index % sheet->columns * (width + GAP);
    const int y = sheet->stack_y + CAPTION + 8 + index / sheet->columns * (height + CAPTION + GAP);
    const int marked = p->occupied && p->occupied[index];
    HADA_TRY(draw_image(sheet, x, y, width, height, &p->planes[index], white, err));
    hada_drawing_frame(sheet->drawing, x, y, width, height, marked ? 4 : 1, marked ? found : line);
    label_tile(sheet, index, x, y + height + 23, marked ? found : p->occupied ? dim : ink);
    return HADA_OK;
}

static hada_status draw_stack(const hada_sheet *sheet, hada_error *err)
{
    const hada_preview *p = sheet->p;
    const int y = sheet->stack_y + 19;
    char words[160];
    if (!sheet->columns)
        return HADA_OK;
    int marked = 0;
    for (int i = 0; p->occupied && i < p->depths; i++)
        marked += p->occupied[i] != 0;
    snprintf(words, sizeof words, "refocused, near to far, %d × %d", p->planes[0].cols, p->planes[0].rows);
    const double x = MARGIN + text(sheet, MARGIN, y, WIDTH - 2 * MARGIN, ink, words);
    if (p->occupied) {
        snprintf(words, sizeof words, "scene found at %d of %d distances", marked, p->depths);
        hada_drawing_frame(sheet->drawing, floor(x) + 32, y - 13, 13, 13, 4, found);
        text(sheet, x + 58, y, WIDTH - MARGIN - x - 58, found, words);
    }
    /* One white for all, so that brightness can be compared; most voxels of a volume are dark. */
    const double white =
        sheet->coded.data ? hada_tone_white(&sheet->brightest, 1) : hada_tone_white(p->planes, p->depths);
    for (int i = 0; i < p->depths; i++)
        HADA_TRY(draw_tile(sheet, i, white, err));
    return HADA_OK;
}

static int is_empty(const hada_image *image)
{
    return image && (!image->data || image->rows < 1 || image->cols < 1 || image->channels < 1);
}

static int shows_nothing(const hada_preview *p)
{
    int empty = is_empty(p->raw) || is_empty(p->all_in_focus) || is_empty(p->distance_map);
    for (int i = 0; p->planes && i < p->depths; i++)
        empty |= is_empty(&p->planes[i]);
    return empty || (!p->raw && !p->all_in_focus && !p->distance_map && !(p->planes && p->depths > 0));
}

hada_status hada_preview_save(const char *path, const hada_preview *callers, hada_error *err)
{
    HADA_NEED(path && callers, err);
    hada_status status = HADA_OK;
    hada_preview own, *preview = &own;
    hada_sheet sheet = {.p = preview};
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(preview, callers, hada_preview, err));
    if (!(preview->gamma > 0) && preview->gamma != HADA_AUTO)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: an exponent of %g shows nothing; it is above 0", path,
                         preview->gamma);
    if (shows_nothing(preview))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: there is no image to show", path);
    sheet.gamma = preview->gamma == HADA_AUTO ? 0 : preview->gamma;
    find_range(&sheet);
    sheet.panels[0] = preview->raw;
    sheet.panels[1] = preview->all_in_focus;
    sheet.panels[2] = preview->distance_map;
    if (preview->volume && preview->planes && preview->depths > 1)
        HADA_TRY_OR_DONE(project(&sheet, err));
    place(&sheet);
    HADA_TRY_OR_DONE(hada_drawing_create(&sheet.drawing, WIDTH, sheet.height, paper, err));
    if (preview->title)
        hada_drawing_text(sheet.drawing, MARGIN, 44, HADA_ANCHOR_LEFT, TITLE, WIDTH - 2 * MARGIN, ink, preview->title);
    HADA_TRY_OR_DONE(draw_panels(&sheet, err));
    HADA_TRY_OR_DONE(draw_stack(&sheet, err));
    HADA_TRY_OR_DONE(hada_drawing_save(sheet.drawing, path, err));
done:
    hada_drawing_destroy(&sheet.drawing);
    hada_image_destroy(&sheet.brightest);
    hada_image_destroy(&sheet.coded);
    return status;
}

hada_status hada_png_save(const char *path, const hada_image *image, double white, double gamma, hada_error *err)
{
    HADA_NEED(path, err);
    HADA_NEED_IMAGE(image, NULL, err);
    hada_status status = HADA_OK;
    hada_drawing *drawing = NULL;
    uint32_t *pixels = NULL;
    if ((image->channels != 1 && image->channels != 3) || (white != HADA_AUTO && !(white > 0.0 && isfinite(white))))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s: a picture has 1 or 3 channels, and white is above 0 or HADA_AUTO; here are %d, and %g",
                         path, image->channels, white);
    HADA_TRY_OR_DONE(hada_drawing_create(&drawing, image->cols, image->rows, paper, err));
    HADA_TRY_OR_DONE(hada_tone_pixels(&pixels, image->cols, image->rows, image,
                                      white == HADA_AUTO ? hada_tone_white(image, 1) : white, gamma, err));
    hada_drawing_pixels(drawing, 0, 0, image->cols, image->rows, pixels);
    HADA_TRY_OR_DONE(hada_drawing_save(drawing, path, err));
done:
    free(pixels);
    hada_drawing_destroy(&drawing);
    return status;
}
