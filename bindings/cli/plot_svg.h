/* Figures as SVG text: panels with axes, points, lines, bars, labels that keep out of each other's way. Small on
 * purpose; docs/bench.md says why no library does it.
 *
 * Everything is drawn into memory, in order; hada_plot_save() writes it. A failure on the way is told there. */
#ifndef HADA_CLI_PLOT_SVG_H
#define HADA_CLI_PLOT_SVG_H

#include <hadalens/status.h>

typedef struct hada_plot hada_plot;

typedef struct hada_plot_axis {
    double low, high;
    int logarithmic;   /* low > 0 */
    int bare;          /* no numbers */
    const char *label; /* with the unit */
} hada_plot_axis;

/* A frame within the figure, in pixels, with room left for numbers and labels round it. */
typedef struct hada_plot_panel {
    double left, top, width, height;
    hada_plot_axis across, up;
    const char *title; /* or NULL */
} hada_plot_panel;

typedef enum hada_plot_shape {
    HADA_PLOT_DISC,
    HADA_PLOT_SQUARE,
    HADA_PLOT_TRIANGLE,
    HADA_PLOT_DIAMOND
} hada_plot_shape;

typedef struct hada_plot_mark {
    hada_plot_shape shape;
    const char *colour;
    double radius; /* pixels */
    int hollow, crossed;
} hada_plot_mark;

/* Colours that people with any colour vision tell apart: M. Okabe, K. Ito, "Color universal design" (2008). */
extern const char *const hada_plot_colours[8];

/* Rounded limits that hold all values (NaN left out; logarithmic: those above 0 only). */
hada_plot_axis hada_plot_axis_for(const double *values, int count, int logarithmic, const char *label);

hada_status hada_plot_begin(hada_plot **out, double width, double height, hada_error *err);
void hada_plot_panel_begin(hada_plot *plot, const hada_plot_panel *panel);
/* Places the labels of the panel; needed after the last of its points. */
void hada_plot_panel_end(hada_plot *plot);

/* In the units of the panel's axes. */
void hada_plot_line(hada_plot *plot, const double *x, const double *y, int count, const char *colour, int dashed);
void hada_plot_point(hada_plot *plot, double x, double y, const hada_plot_mark *mark);
void hada_plot_bar(hada_plot *plot, double x0, double x1, double y0, double y1, const char *colour);
void hada_plot_whisker(hada_plot *plot, double low, double high, double y); /* across */
/* Beside the point, where there is room. */
void hada_plot_label(hada_plot *plot, double x, double y, const char *text);

/* A text within the panel that labels keep out of; pixels and anchor as in hada_plot_text. */
void hada_plot_note(hada_plot *plot, double x, double y, char anchor, const char *text);

/* In pixels of the figure. anchor: 'l', 'm' or 'r', which part of the text stands there. */
void hada_plot_text(hada_plot *plot, double x, double y, char anchor, double size, const char *text);
/* A line of the legend: a mark, or a box where mark is NULL, or a line where box is NULL as well; returns the x where
 * the next entry may begin. */
double hada_plot_legend(hada_plot *plot, double x, double y, const hada_plot_mark *mark, const char *box,
                        const char *text);
/* About how wide a text is. */
double hada_plot_text_width(const char *text, double size);

/* Writes beside the file and renames; the figure is destroyed also on failure. path NULL: memory was out for it. */
hada_status hada_plot_save(hada_plot **plot, const char *path, hada_error *err);

#endif
