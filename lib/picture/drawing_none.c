/* The sheet of a build without cairo: there is none, and it says so. */
#include "picture/drawing.h"

#include <hadalens/preview.h>

int hada_pictures_available(void)
{
    return 0;
}

hada_status hada_drawing_create(hada_drawing **out, double width, double height, hada_colour paper, hada_error *err)
{
    (void)width;
    (void)height;
    (void)paper;
    *out = NULL;
    return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                     "this build of the library draws no pictures: cairo was missing when it was built (Debian: "
                     "libcairo2-dev)");
}

void hada_drawing_destroy(hada_drawing **drawing)
{
    *drawing = NULL;
}

/* No sheet, so nobody comes here. */
#define NOTHING(declaration)                                                                                           \
    declaration                                                                                                        \
    {                                                                                                                  \
    }
#pragma GCC diagnostic ignored "-Wunused-parameter"
NOTHING(void hada_drawing_fill(hada_drawing *d, double x, double y, double w, double h, hada_colour c))
NOTHING(void hada_drawing_frame(hada_drawing *d, double x, double y, double w, double h, double t, hada_colour c))
NOTHING(void hada_drawing_line(hada_drawing *d, const double *p, int n, hada_colour c, double t, int dashed))
NOTHING(void hada_drawing_polygon(hada_drawing *d, const double *p, int n, hada_colour f, hada_colour e, double t))
NOTHING(void hada_drawing_disc(hada_drawing *d, double x, double y, double r, hada_colour f, hada_colour e, double t))
NOTHING(void hada_drawing_pixels(hada_drawing *d, int x, int y, int w, int h, const uint32_t *pixels))
NOTHING(void hada_drawing_text_up(hada_drawing *d, double x, double y, double s, hada_colour c, const char *text))
NOTHING(void hada_drawing_clip(hada_drawing *d, double x, double y, double w, double h))
NOTHING(void hada_drawing_unclip(hada_drawing *d))

double hada_drawing_text(hada_drawing *d, double x, double y, hada_anchor anchor, double size, double limit,
                         hada_colour colour, const char *text)
{
    return 0.0;
}

double hada_drawing_text_width(hada_drawing *d, double size, const char *text)
{
    return 0.0;
}

hada_status hada_drawing_save(hada_drawing *d, const char *path, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_UNSUPPORTED, "%s: this build of the library draws no pictures", path);
}
