/* Frames in files such as cameras and programs write them: DNG, packed pixels without a header. Internal. */
#ifndef HADA_IO_ENCODE_FRAMES_H
#define HADA_IO_ENCODE_FRAMES_H

#include <hadalens/image.h>

/* A sensor's values from 0 to 1 in 16 bits. One channel, with the colours that `mosaic` says; black is 0 of light. */
hada_status hada_dng_save(const char *path, const hada_image *image, hada_mosaic mosaic, double black, hada_error *err);

/* 12 bits, packed as MIPI CSI-2 has it, in rows of whole HADA_PACKED_ALIGNMENT bytes; one channel. */
enum { HADA_PACKED_ALIGNMENT = 32 };
hada_status hada_packed12_save(const char *path, const hada_image *image, hada_error *err);

#endif
