/* Files that are not TIFF, written: JPEG pictures, frames as cameras have them, NumPy arrays. Internal. */
#ifndef HADA_IO_ENCODE_H
#define HADA_IO_ENCODE_H

#include <hadalens/image.h>

#include "core/outfile.h"

/* JPEG pictures, by TurboJPEG, which is loaded when the first one is written. */

hada_status hada_jpeg_begin(void **encoder, hada_error *err);
/* The most bytes that a picture takes. */
size_t hada_jpeg_room(int rows, int cols);
/* Of bytes red, green, blue. *bytes: how many of `out`, which has room for the most, were written. */
hada_status hada_jpeg_encode(void *encoder, const unsigned char *rgb, int rows, int cols, unsigned char *out,
                             size_t *bytes, hada_error *err);
void hada_jpeg_end(void *encoder);

/* Frames in files such as cameras and programs write them: DNG, packed pixels without a header. */

/* A sensor's values from 0 to 1 in 16 bits. One channel, with the colours that `mosaic` says; black is 0 of light. */
hada_status hada_dng_save(const char *path, const hada_image *image, hada_mosaic mosaic, double black, hada_error *err);

/* 12 bits, packed as MIPI CSI-2 has it, in rows of whole HADA_PACKED_ALIGNMENT bytes; one channel. */
enum { HADA_PACKED_ALIGNMENT = 32 };
hada_status hada_packed12_save(const char *path, const hada_image *image, hada_error *err);

/* NumPy arrays (.npy) written image by image. */

/* How values are written: as they are in 32 bits (floats); in 8 and 16 bits, 0 to `white` becomes 0 to full scale. */
typedef struct hada_numpy_values {
    int bits;
    double white;
    double encoding; /* of what hada_numpy_add() is told is light (hadalens/response.h); 0: none */
} hada_numpy_values;

typedef struct hada_numpy_writer {
    hada_outfile file;
    hada_numpy_values values;
    int is_open;
} hada_numpy_writer;

enum { HADA_NUMPY_DIMENSIONS = 8 };

/* `shape`: of the whole array, whose images (rows, cols, channels) are added one after the other. */
hada_status hada_numpy_begin(hada_numpy_writer *writer, const char *path, const uint64_t *shape, int dimensions,
                             const hada_numpy_values *values, hada_error *err);
hada_status hada_numpy_add(hada_numpy_writer *writer, const hada_image *image, int is_light, hada_error *err);
/* Gives the file its name; nothing where none is open. */
hada_status hada_numpy_finish(hada_numpy_writer *writer, hada_error *err);
void hada_numpy_abandon(hada_numpy_writer *writer);

/* One image: (rows, cols), or (rows, cols, channels); in 16 bits, 0 to 1 is the full scale. */
hada_status hada_numpy_save(const char *path, const hada_image *image, int bits, hada_error *err);

#endif
