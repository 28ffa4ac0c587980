/* An uncompressed hyperstack laid out as ImageJ itself does it: the first directory with all metadata, the pixels of
 * all images without gaps, then the directories of the other pages. libtiff cannot write that order, and readers rely
 * on it: ImageJ and tifffile take the pixels behind the first image as the next ones, without looking at the other
 * directories. All offsets are known beforehand, so pixels are streamed. Internal. */
#ifndef HADA_IO_TIFF_WRITE_H
#define HADA_IO_TIFF_WRITE_H

#include "core/outfile.h"
#include "io/tiff_meta.h"

/* As hada_tiff_write(), of linear light, which gets the file's encoding strip by strip on its way. */
hada_status hada_tiff_write_light(hada_tiff_writer *writer, const hada_image *image, hada_error *err);

typedef struct hada_stack_layout {
    int big; /* BigTIFF */
    int rows, cols, bits;
    uint64_t images;
    double pixel_um;
    uint64_t data_at; /* where the pixels begin; they end at data_at + images * image_bytes */
    uint64_t image_bytes;
} hada_stack_layout;

/* Fills data_at and image_bytes from the other fields and the size of the texts. */
hada_status hada_stack_layout_place(hada_stack_layout *layout, const hada_tiff_text *text, hada_error *err);

/* Writes everything but the pixels. `text` must have the size that was given to hada_stack_layout_place. */
hada_status hada_stack_layout_write(const hada_stack_layout *layout, const hada_tiff_text *text, hada_outfile *file,
                                    hada_error *err);

#endif
