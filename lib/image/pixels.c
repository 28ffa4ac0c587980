#include "image/pixels.h"

#include <math.h>

#include "core/alloc.h"
#include "core/callers.h"

/* Most values of a row or a column: as of a TIFF file. */
#define MOST (1 << 24)

void hada_pixels_defaults(hada_pixels *pixels, size_t size)
{
    const hada_pixels own = {.size = sizeof own, .full_scale = HADA_AUTO};
    HADA_OPTIONS_GIVE(pixels, size, &own);
}

static ptrdiff_t bytes_of(hada_pixel_type type)
{
    return type == HADA_PIXEL_U8 ? 1 : type == HADA_PIXEL_U16 ? 2 : 4;
}

static void set(hada_pixels *pixels, const void *data, hada_pixel_type type, int channels, int rows, int cols)
{
    pixels->data = data;
    pixels->type = type;
    pixels->channels = channels;
    pixels->rows = rows;
    pixels->cols = cols;
}

void hada_pixels_planar(hada_pixels *pixels, const void *data, hada_pixel_type type, int channels, int rows, int cols)
{
    set(pixels, data, type, channels, rows, cols);
    pixels->col_stride = bytes_of(type);
    pixels->row_stride = pixels->col_stride * cols;
    pixels->channel_stride = pixels->row_stride * rows;
}

void hada_pixels_interleaved(hada_pixels *pixels, const void *data, hada_pixel_type type, int channels, int rows,
                             int cols)
{
    set(pixels, data, type, channels, rows, cols);
    pixels->channel_stride = bytes_of(type);
    pixels->col_stride = pixels->channel_stride * channels;
    pixels->row_stride = pixels->col_stride * cols;
}

void hada_pixels_of_image(hada_pixels *pixels, const hada_image *image)
{
    hada_pixels_planar(pixels, image->data, HADA_PIXEL_F32, image->channels, image->rows, image->cols);
}

hada_status hada_pixels_take(hada_pixels *own, const hada_pixels *callers, hada_error *err)
{
    if (!callers)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "pixels are needed: start from hada_pixels_init()");
    hada_pixels_init(own);
    hada_status status = HADA_OPTIONS_TAKE(own, callers, hada_pixels, err);
    if (status)
        return status;
    if (!own->data || own->type < HADA_PIXEL_U8 || own->type > HADA_PIXEL_F32 || own->channels < 1 || own->rows < 1 ||
        own->cols < 1 || own->channels > 4096 || own->rows > MOST || own->cols > MOST)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "pixels of kind %d, %d channels of %d x %d%s cannot be read: set data, type and sizes",
                         (int)own->type, own->channels, own->rows, own->cols, own->data ? "" : ", without data");
    if (own->full_scale != HADA_AUTO && !(own->full_scale > 0.0 && isfinite(own->full_scale)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a full scale of %g is not possible; it is above 0",
                         own->full_scale);
    const ptrdiff_t align = bytes_of(own->type);
    if ((uintptr_t)own->data % (uintptr_t)align || own->channel_stride % align || own->row_stride % align ||
        own->col_stride % align)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "pixels of %d bytes stand at places that are no multiple of that",
                         (int)align);
    return HADA_OK;
}

static int is_image(const hada_pixels *p)
{
    return p->type == HADA_PIXEL_F32 && p->col_stride == (ptrdiff_t)sizeof(float) &&
           p->row_stride == p->col_stride * p->cols && p->channel_stride == p->row_stride * p->rows;
}

/* A row of samples; integers divide in float, where both numbers are exact (io/tiff_sample.c does the same). */
#define ROW(type, divisor)                                                                                             \
    do {                                                                                                               \
        const ptrdiff_t stride = p->col_stride / (ptrdiff_t)sizeof(type);                                              \
        const type *from = (const type *)(const void *)at;                                                             \
        for (int col = 0; col < p->cols; col++)                                                                        \
            out[col] = (float)from[col * stride] / (divisor);                                                          \
    } while (0)

static void convert_row(const hada_pixels *p, const unsigned char *at, float *out)
{
    if (p->type == HADA_PIXEL_U8)
        ROW(uint8_t, p->full_scale == HADA_AUTO ? 255.0f : (float)p->full_scale);
    else if (p->type == HADA_PIXEL_U16)
        ROW(uint16_t, p->full_scale == HADA_AUTO ? 65535.0f : (float)p->full_scale);
    else
        ROW(float, 1.0f);
}

static void convert(const hada_pixels *p, float *out)
{
    for (int channel = 0; channel < p->channels; channel++)
        for (int row = 0; row < p->rows; row++, out += p->cols)
            convert_row(p, (const unsigned char *)p->data + channel * p->channel_stride + row * p->row_stride, out);
}

hada_status hada_pixels_view(const hada_pixels *pixels, hada_image *own, hada_image *view, hada_error *err)
{
    *view = (hada_image){pixels->channels, pixels->rows, pixels->cols, NULL};
    if (is_image(pixels)) {
        view->data = (float *)pixels->data; /* only read */
        return HADA_OK;
    }
    const size_t values = hada_image_count(view);
    if (!own->data || hada_image_count(own) != values) {
        hada_image_destroy(own);
        HADA_TRY(hada_allocated(own->data = hada_alloc_raw(values, sizeof(float), "a frame", err)));
    }
    view->data = own->data;
    *own = *view;
    convert(pixels, own->data);
    return HADA_OK;
}

hada_status hada_pixels_to_image(const hada_pixels *pixels, hada_image *image, hada_error *err)
{
    hada_pixels own;
    if (!image)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_pixels_to_image: an image is needed");
    *image = (hada_image){0};
    HADA_TRY(hada_pixels_take(&own, pixels, err));
    HADA_TRY(hada_image_create(image, own.channels, own.rows, own.cols, err));
    convert(&own, image->data);
    return HADA_OK;
}
