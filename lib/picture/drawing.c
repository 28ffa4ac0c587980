#include "picture/drawing.h"

#include <cairo-svg.h>
#include <cairo.h>
#include <hadalens/preview.h>

#include "core/library.h"
#include "core/outfile.h"

#ifdef __APPLE__
#define CAIRO_FILE "libcairo.2.dylib"
#else
#define CAIRO_FILE "libcairo.so.2"
#endif

/* cairo is loaded when the first picture is drawn: it brings twenty libraries, whose loading costs a millisecond at
 * each start of a program, and another when an OpenCL platform is loaded behind them, and most programs draw nothing.
 */

/* Those that are used, without "cairo_". */
#define CAIRO_FUNCTIONS(EACH)                                                                                          \
    EACH(arc)                                                                                                          \
    EACH(clip)                                                                                                         \
    EACH(close_path)                                                                                                   \
    EACH(create)                                                                                                       \
    EACH(destroy)                                                                                                      \
    EACH(fill)                                                                                                         \
    EACH(fill_preserve)                                                                                                \
    EACH(get_source)                                                                                                   \
    EACH(image_surface_create)                                                                                         \
    EACH(image_surface_get_data)                                                                                       \
    EACH(image_surface_get_stride)                                                                                     \
    EACH(line_to)                                                                                                      \
    EACH(move_to)                                                                                                      \
    EACH(new_path)                                                                                                     \
    EACH(paint)                                                                                                        \
    EACH(pattern_set_filter)                                                                                           \
    EACH(recording_surface_create)                                                                                     \
    EACH(rectangle)                                                                                                    \
    EACH(restore)                                                                                                      \
    EACH(rotate)                                                                                                       \
    EACH(save)                                                                                                         \
    EACH(select_font_face)                                                                                             \
    EACH(set_dash)                                                                                                     \
    EACH(set_font_size)                                                                                                \
    EACH(set_line_join)                                                                                                \
    EACH(set_line_width)                                                                                               \
    EACH(set_source_rgb)                                                                                               \
    EACH(set_source_surface)                                                                                           \
    EACH(show_text)                                                                                                    \
    EACH(status)                                                                                                       \
    EACH(status_to_string)                                                                                             \
    EACH(stroke)                                                                                                       \
    EACH(surface_destroy)                                                                                              \
    EACH(surface_finish)                                                                                               \
    EACH(surface_mark_dirty)                                                                                           \
    EACH(surface_status)                                                                                               \
    EACH(surface_write_to_png_stream)                                                                                  \
    EACH(svg_surface_create_for_stream)                                                                                \
    EACH(svg_surface_set_document_unit)                                                                                \
    EACH(text_extents)                                                                                                 \
    EACH(translate)

/* There once a drawing was made, until the process ends. */
static struct {
/* a declaration: its name cannot be in parentheses */
#define MEMBER(name) __typeof__(cairo_##name) *name; /* NOLINT(bugprone-macro-parentheses) */
    CAIRO_FUNCTIONS(MEMBER)
#undef MEMBER
} api;

static const hada_symbol symbols[] = {
#define ROW(name) HADA_SYMBOL(api.name, "cairo_" #name),
    CAIRO_FUNCTIONS(ROW)
#undef ROW
};

/* Never closed: cairo keeps fonts until the process ends. */
static hada_library library = {CAIRO_FILE, "no pictures can be drawn", "libcairo2", symbols, HADA_COUNT(symbols), 0};

/* The sheet, on cairo. */

#define PI 3.14159265358979323846

struct hada_drawing {
    double width, height;
    cairo_surface_t *record; /* what is drawn, for whichever kind of file */
    cairo_t *cairo;
};

int hada_pictures_available(void)
{
    return hada_library_load(&library, NULL) == HADA_OK;
}

static hada_status fail(hada_error *err, cairo_status_t code, const char *what)
{
    return hada_fail(err, code == CAIRO_STATUS_NO_MEMORY ? HADA_ERROR_MEMORY : HADA_ERROR_SIZE, "%s: %s", what,
                     api.status_to_string(code));
}

static void set_colour(cairo_t *cairo, hada_colour colour)
{
    api.set_source_rgb(cairo, (colour >> 16 & 255) / 255.0, (colour >> 8 & 255) / 255.0, (colour & 255) / 255.0);
}

hada_status hada_drawing_create(hada_drawing **out, double width, double height, hada_colour paper, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_drawing *drawing = NULL;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_library_load(&library, err));
    HADA_TRY_OR_DONE(HADA_NEW(drawing, 1, "a picture", err));
    const cairo_rectangle_t extents = {0, 0, width, height};
    drawing->width = width;
    drawing->height = height;
    drawing->record = api.recording_surface_create(CAIRO_CONTENT_COLOR, &extents);
    drawing->cairo = api.create(drawing->record);
    if (api.status(drawing->cairo) != CAIRO_STATUS_SUCCESS)
        HADA_TRY_OR_DONE(fail(err, api.status(drawing->cairo), "a picture"));
    api.select_font_face(drawing->cairo, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    api.set_line_join(drawing->cairo, CAIRO_LINE_JOIN_ROUND);
    hada_drawing_fill(drawing, 0, 0, width, height, paper);
    *out = drawing;
    drawing = NULL;
done:
    hada_drawing_destroy(&drawing);
    return status;
}

void hada_drawing_destroy(hada_drawing **pointer)
{
    hada_drawing *drawing = hada_taken(pointer);
    if (!drawing)
        return;
    if (drawing->cairo)
        api.destroy(drawing->cairo);
    if (drawing->record)
        api.surface_destroy(drawing->record);
    free(drawing);
}

void hada_drawing_fill(hada_drawing *drawing, double x, double y, double width, double height, hada_colour colour)
{
    set_colour(drawing->cairo, colour);
    api.rectangle(drawing->cairo, x, y, width, height);
    api.fill(drawing->cairo);
}

void hada_drawing_frame(hada_drawing *drawing, double x, double y, double width, double height, double thick,
                        hada_colour colour)
{
    set_colour(drawing->cairo, colour);
    api.set_line_width(drawing->cairo, thick);
    api.rectangle(drawing->cairo, x - thick / 2, y - thick / 2, width + thick, height + thick);
    api.stroke(drawing->cairo);
}

static void path(cairo_t *cairo, const double *points, int count)
{
    for (int i = 0; i < count; i++)
        api.line_to(cairo, points[2 * i], points[2 * i + 1]);
}

void hada_drawing_line(hada_drawing *drawing, const double *points, int count, hada_colour colour, double thick,
                       int dashed)
{
    static const double dashes[] = {5, 3};
    set_colour(drawing->cairo, colour);
    api.set_line_width(drawing->cairo, thick);
    api.set_dash(drawing->cairo, dashes, dashed ? 2 : 0, 0);
    path(drawing->cairo, points, count);
    api.stroke(drawing->cairo);
    api.set_dash(drawing->cairo, NULL, 0, 0);
}

static void fill_and_edge(cairo_t *cairo, hada_colour fill, hada_colour edge, double thick)
{
    set_colour(cairo, fill);
    api.fill_preserve(cairo);
    set_colour(cairo, edge);
    api.set_line_width(cairo, thick);
    api.stroke(cairo);
}

void hada_drawing_polygon(hada_drawing *drawing, const double *points, int count, hada_colour fill, hada_colour edge,
                          double thick)
{
    path(drawing->cairo, points, count);
    api.close_path(drawing->cairo);
    fill_and_edge(drawing->cairo, fill, edge, thick);
}

void hada_drawing_disc(hada_drawing *drawing, double x, double y, double radius, hada_colour fill, hada_colour edge,
                       double thick)
{
    api.arc(drawing->cairo, x, y, radius, 0, 2 * PI);
    api.close_path(drawing->cairo);
    fill_and_edge(drawing->cairo, fill, edge, thick);
}

void hada_drawing_pixels(hada_drawing *drawing, int x, int y, int width, int height, const uint32_t *pixels)
{
    cairo_surface_t *image = api.image_surface_create(CAIRO_FORMAT_RGB24, width, height);
    unsigned char *to = api.image_surface_get_data(image); /* NULL where the surface failed */
    const int stride = api.image_surface_get_stride(image);
    for (int row = 0; to && row < height; row++)
        memcpy(to + (size_t)row * (size_t)stride, pixels + (size_t)row * (size_t)width, (size_t)width * sizeof *pixels);
    api.surface_mark_dirty(image);
    /* a failed surface fails the drawing with its own code */
    api.set_source_surface(drawing->cairo, image, x, y);
    api.pattern_set_filter(api.get_source(drawing->cairo), CAIRO_FILTER_NEAREST);
    api.paint(drawing->cairo);
    api.surface_destroy(image);
}

static int is_continuation(char byte)
{
    return ((unsigned char)byte & 0xc0u) == 0x80u;
}

/* Bytes of the character that begins here, 0 where it is none of UTF-8 (RFC 3629: none too long, no surrogates). */
static size_t character(const char *at)
{
    const unsigned char *b = (const unsigned char *)at;
    const size_t bytes = b[0] < 0x80 ? 1 : b[0] < 0xc2 ? 0 : b[0] < 0xe0 ? 2 : b[0] < 0xf0 ? 3 : b[0] < 0xf5 ? 4 : 0;
    for (size_t i = 1; i < bytes; i++)
        if (!is_continuation(at[i]))
            return 0;
    const int wrong = bytes > 2 && ((b[0] == 0xe0 && b[1] < 0xa0) || (b[0] == 0xed && b[1] > 0x9f) ||
                                    (b[0] == 0xf0 && b[1] < 0x90) || (b[0] == 0xf4 && b[1] > 0x8f));
    return wrong ? 0 : bytes;
}

/* A text as it can be drawn: what is no UTF-8, and controls, are question marks; longer ones than any sheet is wide are
 * cut between two characters. */
typedef struct shown_text {
    char text[512];
} shown_text;

static void show(shown_text *shown, const char *text)
{
    size_t length = 0;
    for (size_t bytes; *text && length < sizeof shown->text - 8; text += bytes) { /* room for the longest, dots, NUL */
        const size_t found = character(text);
        bytes = found ? found : 1;
        if (found && (found > 1 || ((unsigned char)*text >= ' ' && *text != 0x7f))) {
            memcpy(shown->text + length, text, bytes);
            length += bytes;
        } else {
            shown->text[length++] = '?';
        }
    }
    shown->text[length] = '\0';
}

static double width_of(hada_drawing *drawing, double size, const char *text)
{
    cairo_text_extents_t extents = {0};
    api.set_font_size(drawing->cairo, size);
    api.text_extents(drawing->cairo, text, &extents);
    return extents.x_advance;
}

double hada_drawing_text_width(hada_drawing *drawing, double size, const char *text)
{
    shown_text shown;
    show(&shown, text);
    return width_of(drawing, size, shown.text);
}

/* The longest beginning that has room for an ellipsis behind it. */
static void cut(hada_drawing *drawing, char *text, size_t room, double size, double limit)
{
    static const char dots[] = "\xe2\x80\xa6";
    size_t length = strlen(text);
    do {
        while (length && is_continuation(text[--length]))
            ;
        if (length + sizeof dots <= room)
            memcpy(text + length, dots, sizeof dots);
    } while (length && width_of(drawing, size, text) > limit);
}

double hada_drawing_text(hada_drawing *drawing, double x, double y, hada_anchor anchor, double size, double limit,
                         hada_colour colour, const char *text)
{
    shown_text shown;
    show(&shown, text);
    double width = width_of(drawing, size, shown.text);
    if (limit > 0.0 && width > limit) {
        cut(drawing, shown.text, sizeof shown.text, size, limit);
        width = width_of(drawing, size, shown.text);
    }
    set_colour(drawing->cairo, colour);
    api.move_to(drawing->cairo,
                anchor == HADA_ANCHOR_LEFT    ? x
                : anchor == HADA_ANCHOR_RIGHT ? x - width
                                              : x - width / 2,
                y);
    api.show_text(drawing->cairo, shown.text);
    api.new_path(drawing->cairo);
    return width;
}

void hada_drawing_text_up(hada_drawing *drawing, double x, double y, double size, hada_colour colour, const char *text)
{
    api.save(drawing->cairo);
    api.translate(drawing->cairo, x, y);
    api.rotate(drawing->cairo, -PI / 2);
    hada_drawing_text(drawing, 0, 0, HADA_ANCHOR_MIDDLE, size, 0.0, colour, text);
    api.restore(drawing->cairo);
}

void hada_drawing_clip(hada_drawing *drawing, double x, double y, double width, double height)
{
    api.save(drawing->cairo);
    api.rectangle(drawing->cairo, x, y, width, height);
    api.clip(drawing->cairo);
}

void hada_drawing_unclip(hada_drawing *drawing)
{
    api.restore(drawing->cairo);
}

/* A file that cairo writes into, and what went wrong with it. */
typedef struct sink {
    hada_outfile file;
    hada_status status;
    hada_error *err;
} sink;

static cairo_status_t write_bytes(void *closure, const unsigned char *data, unsigned length)
{
    sink *to = closure;
    if (!to->status)
        to->status = hada_outfile_write(&to->file, data, length, to->err);
    return to->status ? CAIRO_STATUS_WRITE_ERROR : CAIRO_STATUS_SUCCESS;
}

/* What was recorded onto another surface. */
static cairo_status_t replay(const hada_drawing *drawing, cairo_surface_t *onto)
{
    cairo_t *cairo = api.create(onto);
    api.set_source_surface(cairo, drawing->record, 0, 0);
    api.paint(cairo);
    const cairo_status_t code = api.status(cairo);
    api.destroy(cairo);
    return code;
}

static cairo_status_t write_png(const hada_drawing *drawing, sink *to)
{
    cairo_surface_t *image =
        api.image_surface_create(CAIRO_FORMAT_RGB24, (int)(drawing->width + 0.5), (int)(drawing->height + 0.5));
    cairo_status_t code = replay(drawing, image);
    if (code == CAIRO_STATUS_SUCCESS)
        code = api.surface_write_to_png_stream(image, write_bytes, to);
    api.surface_destroy(image);
    return code;
}

static cairo_status_t write_svg(const hada_drawing *drawing, sink *to)
{
    cairo_surface_t *svg = api.svg_surface_create_for_stream(write_bytes, to, drawing->width, drawing->height);
    api.svg_surface_set_document_unit(svg, CAIRO_SVG_UNIT_PX);
    cairo_status_t code = replay(drawing, svg);
    api.surface_finish(svg); /* writes what is left */
    if (code == CAIRO_STATUS_SUCCESS)
        code = api.surface_status(svg);
    api.surface_destroy(svg);
    return code;
}

hada_status hada_drawing_save(hada_drawing *drawing, const char *path_to, hada_error *err)
{
    hada_status status = HADA_OK;
    sink to = {.err = err};
    int open = 0;
    const char *dot = strrchr(path_to, '.');
    const cairo_status_t drawn = api.status(drawing->cairo);
    if (drawn != CAIRO_STATUS_SUCCESS)
        HADA_TRY_OR_DONE(fail(err, drawn, path_to));
    if (!dot || (strcmp(dot, ".png") && strcmp(dot, ".svg")))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "%s: pictures are written as .png or .svg", path_to));
    HADA_TRY_OR_DONE(hada_outfile_open(&to.file, path_to, err));
    open = 1;
    const cairo_status_t code = strcmp(dot, ".svg") ? write_png(drawing, &to) : write_svg(drawing, &to);
    HADA_TRY_OR_DONE(to.status);
    if (code != CAIRO_STATUS_SUCCESS)
        HADA_TRY_OR_DONE(fail(err, code, path_to));
    open = 0;
    HADA_TRY_OR_DONE(hada_outfile_commit(&to.file, err));
done:
    if (open)
        hada_outfile_abandon(&to.file);
    return status;
}
