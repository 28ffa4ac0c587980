/* Hadalens: PNG pictures that a person can read at a glance. Written beside the file and renamed.
 *
 * Any thread may call; a call holds nothing afterwards. There are no pictures without cairo, which is loaded
 * when the first one is drawn: HADA_ERROR_UNSUPPORTED. */
#ifndef HADALENS_PREVIEW_H
#define HADALENS_PREVIEW_H

#include <hadalens/image.h>

#ifdef __cplusplus
extern "C" {
#endif

/* 1: previews and plots can be drawn; 0: cairo was missing when the library was built, or is not installed. */
HADA_API int hada_pictures_available(void);

/* What a preview shows; NULL parts are left out. */
typedef struct hada_preview {
    size_t size;              /* sizeof(hada_preview) */
    const char *title;        /* "NAME, MODEL" */
    const hada_image *raw;    /* the frame */
    const hada_image *planes; /* `depths` refocused images, near to far */
    int depths;
    const double *distances_mm;
    const unsigned char *occupied; /* per depth: 1 where the scene was found; NULL: not known */
    const hada_image *all_in_focus;
    const hada_image *distance_map; /* millimetres, NaN where nothing is in focus */
    double gamma;                   /* exponent for showing linear intensities, above 0; HADA_AUTO (default): sRGB */
    int volume; /* 1: light at all depths: in place of the all-in-focus image and the distance map, projections of the
                   planes: the brightest voxel of each pixel, and the same in the colour of its distance; 0 (default) */
} hada_preview;
HADA_INIT(hada_preview, HADA_STRUCT_PREVIEW)

/* One sheet: raw, all-in-focus, distance map with colour map and scale bar, and the stack as a contact sheet with
 * distances (occupied planes marked). */
HADA_API hada_status hada_preview_save(const char *path, const hada_preview *preview, hada_error *err);

/* One image as PNG; linear intensities are shown as (value / white)^gamma; gamma HADA_AUTO: as sRGB;
 * white HADA_AUTO: the 99.9th percentile. */
HADA_API hada_status hada_png_save(const char *path, const hada_image *image, double white, double gamma,
                                   hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
