/* Hadalens: frames without a header, as cameras write them into files and pipes (rpicam-raw, Picamera2, V4L2,
 * GStreamer): nothing in such a file says how large a frame is, so the caller does.
 *
 * Thread-safe. */
#ifndef HADALENS_HEADERLESS_H
#define HADALENS_HEADERLESS_H

#include <hadalens/status.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Says how this process reads files of no known format: as frames of "HxW:PIXELS" or "HxW:PIXELS:ROWBYTES"; NULL: not
 * at all (the default). PIXELS is one of
 *   u8            a byte for each pixel
 *   u10, u12, u14, u16  two bytes, the lower one first; the value in their lower bits, full scale 2^bits - 1
 *   csi10, csi12  packed as MIPI CSI-2 (and libcamera's ..._CSI2P) has it: 4 pixels in 5 bytes, 2 pixels in 3 bytes
 *   rgb8          three bytes: red, green, blue
 * ROWBYTES is from row to row; without it rows have no gaps, or begin at multiples of 16, 32 or 64 bytes where only
 * that fits the file's size. HADA_ERROR_ARGUMENT where the text is not understood. */
HADA_API hada_status hada_headerless_set(const char *text, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
