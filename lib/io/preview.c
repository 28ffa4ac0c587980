#include <hadalens/preview.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/options.h"
#include "io/canvas.h"
#include "io/colormap.h"
#include "io/font.h"
#include "io/text.h"
#include "io/tone.h"

enum {
    WIDTH = 1600,
    MARGIN = 24,
    GAP = 16,
    CAPTION = 30,     /* text above a panel */
    PANEL_MOST = 560, /* height of raw, all-in-focus and map */
    TILE_MOST = 420,  /* either side of a refocused image */
    BAR = 28,         /* width of the colour scale */
    BAR_TEXT = 120,
    MOST_ROWS_HEIGHT = 1100
};

static const hada_colour paper = {22, 24, 28}, ink = {236, 238, 242}, dim = {128, 133, 142}, line = {58, 62, 70},
                         found = {255, 184, 40}, nothing = {46, 48, 53}, hatch = {64, 67, 73};

/* What is shown, and where. */
typedef struct hada_sheet {
    const hada_preview *p;
    double gamma;
    double near, far; /* ends of the colour scale, mm */
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
    const hada_image *shown[3] = {p->raw, p->all_in_focus, p->distance_map};
    double shapes = 0;
    int panels = 0, room = WIDTH - 2 * MARGIN;
    for (int i = 0; i < 3; i++)
        if (shown[i]) {
            shapes += aspect(shown[i]);
            panels++;
        }
    room -= (panels - 1) * GAP + (p->distance_map ? BAR + BAR_TEXT + GAP : 0);
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

static void caption(hada_canvas *canvas, int x, int y, int width, const char *text)
{
    hada_canvas_text(canvas, x, y - CAPTION + 8, 2, width, ink, text);
}

/* Nearest neighbour: distances are not mixed. Where nothing is in focus the paper shows diagonal lines. */
static void draw_map(const hada_sheet *sheet, hada_canvas *canvas, int x, int y, int width, int height)
{
    const hada_image *map = sheet->p->distance_map;
    for (int row = 0; row < height; row++)
        for (int column = 0; column < width; column++) {
            int from_row = (int)((row + 0.5) * map->rows / height),
                from_column = (int)((column + 0.5) * map->cols / width);
            double value = (double)map->data[(size_t)from_row * (size_t)map->cols + (size_t)from_column];
            hada_colour colour = (row + column) % 12 < 2 ? hatch : nothing;
            if (isfinite(value)) {
                unsigned char rgb[3];
                hada_colormap((value - sheet->near) / (sheet->far - sheet->near), rgb);
                colour = (hada_colour){rgb[0], rgb[1], rgb[2]};
            }
            hada_canvas_fill(canvas, x + column, y + row, 1, 1, colour);
        }
}

/* A step of 1, 2 or 5 times a power of ten that divides the range in at most `most` parts. */
static double nice_step(double range, int most)
{
    double power = pow(10, floor(log10(range / most)));
    static const double steps[] = {1, 2, 5, 10};
    for (int i = 0; i < 4; i++)
        if (range / (steps[i] * power) <= most)
            return steps[i] * power;
    return 10 * power;
}

static void draw_tick(const hada_sheet *sheet, hada_canvas *canvas, int x, int y, int height, double distance)
{
    char number[32], label[40];
    int at = (int)((distance - sheet->near) / (sheet->far - sheet->near) * (height - 1) + 0.5);
    int text_y = at - HADA_FONT_HEIGHT, last = height - 2 * HADA_FONT_HEIGHT;
    text_y = text_y > last ? last : text_y;
    text_y = text_y < 0 ? 0 : text_y;
    hada_format_number(number, sizeof number, "%.4g", distance);
    snprintf(label, sizeof label, "%s mm", number);
    hada_canvas_fill(canvas, x, y + (at < height - 1 ? at : height - 2), 6, 2, dim);
    hada_canvas_text(canvas, x + 12, y + text_y, 2, BAR_TEXT, ink, label);
}

static void draw_bar(const hada_sheet *sheet, hada_canvas *canvas, int x, int y, int height)
{
    double range = sheet->far - sheet->near, step = nice_step(range, height >= 300 ? 8 : 4);
    for (int row = 0; row < height; row++) {
        unsigned char rgb[3];
        hada_colormap(height > 1 ? (double)row / (height - 1) : 0, rgb);
        hada_canvas_fill(canvas, x, y + row, BAR, 1, (hada_colour){rgb[0], rgb[1], rgb[2]});
    }
    hada_canvas_frame(canvas, x, y, BAR, height, 1, line);
    draw_tick(sheet, canvas, x + BAR, y, height, sheet->near);
    draw_tick(sheet, canvas, x + BAR, y, height, sheet->far);
    /* Round numbers between the ends, where their text does not touch that of the ends. */
    double clear = 2.5 * HADA_FONT_HEIGHT * range / height;
    for (double k = ceil((sheet->near + clear) / step); k * step <= sheet->far - clear; k++)
        draw_tick(sheet, canvas, x + BAR, y, height, k * step);
}

static hada_status draw_panels(const hada_sheet *sheet, hada_canvas *canvas, hada_error *err)
{
    const hada_preview *p = sheet->p;
    const hada_image *shown[2] = {p->raw, p->all_in_focus};
    static const char *const names[2] = {"raw", "all in focus"};
    int x = MARGIN, y = sheet->panels_y, height = sheet->panel_height;
    hada_status status = HADA_OK;
    for (int i = 0; i < 2 && !status; i++)
        if (shown[i]) {
            int width = width_of(shown[i], height);
            char text[80];
            snprintf(text, sizeof text, "%s, %d x %d", names[i], shown[i]->cols, shown[i]->rows);
            caption(canvas, x, y, width, text);
            status =
                hada_tone_draw(canvas, x, y, width, height, shown[i], hada_tone_white(shown[i], 1), sheet->gamma, err);
            hada_canvas_frame(canvas, x, y, width, height, 1, line);
            x += width + GAP;
        }
    if (!status && p->distance_map) {
        int width = width_of(p->distance_map, height);
        int room = width + GAP + BAR + BAR_TEXT;
        const char *text = "distance (hatched: nothing in focus)";
        caption(canvas, x, y, room, hada_text_width(text, 2) <= room ? text : "distance");
        draw_map(sheet, canvas, x, y, width, height);
        hada_canvas_frame(canvas, x, y, width, height, 1, line);
        draw_bar(sheet, canvas, x + width + GAP, y, height);
    }
    return status;
}

/* One refocused image: framed where the scene was found, its label with the colour that the map has for it. */
static hada_status draw_tile(const hada_sheet *sheet, hada_canvas *canvas, int index, double white, hada_error *err)
{
    const hada_preview *p = sheet->p;
    int width = sheet->tile_width, height = sheet->tile_height;
    int x = MARGIN + index % sheet->columns * (width + GAP);
    int y = sheet->stack_y + CAPTION + 8 + index / sheet->columns * (height + CAPTION + GAP);
    int marked = p->occupied && p->occupied[index], bright = marked || !p->occupied;
    hada_status status = hada_tone_draw(canvas, x, y, width, height, &p->planes[index], white, sheet->gamma, err);
    if (status)
        return status;
    hada_canvas_frame(canvas, x, y, width, height, marked ? 4 : 1, marked ? found : line);
    char number[32] = "", label[48];
    if (p->distances_mm)
        hada_format_number(number, sizeof number, "%.6g", p->distances_mm[index]);
    else
        snprintf(number, sizeof number, "depth %d", index + 1);
    snprintf(label, sizeof label, "%s%s", number, p->distances_mm ? " mm" : "");
    int text_x = x, text_y = y + height + 10;
    if (p->distances_mm && p->distance_map) {
        unsigned char rgb[3];
        hada_colormap((p->distances_mm[index] - sheet->near) / (sheet->far - sheet->near), rgb);
        hada_canvas_fill(canvas, x, text_y, 14, 14, (hada_colour){rgb[0], rgb[1], rgb[2]});
        hada_canvas_frame(canvas, x, text_y, 14, 14, 1, dim);
        text_x += 24;
    }
    hada_canvas_text(canvas, text_x, text_y, 2, width, marked ? found : bright ? ink : dim, label);
    return HADA_OK;
}

static hada_status draw_stack(const hada_sheet *sheet, hada_canvas *canvas, hada_error *err)
{
    const hada_preview *p = sheet->p;
    if (!sheet->columns)
        return HADA_OK;
    int marked = 0;
    for (int i = 0; p->occupied && i < p->depths; i++)
        marked += p->occupied[i] != 0;
    char text[160];
    snprintf(text, sizeof text, "refocused, near to far, %d x %d", p->planes[0].cols, p->planes[0].rows);
    int x = MARGIN + hada_canvas_text(canvas, MARGIN, sheet->stack_y + 4, 2, WIDTH - 2 * MARGIN, ink, text);
    if (p->occupied) {
        snprintf(text, sizeof text, "scene found at %d of %d distances", marked, p->depths);
        hada_canvas_frame(canvas, x + 28, sheet->stack_y + 4, 14, 14, 4, found);
        hada_canvas_text(canvas, x + 58, sheet->stack_y + 4, 2, WIDTH - MARGIN - x - 58, found, text);
    }
    /* One white for all, so that brightness can be compared. */
    double white = hada_tone_white(p->planes, p->depths);
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < p->depths; i++)
        status = draw_tile(sheet, canvas, i, white, err);
    return status;
}

static int is_empty(const hada_image *image)
{
    return image && (!image->data || image->rows < 1 || image->cols < 1 || image->channels < 1);
}

void hada_preview_defaults(hada_preview *preview, size_t size)
{
    const hada_preview own = {.size = sizeof own};
    HADA_OPTIONS_GIVE(preview, size, &own);
}

hada_status hada_preview_save(const char *path, const hada_preview *callers, hada_error *err)
{
    hada_preview own, *preview = &own;
    hada_preview_init(preview);
    hada_status status = HADA_OPTIONS_TAKE(preview, callers, hada_preview, err);
    if (status)
        return status;
    int empty = is_empty(preview->raw) || is_empty(preview->all_in_focus) || is_empty(preview->distance_map);
    for (int i = 0; preview->planes && i < preview->depths; i++)
        empty |= is_empty(&preview->planes[i]);
    int nothing_shown =
        !preview->raw && !preview->all_in_focus && !preview->distance_map && !(preview->planes && preview->depths > 0);
    if (empty || nothing_shown)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: there is no image to show", path);
    hada_sheet sheet = {.p = preview, .gamma = preview->gamma > 0 ? preview->gamma : 1 / 2.2};
    find_range(&sheet);
    place(&sheet);
    hada_canvas canvas;
    status = hada_canvas_create(&canvas, WIDTH, sheet.height, paper, err);
    if (status)
        return status;
    if (preview->title && *preview->title)
        hada_canvas_text(&canvas, MARGIN, 22, 3, WIDTH - 2 * MARGIN, ink, preview->title);
    status = draw_panels(&sheet, &canvas, err);
    if (!status)
        status = draw_stack(&sheet, &canvas, err);
    if (!status)
        status = hada_canvas_save(&canvas, path, err);
    hada_canvas_destroy(&canvas);
    return status;
}

hada_status hada_png_save(const char *path, const hada_image *image, double white, double gamma, hada_error *err)
{
    if (is_empty(image))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: there is no image to show", path);
    hada_canvas canvas;
    hada_status status = hada_canvas_create(&canvas, image->cols, image->rows, paper, err);
    if (!status)
        status = hada_tone_draw(&canvas, 0, 0, image->cols, image->rows, image,
                                white > 0 ? white : hada_tone_white(image, 1), gamma, err);
    if (!status)
        status = hada_canvas_save(&canvas, path, err);
    hada_canvas_destroy(&canvas);
    return status;
}
