/* cairo, loaded when the first picture is drawn. Internal.
 *
 * cairo brings twenty libraries: loading them costs a millisecond at each start of a program, and another when an
 * OpenCL platform is loaded behind them, and most programs draw nothing. */
#ifndef HADA_PICTURE_CAIRO_FUNCTIONS_H
#define HADA_PICTURE_CAIRO_FUNCTIONS_H

#include <cairo-svg.h>
#include <cairo.h>

#include "core/base.h"

/* Those that are used, without "cairo_". */
#define HADA_CAIRO_FUNCTIONS(EACH)                                                                                     \
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

typedef struct hada_cairo {
/* a declaration: its name cannot be in parentheses */
#define HADA_CAIRO_MEMBER(name) __typeof__(cairo_##name) *name; /* NOLINT(bugprone-macro-parentheses) */
    HADA_CAIRO_FUNCTIONS(HADA_CAIRO_MEMBER)
#undef HADA_CAIRO_MEMBER
} hada_cairo;

/* There once a drawing was made, until the process ends. */
extern hada_cairo hada_cairo_api;

#endif
