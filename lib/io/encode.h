/* JPEG pictures, by TurboJPEG, which is loaded when the first one is written. Internal. */
#ifndef HADA_IO_ENCODE_H
#define HADA_IO_ENCODE_H

#include "core/base.h"

hada_status hada_jpeg_begin(void **encoder, hada_error *err);
/* The most bytes that a picture takes. */
size_t hada_jpeg_room(int rows, int cols);
/* Of bytes red, green, blue. *bytes: how many of `out`, which has room for the most, were written. */
hada_status hada_jpeg_encode(void *encoder, const unsigned char *rgb, int rows, int cols, unsigned char *out,
                             size_t *bytes, hada_error *err);
void hada_jpeg_end(void *encoder);

#endif
