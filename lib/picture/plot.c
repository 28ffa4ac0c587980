/* Figures: axes, what is drawn in their units, and places for labels. */
#include <hadalens/plot.h>

#include "io/text.h"
#include "picture/drawing.h"

enum { LABELS = 64, BOXES = 1024 };
#define FONT 11.0 /* pixels: numbers and labels; titles are one larger */

static const hada_colour black = 0x000000, edge = 0x333333, grid = 0xdddddd, fine_grid = 0xf0f0f0, leader = 0x888888,
                         white = 0xffffff;

static const unsigned colours[] = {0x0072B2, 0xE69F00, 0x009E73, 0xD55E00, 0xCC79A7, 0x56B4E9, 0xF0E442, 0x555555};

unsigned hada_plot_colour(int index)
{
    return colours[index & 7];
}

typedef struct box {
    double x0, y0, x1, y1;
} box;

typedef struct label {
    double x, y;
    char text[96];
} label;

struct hada_plot {
    hada_drawing *drawing;
    hada_plot_panel panel;
    label labels[LABELS];
    box boxes[BOXES]; /* taken: points, and labels placed so far */
    int label_count, box_count;
};

static double place(const hada_plot_axis *axis, double value)
{
    return axis->logarithmic ? log(value / axis->low) / log(axis->high / axis->low)
                             : (value - axis->low) / (axis->high - axis->low);
}

static double at_x(const hada_plot *plot, double x)
{
    return plot->panel.left + plot->panel.width * place(&plot->panel.across, x);
}

static double at_y(const hada_plot *plot, double y)
{
    return plot->panel.top + plot->panel.height * (1 - place(&plot->panel.up, y));
}

hada_plot_axis hada_plot_axis_for(const double *values, int count, int logarithmic, const char *text)
{
    if (!values)
        return (hada_plot_axis){0, 1, 0, 0, NULL};
    hada_plot_axis axis = {.logarithmic = logarithmic, .label = text};
    int found = 0;
    for (int i = 0; i < count; i++) {
        if (!isfinite(values[i]) || (logarithmic && values[i] <= 0))
            continue;
        axis.low = !found || values[i] < axis.low ? values[i] : axis.low;
        axis.high = !found || values[i] > axis.high ? values[i] : axis.high;
        found = 1;
    }
    if (!found)
        axis = (hada_plot_axis){logarithmic ? 0.1 : 0, 1, logarithmic, 0, text};
    if (logarithmic) {
        axis.low /= 1.25;
        axis.high *= 1.25;
        return axis;
    }
    if (axis.high <= axis.low)
        axis.high = axis.low + (axis.low == 0 ? 1 : 0.1 * fabs(axis.low));
    const double step = hada_drawing_step(axis.high - axis.low, 5);
    axis.low = floor(axis.low / step) * step;
    axis.high = ceil(axis.high / step) * step;
    return axis;
}

hada_status hada_plot_create(hada_plot **out, double width, double height, hada_error *err)
{
    HADA_NEED(out, err);
    hada_status status = HADA_OK;
    hada_plot *plot = NULL;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(plot, 1, "a figure", err));
    HADA_TRY_OR_DONE(hada_drawing_create(&plot->drawing, width, height, white, err));
    *out = plot;
    plot = NULL;
done:
    free(plot);
    return status;
}

static double put_text(hada_plot *plot, double x, double y, hada_anchor anchor, double size, const char *text)
{
    return hada_drawing_text(plot->drawing, x, y, anchor, size, 0.0, black, text);
}

void hada_plot_text(hada_plot *plot, double x, double y, char anchor, double size, const char *text)
{
    if (!plot || !text)
        return;
    put_text(plot, x, y,
             anchor == 'l'   ? HADA_ANCHOR_LEFT
             : anchor == 'm' ? HADA_ANCHOR_MIDDLE
                             : HADA_ANCHOR_RIGHT,
             size, text);
}

static void segment(hada_plot *plot, double x0, double y0, double x1, double y1, hada_colour colour, double width)
{
    const double ends[] = {x0, y0, x1, y1};
    hada_drawing_line(plot->drawing, ends, 2, colour, width, 0);
}

/* A number at a tick: powers of ten beyond what reads well get an exponent. */
static void put_number(hada_plot *plot, double x, double y, hada_anchor anchor, double value, int logarithmic)
{
    char text[40], exponent[16];
    if (!logarithmic || (value > 0.9e-3 && value < 1.1e4)) {
        hada_format_number(text, sizeof text, "%.6g", fabs(value) < 1e-12 ? 0.0 : value);
        put_text(plot, x, y, anchor, FONT, text);
        return;
    }
    const int power = (int)floor(log10(value) + 1e-9), digit = (int)lround(value / pow(10, power));
    if (digit > 1)
        snprintf(text, sizeof text, "%d·10", digit);
    else
        snprintf(text, sizeof text, "10");
    snprintf(exponent, sizeof exponent, "%d", power);
    const double small = 0.75 * FONT, raised = hada_drawing_text_width(plot->drawing, small, exponent),
                 base = hada_drawing_text_width(plot->drawing, FONT, text);
    const double left = anchor == HADA_ANCHOR_MIDDLE ? x - (base + raised) / 2 : x - base - raised;
    put_text(plot, left, y, HADA_ANCHOR_LEFT, FONT, text);
    put_text(plot, left + base, y - 4, HADA_ANCHOR_LEFT, small, exponent);
}

static void tick(hada_plot *plot, int across, double value, int numbered)
{
    const hada_plot_panel *p = &plot->panel;
    const double bottom = p->top + p->height;
    if (across) {
        const double x = at_x(plot, value);
        segment(plot, x, p->top, x, bottom, numbered ? grid : fine_grid, 0.8);
        segment(plot, x, bottom, x, bottom + (numbered ? 5 : 3), edge, 1);
        if (numbered)
            put_number(plot, x, bottom + 6 + FONT, HADA_ANCHOR_MIDDLE, value, p->across.logarithmic);
    } else {
        const double y = at_y(plot, value);
        segment(plot, p->left, y, p->left + p->width, y, numbered ? grid : fine_grid, 0.8);
        segment(plot, p->left - (numbered ? 5 : 3), y, p->left, y, edge, 1);
        if (numbered)
            put_number(plot, p->left - 8, y + 0.35 * FONT, HADA_ANCHOR_RIGHT, value, p->up.logarithmic);
    }
}

/* Far more than steps make; above 2^53 a number and the next are one, and counting would not end. */
enum { MOST_TICKS = 64 };

static void ticks(hada_plot *plot, int across)
{
    const hada_plot_axis *axis = across ? &plot->panel.across : &plot->panel.up;
    if (axis->bare)
        return;
    /* less than a decade may hold no power of ten: even steps there, too */
    const double decades = axis->logarithmic ? log10(axis->high / axis->low) : 0;
    if (decades < 0.8) {
        const double step = hada_drawing_step(axis->high - axis->low, 5);
        const double first = ceil(axis->low / step - 1e-9) * step;
        for (int i = 0; i < MOST_TICKS && first + i * step <= axis->high + 1e-9 * step; i++)
            tick(plot, across, first + i * step, 1);
        return;
    }
    /* few decades: 2 and 5 have numbers too; many: only every other power */
    const int apart = decades > 7 ? 2 : 1;
    for (int power = (int)floor(log10(axis->low)); power <= (int)ceil(log10(axis->high)); power++)
        for (int digit = 1; digit <= 9; digit++) {
            const double v = digit * pow(10, power);
            const int numbered = digit == 1 ? power % apart == 0 : decades < 2.2 && (digit == 2 || digit == 5);
            if (v >= axis->low * 0.9999 && v <= axis->high * 1.0001)
                tick(plot, across, v, numbered);
        }
}

void hada_plot_panel_begin(hada_plot *plot, const hada_plot_panel *panel)
{
    if (!plot || !panel)
        return;
    const double middle = panel->left + panel->width / 2, centre = panel->top + panel->height / 2;
    const double corners[] = {panel->left,
                              panel->top,
                              panel->left + panel->width,
                              panel->top,
                              panel->left + panel->width,
                              panel->top + panel->height,
                              panel->left,
                              panel->top + panel->height,
                              panel->left,
                              panel->top};
    plot->panel = *panel;
    plot->label_count = plot->box_count = 0;
    ticks(plot, 1);
    ticks(plot, 0);
    hada_drawing_line(plot->drawing, corners, 5, edge, 1, 0);
    if (panel->title)
        put_text(plot, middle, panel->top - 8, HADA_ANCHOR_MIDDLE, FONT + 1, panel->title);
    if (panel->across.label)
        put_text(plot, middle, panel->top + panel->height + 36, HADA_ANCHOR_MIDDLE, FONT + 1, panel->across.label);
    if (panel->up.label)
        hada_drawing_text_up(plot->drawing, panel->left - 46, centre, FONT + 1, black, panel->up.label);
}

static void take(hada_plot *plot, box taken)
{
    if (plot->box_count < BOXES)
        plot->boxes[plot->box_count++] = taken;
}

/* Small boxes all along it. */
static void take_segment(hada_plot *plot, double x0, double y0, double x1, double y1)
{
    const int steps = 1 + (int)(fmin(hypot(x1 - x0, y1 - y0), 2000) / 8);
    for (int i = 0; i <= steps; i++) {
        const double x = x0 + (x1 - x0) * i / steps, y = y0 + (y1 - y0) * i / steps;
        if (x >= plot->panel.left && x <= plot->panel.left + plot->panel.width)
            take(plot, (box){x - 2, y - 2, x + 2, y + 2});
    }
}

void hada_plot_line(hada_plot *plot, const double *x, const double *y, int count, unsigned colour, int dashed)
{
    enum { STRETCH = 256 }; /* points drawn at once; stretches share their ends */
    double points[2 * STRETCH];
    if (!plot || !x || !y)
        return;
    hada_drawing_clip(plot->drawing, plot->panel.left, plot->panel.top, plot->panel.width, plot->panel.height);
    for (int first = 0; first + 1 < count; first += STRETCH - 1) {
        const int n = count - first < STRETCH ? count - first : STRETCH;
        for (int i = 0; i < n; i++) {
            points[2 * i] = at_x(plot, x[first + i]);
            points[2 * i + 1] = at_y(plot, y[first + i]);
        }
        hada_drawing_line(plot->drawing, points, n, colour, 1.4, dashed);
    }
    hada_drawing_unclip(plot->drawing);
    for (int i = 0; i + 1 < count; i++)
        take_segment(plot, at_x(plot, x[i]), at_y(plot, y[i]), at_x(plot, x[i + 1]), at_y(plot, y[i + 1]));
}

/* Corners in units of the radius; sizes differ so that the areas look alike. */
static const double square[] = {-0.9, -0.9, 0.9, -0.9, 0.9, 0.9, -0.9, 0.9},
                    triangle[] = {0, -1.15, -1.05, 0.8, 1.05, 0.8}, diamond[] = {0, -1.2, 1.2, 0, 0, 1.2, -1.2, 0};

static void draw_corners(hada_plot *plot, double x, double y, double r, const double *corners, int count,
                         hada_colour fill, hada_colour outline)
{
    double points[8];
    for (int i = 0; i < count; i++) {
        points[2 * i] = x + r * corners[2 * i];
        points[2 * i + 1] = y + r * corners[2 * i + 1];
    }
    hada_drawing_polygon(plot->drawing, points, count, fill, outline, 1.3);
}

static void draw_mark(hada_plot *plot, double x, double y, const hada_plot_mark *mark)
{
    const double r = mark->radius;
    const hada_colour fill = mark->hollow ? white : mark->colour, outline = mark->hollow ? mark->colour : white;
    if (mark->shape == HADA_PLOT_DISC)
        hada_drawing_disc(plot->drawing, x, y, r, fill, outline, 1.3);
    else if (mark->shape == HADA_PLOT_TRIANGLE)
        draw_corners(plot, x, y, r, triangle, 3, fill, outline);
    else
        draw_corners(plot, x, y, r, mark->shape == HADA_PLOT_SQUARE ? square : diamond, 4, fill, outline);
    if (mark->crossed) {
        segment(plot, x - 1.5 * r, y - 1.5 * r, x + 1.5 * r, y + 1.5 * r, black, 1);
        segment(plot, x - 1.5 * r, y + 1.5 * r, x + 1.5 * r, y - 1.5 * r, black, 1);
    }
}

void hada_plot_point(hada_plot *plot, double x, double y, const hada_plot_mark *mark)
{
    if (!plot || !mark)
        return;
    const double px = at_x(plot, x), py = at_y(plot, y), r = mark->radius + 1;
    draw_mark(plot, px, py, mark);
    take(plot, (box){px - r, py - r, px + r, py + r});
}

void hada_plot_bar(hada_plot *plot, double x0, double x1, double y0, double y1, unsigned colour)
{
    if (!plot)
        return;
    const double left = at_x(plot, x0), right = at_x(plot, x1), top = at_y(plot, y1), bottom = at_y(plot, y0);
    const double corners[] = {left, top, right, top, right, bottom, left, bottom};
    hada_drawing_polygon(plot->drawing, corners, 4, colour, white, 0.5);
}

void hada_plot_whisker(hada_plot *plot, double low, double high, double y)
{
    if (!plot)
        return;
    const double x0 = at_x(plot, low), x1 = at_x(plot, high), py = at_y(plot, y);
    segment(plot, x0, py, x1, py, black, 1);
    segment(plot, x0, py - 4, x0, py + 4, black, 1);
    segment(plot, x1, py - 4, x1, py + 4, black, 1);
}

void hada_plot_note(hada_plot *plot, double x, double y, char anchor, const char *text)
{
    if (!plot || !text)
        return;
    const double wide = hada_drawing_text_width(plot->drawing, FONT, text);
    const double left = x - (anchor == 'l' ? 0 : anchor == 'm' ? wide / 2 : wide);
    put_text(plot, left, y, HADA_ANCHOR_LEFT, FONT, text);
    take(plot, (box){left, y - FONT, left + wide, y + 3});
}

void hada_plot_label(hada_plot *plot, double x, double y, const char *text)
{
    if (!plot || plot->label_count == LABELS)
        return;
    label *one = &plot->labels[plot->label_count++];
    one->x = at_x(plot, x);
    one->y = at_y(plot, y);
    snprintf(one->text, sizeof one->text, "%s", text);
}

static int is_free(const hada_plot *plot, const box *wanted)
{
    const hada_plot_panel *p = &plot->panel;
    if (wanted->x0 < p->left + 2 || wanted->x1 > p->left + p->width - 2 || wanted->y0 < p->top + 2 ||
        wanted->y1 > p->top + p->height - 2)
        return 0;
    for (int i = 0; i < plot->box_count; i++) {
        const box *b = &plot->boxes[i];
        if (wanted->x0 < b->x1 && wanted->x1 > b->x0 && wanted->y0 < b->y1 && wanted->y1 > b->y0)
            return 0;
    }
    return 1;
}

/* Round the point, nearer places first; a label that finds none is left out. */
void hada_plot_panel_end(hada_plot *plot)
{
    static const double sides[][2] = {{1, 0}, {-1, 0}, {0, -1}, {0, 1}, {1, -1}, {-1, -1}, {1, 1}, {-1, 1}};
    static const double reach[] = {7, 14, 24, 38, 56, 78, 104, 134};
    const double size = FONT - 1;
    for (int i = 0; plot && i < plot->label_count; i++) {
        const label *one = &plot->labels[i];
        const double half = hada_drawing_text_width(plot->drawing, size, one->text) / 2, tall = size;
        for (int k = 0; k < 64; k++) {
            const double *side = sides[k % 8], far = reach[k / 8];
            const double x = one->x + side[0] * (half + far), y = one->y + side[1] * (tall / 2 + far);
            const box wanted = {x - half - 1, y - tall / 2 - 1, x + half + 1, y + tall / 2 + 2};
            if (!is_free(plot, &wanted))
                continue;
            if (k >= 8)
                segment(plot, one->x + side[0] * 4, one->y + side[1] * 4, x - side[0] * half,
                        y - side[1] * (tall / 2 + 1), leader, 0.7);
            put_text(plot, x, y + 0.35 * size, HADA_ANCHOR_MIDDLE, size, one->text);
            take(plot, wanted);
            break;
        }
    }
    if (plot)
        plot->label_count = plot->box_count = 0;
}

double hada_plot_legend(hada_plot *plot, double x, double y, const hada_plot_mark *mark, unsigned filled,
                        const char *text)
{
    if (!plot || !text)
        return x;
    if (mark)
        draw_mark(plot, x + 7, y, mark);
    else if (filled != HADA_PLOT_NO_COLOUR)
        hada_drawing_fill(plot->drawing, x + 1, y - 5, 12, 10, filled);
    else
        segment(plot, x, y, x + 14, y, black, 1.4);
    return x + 19 + put_text(plot, x + 19, y + 0.35 * FONT, HADA_ANCHOR_LEFT, FONT, text) + 14;
}

hada_status hada_plot_save(const hada_plot *plot, const char *path, hada_error *err)
{
    if (!plot)
        return HADA_OK;
    HADA_NEED(path, err);
    return hada_drawing_save(plot->drawing, path, err);
}

void hada_plot_destroy(hada_plot **pointer)
{
    hada_plot *plot = hada_taken(pointer);
    if (!plot)
        return;
    hada_drawing_destroy(&plot->drawing);
    free(plot);
}
