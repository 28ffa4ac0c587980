/* Hadalens: frames from TIFF and other files, and to TIFF files.
 *
 * Readers recognise a file by its content. They read PNG (8 and 16 bits), JPEG, NumPy arrays (.npy), MATLAB files (the
 * largest array of numbers) and raw files of cameras (DNG and others) as well as TIFF, where the build has their
 * libraries (docs/reference/files.md); HADA_ERROR_UNSUPPORTED names what is missing. Of a raw file, values are 0 at the
 * black level and 1 at white; a sensor with a colour filter mosaic has one channel.
 *
 * Of TIFF files they read 8, 16 and 32-bit integers and 16, 32 and 64-bit floats, grey and RGB (alpha is dropped),
 * planar or interleaved, palettes (looked up; in ImageJ files, where they only colour a grey image, left aside), either
 * byte order, strips or tiles, every compression that libtiff was built with, many pages, BigTIFF, ImageJ hyperstacks
 * (also those of several GiB that ImageJ writes with a single directory) and OME-TIFF. Where 0 is white, values are
 * turned round. Thumbnails are passed over. The orientation tag is not applied, as in ImageJ and tifffile: rows are
 * read as they stand. Readers and writers belong to one thread at a time; several may be in use at once. Files are read
 * page by page: memory does not grow with the number of pages. Writes beside the file and renames at the end: a failed
 * write leaves nothing. */
#ifndef HADALENS_TIFF_H
#define HADALENS_TIFF_H

#include <hadalens/image.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_tiff_reader hada_tiff_reader;

/* What a file holds. An ImageJ hyperstack whose channels stand on separate pages is offered as frames of `channels`
 * channels. */
typedef struct hada_tiff_info {
    int frames;               /* images to read: pages, or pages / channels of a hyperstack */
    int channels, rows, cols; /* of the first frame */
    int bits;                 /* per sample: 8, 16, 32 or 64 */
    int is_float, is_signed;
    double scale;      /* what a stored number was divided by: 255, 65535, ..., 1 for floats; signed: 127, 32767, ... */
    int slices, times; /* of a hyperstack; slices * times == frames, 1 and frames otherwise */
    double pixel_width_um, pixel_height_um; /* 0 where the file does not say */
    double slice_spacing;                   /* of a hyperstack, in micrometres, 0 where unknown */
    const char *description;                /* the text of the file's ImageDescription, "" where none */
    const double *distances_mm; /* of the slices, where the file says them (files written by this library) */
    int distances;              /* how many; 0 where the file does not say */
    double encoding;            /* how the values stand for light (hadalens/response.h), where the file says it (files
                                   written by this library); 0 where it does not */
    hada_mosaic mosaic; /* of a raw file: its colour filter mosaic; HADA_MOSAIC_NONE where it has none of 2 x 2 */
} hada_tiff_info;

HADA_API hada_status hada_tiff_open(hada_tiff_reader **out, const char *path, hada_error *err);
HADA_API const hada_tiff_info *hada_tiff_get_info(const hada_tiff_reader *reader);
/* Reads frame `index` into *image (created by the call; the caller destroys it). NaN and infinite pixels are read as
 * they are: the caller decides. */
HADA_API hada_status hada_tiff_read(hada_tiff_reader *reader, int index, hada_image *image, hada_error *err);
HADA_API void hada_tiff_close(hada_tiff_reader **reader);

/* Opens, reads one frame, closes. */
HADA_API hada_status hada_tiff_load(const char *path, int index, hada_image *image, hada_error *err);

typedef enum hada_tiff_layout {
    HADA_TIFF_PAGES = 0,     /* an ordinary (multi-page) TIFF; RGB interleaved in one page */
    HADA_TIFF_HYPERSTACK = 1 /* ImageJ hyperstack (channels, slices, times), with OME-like distances in the metadata */
} hada_tiff_layout;

typedef struct hada_tiff_write_options {
    size_t size; /* sizeof(hada_tiff_write_options) */
    int bits;    /* 32 (float, default), 16 or 8 (integers, clipped to 0..1 times full scale) */
    hada_tiff_layout layout;
    int slices, times;          /* of a hyperstack: frames are written slice by slice within each time. Of pages: their
                                   product is how many will come, 0 (default) where that is not known */
    const double *distances_mm; /* per slice (page), near to far, `slices` of them; copied; NULL where none */
    double pixel_um;            /* size of a pixel, 0 where unknown */
    double scale; /* 8 and 16 bits: a value of `scale` becomes full scale; stated in the metadata; 1 by default */
    const char *description; /* further lines for the metadata ("key=value\n"), or NULL */
    int compress;            /* 1: deflate with predictor; 0: none (default) */
    double encoding; /* how the values stand for light (hadalens/response.h), stated in the metadata; 0 (default):
                        not stated */
} hada_tiff_write_options;

HADA_INIT(hada_tiff_write_options, HADA_STRUCT_TIFF_WRITE_OPTIONS)

typedef struct hada_tiff_writer hada_tiff_writer;
/* `channels`, `rows`, `cols` hold for all frames. BigTIFF is chosen when the pixels need it (3.9 GB and more); that is
 * decided from slices * times, so a longer file of pages without that count fails where classic TIFF ends. Integer
 * samples: NaN becomes 0. */
HADA_API hada_status hada_tiff_create(hada_tiff_writer **out, const char *path, int channels, int rows, int cols,
                                      const hada_tiff_write_options *options, hada_error *err);
HADA_API hada_status hada_tiff_write(hada_tiff_writer *writer, const hada_image *image, hada_error *err);
/* Finishes and renames into place; the writer is destroyed also on failure. */
HADA_API hada_status hada_tiff_finish(hada_tiff_writer **writer, hada_error *err);
/* Gives up: removes what was written. */
HADA_API void hada_tiff_abandon(hada_tiff_writer **writer);

/* Writes one frame. */
HADA_API hada_status hada_tiff_save(const char *path, const hada_image *image, const hada_tiff_write_options *options,
                                    hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
