/* Files that are not TIFF: PNG, JPEG, NumPy arrays, MATLAB files, cameras' raw files. They are recognised by their
 * content. All but NumPy arrays are decoded whole, by libraries that are loaded when such a file is first read.
 * Internal. */
#ifndef HADA_IO_DECODE_H
#define HADA_IO_DECODE_H

#include <hadalens/pixels.h>

#include "core/library.h"
#include "io/tiff_page.h"

/* Frames without a header: one after the other, as cameras write them into files and pipes. */

typedef enum hada_packing {
    HADA_PACKING_NONE = 0, /* a byte for each sample, or two, the lower one first */
    HADA_PACKING_CSI10,    /* 4 samples in 5 bytes: the upper 8 bits of each, then the lower ones together */
    HADA_PACKING_CSI12     /* 2 samples in 3 bytes, likewise */
} hada_packing;

typedef struct hada_headerless {
    int rows, cols, channels; /* 3: red, green and blue of each pixel together */
    int bits;                 /* of a sample: 8 to 16 */
    hada_packing packing;
    uint64_t row_bytes; /* from row to row; 0: not known, HADA_HEADERLESS_ALIGNMENTS are tried */
} hada_headerless;

/* What hada_headerless_set() said; 0: nothing. */
int hada_headerless_get(hada_headerless *frames);

/* Bytes of a frame whose rows begin at multiples of `alignment` bytes, where row_bytes does not say it. */
uint64_t hada_headerless_bytes(const hada_headerless *frames, unsigned alignment);

/* Sets row_bytes so that a file of `bytes` holds whole frames, and *count to their number. */
hada_status hada_headerless_fit(hada_headerless *frames, uint64_t bytes, int *count, hada_error *err);

/* A frame's samples, row for row without gaps, as bytes or in the machine's 16 bits. */
void hada_headerless_unpack(const hada_headerless *frames, const unsigned char *from, void *to);

/* Frames of samples, one after the other, each as an uncompressed TIFF page would have them. */
typedef struct hada_decoded {
    hada_tiff_page page; /* of every frame */
    int frames;
    int swapped;   /* samples are not in the machine's byte order */
    void *samples; /* of all frames, freed with free(); NULL: they are in the file, from `at` on */
    uint64_t at;
    hada_headerless headerless; /* rows not 0: the file is nothing but such frames */
    hada_mosaic mosaic;
    double encoding; /* how values stand for light (hadalens/response.h); 0: the file does not say */
} hada_decoded;

/* Decodes the file `fd`, which stays the caller's, if it has one of these formats; else *known is 0. What it claims to
 * hold is checked against the limits before memory is taken. */
hada_status hada_decode(hada_decoded *out, int fd, size_t bytes, int *known, hada_error *err);

/* Whether the file is of no known format, and the caller has said how to read such files. */
int hada_decode_is_headerless(int fd, size_t bytes, hada_headerless *frames);

/* Whether a library reads the file that is not to be trusted with damaged ones. */
int hada_decode_is_suspect(int fd, size_t bytes);

/* Loads what such a file needs; *reopens: its library opens it again by its name, /dev/fd/N. */
hada_status hada_decode_load(int fd, size_t bytes, int *reopens, hada_error *err);

/* For the decoders: */

/* An array of 2 to 4 dimensions. */
typedef struct hada_array {
    int dimensions;
    uint64_t size[4];
    int columns_first; /* 1: the first dimension is the fastest in memory (Fortran, MATLAB); 0: the last one is */
    int frames_last;   /* 1: rows, cols, channels, frames (MATLAB); 0: frames first */
} hada_array;

/* What an array is as frames: (rows, cols), (rows, cols, channels), (channels, rows, cols), (frames, rows, cols),
 * (frames, rows, cols, channels) or (frames, channels, rows, cols) (NumPy also: (frames, depths, rows, cols, channels),
 * where all depths are frames); with frames last: (rows, cols), (rows, cols,
 * channels), (rows, cols, frames) or (rows, cols, channels, frames). Channels are 1 or 3, or with frames
 * first 4 as the last dimension (colour and opacity). out->page.bits, is_float and is_signed are known. */
hada_status hada_array_frames(hada_decoded *out, const hada_array *array, size_t file_bytes, hada_error *err);

/* Makes out->samples of those of an array whose columns come first. */
hada_status hada_array_order(hada_decoded *out, const hada_array *array, const unsigned char *from, hada_error *err);

/* Fills in the divisor of the samples, as TIFF files have it. */
void hada_decoded_scale(hada_tiff_page *page);

typedef struct hada_decoder {
    const char *missing;   /* what this build cannot read, and what it lacks; NULL: nothing */
    hada_library *library; /* is loaded first; NULL: there is none */
    int itself;            /* it reads from the file what it needs; 0: `data` are the whole file */
    hada_status (*decode)(hada_decoded *out, int fd, const unsigned char *data, size_t bytes, hada_error *err);
} hada_decoder;
extern const hada_decoder hada_png, hada_jpeg, hada_numpy, hada_matlab, hada_matio, hada_raw;

/* Whether a MATLAB file is one of version 5 to 7; the others are left to matio. */
int hada_is_matlab_five(const unsigned char *head, size_t bytes);

/* Inflates what zlib deflated until `room` bytes are there; *made: how many there are, fewer where the data end. */
hada_status hada_inflate(const unsigned char *from, size_t bytes, unsigned char *to, size_t room, size_t *made,
                         hada_error *err);

/* The whole file, freed with free(). */
hada_status hada_decode_read(unsigned char **data, int fd, size_t bytes, hada_error *err);

#endif
