/* Hadalens: pixels as people have them: 8 or 16-bit integers or floats, in any order, with any strides.
 *
 * A view of memory that is and stays the caller's. Values become those that reading the same numbers from a TIFF file
 * gives, bit for bit: integers are divided by their full scale, floats are taken as they are (linear intensity).
 *
 * Threads: no state. */
#ifndef HADALENS_PIXELS_H
#define HADALENS_PIXELS_H

#include <hadalens/image.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_pixel_type {
    HADA_PIXEL_U8 = 1,  /* uint8_t, full scale 255 */
    HADA_PIXEL_U16 = 2, /* uint16_t in the machine's byte order, full scale 65535 */
    HADA_PIXEL_F32 = 3  /* float */
} hada_pixel_type;

/* Where the sample of (channel, row, col) stands: data + channel * channel_stride + row * row_stride + col *
 * col_stride, in bytes; strides may be negative, or 0 where there is one of a kind; samples do not lie on each other.
 * Begin with hada_pixels_init(). */
typedef struct hada_pixels {
    size_t size; /* sizeof(hada_pixels) */
    const void *data;
    hada_pixel_type type;
    int channels, rows, cols;
    ptrdiff_t channel_stride, row_stride, col_stride;
    double full_scale; /* of integers, above 0; HADA_AUTO (default): of the type. A camera of 12 bits that fills the
                          lower bits of 16 has 4095 */
} hada_pixels;
HADA_INIT(hada_pixels, HADA_STRUCT_PIXELS)

/* Sets strides for dense samples: all of a channel together (planar), or all channels of a pixel (interleaved). */
static inline void hada_pixels_dense(hada_pixels *pixels, const void *data, hada_pixel_type type, int interleaved,
                                     int channels, int rows, int cols)
{
    const ptrdiff_t sample = type == HADA_PIXEL_U8 ? 1 : type == HADA_PIXEL_U16 ? 2 : 4;
    pixels->data = data;
    pixels->type = type;
    pixels->channels = channels;
    pixels->rows = rows;
    pixels->cols = cols;
    pixels->col_stride = interleaved ? sample * channels : sample;
    pixels->row_stride = pixels->col_stride * cols;
    pixels->channel_stride = interleaved ? sample : pixels->row_stride * rows;
}
static inline void hada_pixels_planar(hada_pixels *pixels, const void *data, hada_pixel_type type, int channels,
                                      int rows, int cols)
{
    hada_pixels_dense(pixels, data, type, 0, channels, rows, cols);
}
static inline void hada_pixels_interleaved(hada_pixels *pixels, const void *data, hada_pixel_type type, int channels,
                                           int rows, int cols)
{
    hada_pixels_dense(pixels, data, type, 1, channels, rows, cols);
}

/* A view of an image. */
static inline void hada_pixels_of_image(hada_pixels *pixels, const hada_image *image)
{
    hada_pixels_planar(pixels, image->data, HADA_PIXEL_F32, image->channels, image->rows, image->cols);
}

/* The floats that these pixels are: *image is created by the call. HADA_ERROR_ARGUMENT for what cannot be pixels. */
HADA_API hada_status hada_pixels_to_image(const hada_pixels *pixels, hada_image *image, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
