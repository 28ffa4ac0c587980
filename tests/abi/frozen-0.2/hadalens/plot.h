/* Hadalens: figures with axes, points, lines, bars, and labels that keep out of each other's way, as SVG or PNG.
 *
 * Everything is drawn in order and written by hada_plot_save(); a failure on the way is told there. Lengths are pixels
 * of the figure, y runs down; colours are sRGB, 0xRRGGBB; texts are UTF-8 and copied. One figure is used by one thread
 * at a time. A build without cairo has no pictures (hada_pictures_available() in preview.h): hada_plot_create() says so
 * with HADA_ERROR_UNSUPPORTED, and NULL for a plot is taken by every call and does nothing. */
#ifndef HADALENS_PLOT_H
#define HADALENS_PLOT_H

#include <hadalens/status.h>

#ifdef __cplusplus
extern "C" {
#endif

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
    unsigned colour;
    double radius; /* pixels */
    int hollow, crossed;
} hada_plot_mark;

/* Colours that people with any colour vision tell apart: M. Okabe, K. Ito, "Color universal design" (2008). */
HADA_API unsigned hada_plot_colour(int index); /* 0 to 7, then again from the first */

/* For hada_plot_legend(): no box. */
#define HADA_PLOT_NO_COLOUR 0xffffffffu

/* Rounded limits that hold all values (NaN left out; logarithmic: those above 0 only). */
HADA_API hada_plot_axis hada_plot_axis_for(const double *values, int count, int logarithmic, const char *label);

HADA_API hada_status hada_plot_create(hada_plot **out, double width, double height, hada_error *err);
HADA_API void hada_plot_destroy(hada_plot **plot);
HADA_API void hada_plot_panel_begin(hada_plot *plot, const hada_plot_panel *panel);
/* Places the labels of the panel; needed after the last of its points. */
HADA_API void hada_plot_panel_end(hada_plot *plot);

/* In the units of the panel's axes. */
HADA_API void hada_plot_line(hada_plot *plot, const double *x, const double *y, int count, unsigned colour, int dashed);
HADA_API void hada_plot_point(hada_plot *plot, double x, double y, const hada_plot_mark *mark);
HADA_API void hada_plot_bar(hada_plot *plot, double x0, double x1, double y0, double y1, unsigned colour);
HADA_API void hada_plot_whisker(hada_plot *plot, double low, double high, double y); /* across */
/* Beside the point, where there is room. */
HADA_API void hada_plot_label(hada_plot *plot, double x, double y, const char *text);

/* A text within the panel that labels keep out of; pixels and anchor as in hada_plot_text. */
HADA_API void hada_plot_note(hada_plot *plot, double x, double y, char anchor, const char *text);

/* In pixels of the figure. anchor: 'l', 'm' or 'r', which part of the text stands there. */
HADA_API void hada_plot_text(hada_plot *plot, double x, double y, char anchor, double size, const char *text);
/* A line of the legend: a mark, or a box where mark is NULL, or a line where box is HADA_PLOT_NO_COLOUR as well;
 * returns the x where the next entry may begin. */
HADA_API double hada_plot_legend(hada_plot *plot, double x, double y, const hada_plot_mark *mark, unsigned box,
                                 const char *text);
/* Writes NAME.svg or NAME.png, beside the file and renamed; the figure stays as it is. */
HADA_API hada_status hada_plot_save(const hada_plot *plot, const char *path, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
