#include "plot_svg.h"
#include "folder.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LABELS = 64, BOXES = 1024 };
#define FONT 11.0

const char *const hada_plot_colours[8] = {"#0072B2", "#E69F00", "#009E73", "#D55E00",
                                          "#CC79A7", "#56B4E9", "#F0E442", "#555555"};

typedef struct box {
    double x0, y0, x1, y1;
} box;

typedef struct label {
    double x, y;
    char text[96];
} label;

struct hada_plot {
    FILE *out;
    char *text;
    size_t size;
    double width, height;
    hada_plot_panel panel;
    label labels[LABELS];
    box boxes[BOXES]; /* taken: points, and labels placed so far */
    int label_count, box_count, panels;
};

static void put_text(FILE *out, const char *text)
{
    for (; *text; text++)
        if (*text == '<')
            fputs("&lt;", out);
        else if (*text == '>')
            fputs("&gt;", out);
        else if (*text == '&')
            fputs("&amp;", out);
        else
            fputc(*text, out);
}

double hada_plot_text_width(const char *text, double size)
{
    int letters = 0;
    for (; *text; text++)
        letters += (*text & 0xC0) != 0x80; /* UTF-8: not the bytes that follow */
    return 0.56 * size * letters;
}

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

/* 1, 2 or 5 times a power of ten: about `parts` steps in a range. */
static double nice_step(double range, int parts)
{
    const double rough = range / parts, power = pow(10, floor(log10(rough)));
    const double digit = rough / power;
    return power * (digit <= 1 ? 1 : digit <= 2 ? 2 : digit <= 5 ? 5 : 10);
}

hada_plot_axis hada_plot_axis_for(const double *values, int count, int logarithmic, const char *text)
{
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
    const double step = nice_step(axis.high - axis.low, 5);
    axis.low = floor(axis.low / step) * step;
    axis.high = ceil(axis.high / step) * step;
    return axis;
}

hada_status hada_plot_begin(hada_plot **out, double width, double height, hada_error *err)
{
    hada_plot *plot = calloc(1, sizeof *plot);
    *out = NULL;
    if (plot)
        plot->out = open_memstream(&plot->text, &plot->size);
    if (!plot || !plot->out) {
        free(plot);
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    plot->width = width;
    plot->height = height;
    fprintf(plot->out,
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%g\" height=\"%g\" viewBox=\"0 0 %g %g\" "
            "font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\" font-size=\"%g\">\n"
            "<rect width=\"%g\" height=\"%g\" fill=\"white\"/>\n",
            width, height, width, height, FONT, width, height);
    *out = plot;
    return HADA_OK;
}

void hada_plot_text(hada_plot *plot, double x, double y, char anchor, double size, const char *text)
{
    fprintf(plot->out, "<text x=\"%.1f\" y=\"%.1f\" font-size=\"%g\" text-anchor=\"%s\">", x, y, size,
            anchor == 'l'   ? "start"
            : anchor == 'm' ? "middle"
                            : "end");
    put_text(plot->out, text);
    fputs("</text>\n", plot->out);
}

static void segment(hada_plot *plot, double x0, double y0, double x1, double y1, const char *colour, double width)
{
    fprintf(plot->out, "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" stroke-width=\"%g\"/>\n",
            x0, y0, x1, y1, colour, width);
}

/* A number at a tick: powers of ten beyond what reads well get an exponent. */
static void put_number(hada_plot *plot, double x, double y, char anchor, double value, int logarithmic)
{
    char text[32];
    if (!logarithmic || (value > 0.9e-3 && value < 1.1e4)) {
        snprintf(text, sizeof text, "%.6g", fabs(value) < 1e-12 ? 0.0 : value);
        hada_plot_text(plot, x, y, anchor, FONT, text);
        return;
    }
    const int power = (int)floor(log10(value) + 1e-9), digit = (int)lround(value / pow(10, power));
    fprintf(plot->out, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">", x, y, anchor == 'm' ? "middle" : "end");
    if (digit > 1)
        fprintf(plot->out, "%d\xC2\xB7", digit);
    fprintf(plot->out, "10<tspan dy=\"-4\" font-size=\"%g\">%d</tspan></text>\n", 0.75 * FONT, power);
}

static void tick(hada_plot *plot, int across, double value, int numbered)
{
    const hada_plot_panel *p = &plot->panel;
    const double bottom = p->top + p->height;
    if (across) {
        const double x = at_x(plot, value);
        segment(plot, x, p->top, x, bottom, numbered ? "#dddddd" : "#f0f0f0", 0.8);
        segment(plot, x, bottom, x, bottom + (numbered ? 5 : 3), "#333333", 1);
        if (numbered)
            put_number(plot, x, bottom + 6 + FONT, 'm', value, p->across.logarithmic);
    } else {
        const double y = at_y(plot, value);
        segment(plot, p->left, y, p->left + p->width, y, numbered ? "#dddddd" : "#f0f0f0", 0.8);
        segment(plot, p->left - (numbered ? 5 : 3), y, p->left, y, "#333333", 1);
        if (numbered)
            put_number(plot, p->left - 8, y + 0.35 * FONT, 'r', value, p->up.logarithmic);
    }
}

static void ticks(hada_plot *plot, int across)
{
    const hada_plot_axis *axis = across ? &plot->panel.across : &plot->panel.up;
    if (axis->bare)
        return;
    /* less than a decade may hold no power of ten: even steps there, too */
    const double decades = axis->logarithmic ? log10(axis->high / axis->low) : 0;
    if (decades < 0.8) {
        const double step = nice_step(axis->high - axis->low, 5);
        for (double v = ceil(axis->low / step - 1e-9) * step; v <= axis->high + 1e-9 * step; v += step)
            tick(plot, across, v, 1);
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
    const double middle = panel->left + panel->width / 2, centre = panel->top + panel->height / 2;
    plot->panel = *panel;
    plot->label_count = plot->box_count = 0;
    fprintf(plot->out, "<clipPath id=\"panel%d\"><rect x=\"%g\" y=\"%g\" width=\"%g\" height=\"%g\"/></clipPath>\n",
            ++plot->panels, panel->left, panel->top, panel->width, panel->height);
    ticks(plot, 1);
    ticks(plot, 0);
    fprintf(plot->out, "<rect x=\"%g\" y=\"%g\" width=\"%g\" height=\"%g\" fill=\"none\" stroke=\"#333333\"/>\n",
            panel->left, panel->top, panel->width, panel->height);
    if (panel->title)
        hada_plot_text(plot, middle, panel->top - 8, 'm', FONT + 1, panel->title);
    if (panel->across.label)
        hada_plot_text(plot, middle, panel->top + panel->height + 36, 'm', FONT + 1, panel->across.label);
    if (panel->up.label) {
        fprintf(plot->out,
                "<text x=\"0\" y=\"0\" font-size=\"%g\" text-anchor=\"middle\" "
                "transform=\"translate(%.1f %.1f) rotate(-90)\">",
                FONT + 1, panel->left - 46, centre);
        put_text(plot->out, panel->up.label);
        fputs("</text>\n", plot->out);
    }
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

void hada_plot_line(hada_plot *plot, const double *x, const double *y, int count, const char *colour, int dashed)
{
    fprintf(plot->out, "<polyline fill=\"none\" clip-path=\"url(#panel%d)\" points=\"", plot->panels);
    for (int i = 0; i < count; i++)
        fprintf(plot->out, "%s%.1f,%.1f", i ? " " : "", at_x(plot, x[i]), at_y(plot, y[i]));
    fprintf(plot->out, "\" stroke=\"%s\" stroke-width=\"1.4\"%s/>\n", colour,
            dashed ? " stroke-dasharray=\"5 3\"" : "");
    for (int i = 0; i + 1 < count; i++)
        take_segment(plot, at_x(plot, x[i]), at_y(plot, y[i]), at_x(plot, x[i + 1]), at_y(plot, y[i + 1]));
}

static void draw_mark(hada_plot *plot, double x, double y, const hada_plot_mark *mark)
{
    const double r = mark->radius;
    char paint[96];
    snprintf(paint, sizeof paint, "fill=\"%s\" stroke=\"%s\" stroke-width=\"1.3\"",
             mark->hollow ? "white" : mark->colour, mark->hollow ? mark->colour : "white");
    if (mark->shape == HADA_PLOT_DISC)
        fprintf(plot->out, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" %s/>\n", x, y, r, paint);
    else if (mark->shape == HADA_PLOT_SQUARE)
        fprintf(plot->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" %s/>\n", x - 0.9 * r,
                y - 0.9 * r, 1.8 * r, 1.8 * r, paint);
    else if (mark->shape == HADA_PLOT_TRIANGLE)
        fprintf(plot->out, "<polygon points=\"%.1f,%.1f %.1f,%.1f %.1f,%.1f\" %s/>\n", x, y - 1.15 * r, x - 1.05 * r,
                y + 0.8 * r, x + 1.05 * r, y + 0.8 * r, paint);
    else
        fprintf(plot->out, "<polygon points=\"%.1f,%.1f %.1f,%.1f %.1f,%.1f %.1f,%.1f\" %s/>\n", x, y - 1.2 * r,
                x + 1.2 * r, y, x, y + 1.2 * r, x - 1.2 * r, y, paint);
    if (mark->crossed) {
        segment(plot, x - 1.5 * r, y - 1.5 * r, x + 1.5 * r, y + 1.5 * r, "#000000", 1);
        segment(plot, x - 1.5 * r, y + 1.5 * r, x + 1.5 * r, y - 1.5 * r, "#000000", 1);
    }
}

void hada_plot_point(hada_plot *plot, double x, double y, const hada_plot_mark *mark)
{
    const double px = at_x(plot, x), py = at_y(plot, y), r = mark->radius + 1;
    draw_mark(plot, px, py, mark);
    take(plot, (box){px - r, py - r, px + r, py + r});
}

void hada_plot_bar(hada_plot *plot, double x0, double x1, double y0, double y1, const char *colour)
{
    fprintf(plot->out,
            "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.2f\" height=\"%.1f\" fill=\"%s\" stroke=\"white\" "
            "stroke-width=\"0.5\"/>\n",
            at_x(plot, x0), at_y(plot, y1), at_x(plot, x1) - at_x(plot, x0), at_y(plot, y0) - at_y(plot, y1), colour);
}

void hada_plot_whisker(hada_plot *plot, double low, double high, double y)
{
    const double x0 = at_x(plot, low), x1 = at_x(plot, high), py = at_y(plot, y);
    segment(plot, x0, py, x1, py, "#000000", 1);
    segment(plot, x0, py - 4, x0, py + 4, "#000000", 1);
    segment(plot, x1, py - 4, x1, py + 4, "#000000", 1);
}

void hada_plot_note(hada_plot *plot, double x, double y, char anchor, const char *text)
{
    const double wide = hada_plot_text_width(text, FONT);
    const double left = x - (anchor == 'l' ? 0 : anchor == 'm' ? wide / 2 : wide);
    hada_plot_text(plot, x, y, anchor, FONT, text);
    take(plot, (box){left, y - FONT, left + wide, y + 3});
}

void hada_plot_label(hada_plot *plot, double x, double y, const char *text)
{
    if (plot->label_count == LABELS)
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
    for (int i = 0; i < plot->label_count; i++) {
        const label *one = &plot->labels[i];
        const double half = hada_plot_text_width(one->text, size) / 2, tall = size;
        for (int k = 0; k < 64; k++) {
            const double *side = sides[k % 8], far = reach[k / 8];
            const double x = one->x + side[0] * (half + far), y = one->y + side[1] * (tall / 2 + far);
            const box wanted = {x - half - 1, y - tall / 2 - 1, x + half + 1, y + tall / 2 + 2};
            if (!is_free(plot, &wanted))
                continue;
            if (k >= 8)
                segment(plot, one->x + side[0] * 4, one->y + side[1] * 4, x - side[0] * half,
                        y - side[1] * (tall / 2 + 1), "#888888", 0.7);
            hada_plot_text(plot, x, y + 0.35 * size, 'm', size, one->text);
            take(plot, wanted);
            break;
        }
    }
    plot->label_count = plot->box_count = 0;
}

double hada_plot_legend(hada_plot *plot, double x, double y, const hada_plot_mark *mark, const char *filled,
                        const char *text)
{
    if (mark)
        draw_mark(plot, x + 7, y, mark);
    else if (filled)
        fprintf(plot->out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"12\" height=\"10\" fill=\"%s\"/>\n", x + 1, y - 5,
                filled);
    else
        segment(plot, x, y, x + 14, y, "#000000", 1.4);
    hada_plot_text(plot, x + 19, y + 0.35 * FONT, 'l', FONT, text);
    return x + 19 + hada_plot_text_width(text, FONT) + 14;
}

hada_status hada_plot_save(hada_plot **pointer, const char *path, hada_error *err)
{
    hada_plot *plot = *pointer;
    *pointer = NULL;
    if (!plot)
        return HADA_OK;
    fputs("</svg>\n", plot->out);
    hada_status status = HADA_OK;
    if ((ferror(plot->out) | fclose(plot->out)) || !path)
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory for a figure");
    if (!status)
        status = hada_cli_write_text(path, plot->text, plot->size, err);
    free(plot->text);
    free(plot);
    return status;
}
