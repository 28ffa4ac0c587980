/* Reading TIFF files: where the pages of a file are, an open file, and one page as float planes. Internal. */
#ifndef HADA_IO_TIFF_PAGE_H
#define HADA_IO_TIFF_PAGE_H

#include <hadalens/pixels.h>
#include <hadalens/tiff.h>
#include <tiffio.h>

/* The structure of a TIFF file, read without libtiff: byte order, classic or Big, and the offset of each directory.
 * One pass reads all directories, so that opening the last page later costs no more than opening the first. */
typedef struct hada_tiff_chain {
    int swapped;     /* the file's byte order is not the machine's */
    int big;         /* BigTIFF */
    uint64_t bytes;  /* of the file */
    uint64_t *pages; /* offsets of the directories, thumbnails and masks left out */
    size_t count;
} hada_tiff_chain;

/* `fd` stays the caller's. */
hada_status hada_tiff_chain_read(hada_tiff_chain *chain, int fd, hada_error *err);
void hada_tiff_chain_free(hada_tiff_chain *chain);

/* The file offset of the value of `tag` in the directory at `directory`, and its number of bytes; 0 when the
 * directory has no such tag. */
uint64_t hada_tiff_chain_find(const hada_tiff_chain *chain, int fd, uint64_t directory, unsigned tag, uint64_t *bytes);

/* An open file of libtiff. Its messages go to this handle, never to the process's handlers or the terminal. Files are
 * read and written through our own file descriptors, which keeps the operating system's reason for a failure. */
typedef struct hada_tiff_handle {
    int fd;
    uint64_t position;
    uint64_t first; /* reading: where libtiff shall believe the first directory to be; 0 = as in the file */
    int swapped, big;
    int write_code;    /* errno of the first failed write, or 0 */
    char message[512]; /* first error of libtiff since it was cleared, or "" */
} hada_tiff_handle;

/* Opens libtiff on `handle` (whose fd the caller opens and closes). `mode` as for TIFFOpen. NULL on failure: see
 * handle->message. The handle must outlive the TIFF. */
TIFF *hada_tiff_attach(hada_tiff_handle *handle, const char *name, const char *mode);

/* Whether the limits allow a caller to hold all frames of a file at once. */
hada_status hada_tiff_check_all(const hada_tiff_reader *reader, hada_error *err);

/* One page: what its samples are. */
typedef struct hada_tiff_page {
    int rows, cols;
    int samples;  /* per pixel in the file */
    int channels; /* kept: alpha left out, a palette looked up */
    int bits, is_float, is_signed;
    int separate; /* each sample has its own plane */
    int inverted; /* 0 is white */
    int palette;  /* samples are indices; the colours come from the file */
    int compression;
    double scale;          /* the divisor of stored numbers */
    uint64_t stored_bytes; /* of its pixels in the file, at most the file's */
} hada_tiff_page;

/* Reads and checks the tags of the current directory; what cannot be read is refused by name. Sizes that a file of
 * `file_bytes` cannot hold are refused before anything is allocated. `keep_indices`: a palette is only a way to show
 * grey values (as in ImageJ files), the indices are the image. */
hada_status hada_tiff_page_check(TIFF *tif, uint64_t file_bytes, int keep_indices, hada_tiff_page *page,
                                 hada_error *err);

/* The form in which its samples can be used as they are stored: whole numbers from 0 up to 8 or 16 bits, over
 * page->scale; all others, HADA_PIXEL_F32, become floats when they are read. */
hada_pixel_type hada_tiff_page_form(const hada_tiff_page *page);

/* Reads the pixels: `channels` planes of rows * cols, as floats or in the page's form. */
hada_status hada_tiff_page_read(TIFF *tif, const hada_tiff_handle *handle, const hada_tiff_page *page,
                                hada_pixel_type form, void *out, hada_error *err);

/* Bytes of an uncompressed page. */
uint64_t hada_tiff_page_bytes(const hada_tiff_page *page);
/* What a file claims, against the limits: `values` numbers in memory at once, and the bytes of a piece that is read. */
hada_status hada_tiff_budget(uint64_t values, uint64_t piece_bytes, uint64_t file_bytes, hada_error *err);
/* Converts an uncompressed page that was read from the file as it is; `raw` is put into the machine's byte order
 * in place when `swapped`. Not for palettes. */
void hada_tiff_page_convert(const hada_tiff_page *page, void *raw, int swapped, hada_pixel_type form, void *out);

/* A frame of a sensor, in linear light. encoding: how its values stand for light (hadalens/response.h); HADA_AUTO: as
 * the file says, linear where it says nothing. STORED: in the form in which the file has it where that is linear and of
 * 8 or 16 bits, else as floats; planar and without gaps; the caller frees pixels->data. LOAD: opens, reads, closes. */
hada_status hada_tiff_read_stored(hada_tiff_reader *reader, int index, double encoding, hada_pixels *pixels,
                                  hada_error *err);
hada_status hada_tiff_read_light(hada_tiff_reader *reader, int index, double encoding, hada_image *image,
                                 hada_error *err);
hada_status hada_tiff_load_light(const char *path, int index, double encoding, hada_image *image, hada_error *err);

/* Sets the encoding of a file of whole numbers that does not state one; 0: leaves it open. */
void hada_tiff_presume(hada_tiff_reader *reader, double encoding);

#endif
