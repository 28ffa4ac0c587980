/* Batched two-dimensional transforms of real images and their half spectra. Internal.
 *
 * Forward is unnormalised, inverse divides by rows*cols. Two back ends behind one interface: our own kernels (any
 * size, pruned, run offline) and clFFT. Which one serves is read from a table by device class and size
 * (fft.c, overridden by the tuning file), never timed during a run.
 *
 * A plan belongs to one slot. Spectrum layout: see hada_spectrum_layout. */
#ifndef HADA_FFT_FFT_H
#define HADA_FFT_FFT_H

#include "core/fft_factor.h"
#include "kernels/shared_spectrum.h"
#include "runtime/memory.h"

/* Where the complex value (ky, kx), kx <= cols/2, of a half spectrum stands, in complex numbers from the start of its
 * image: ((kx / block) * rows + ky) * block + kx % block. Columns are kept in blocks so that a column pass streams;
 * block > cols/2 is the plain row-major layout. Kernels use the same rule (kernels/inc_spectrum.h). The values at
 * kx > cols/2 (padding of the last block) are unspecified: pointwise kernels may compute on them but sums must leave
 * them out. */
typedef struct hada_spectrum_layout {
    int rows, cols; /* of the real image */
    int block;      /* columns in a block */
    int blocks;     /* ceil((cols/2 + 1) / block) */
    size_t count;   /* complex numbers of one image: blocks * rows * block */
} hada_spectrum_layout;

static inline size_t hada_spectrum_index(const hada_spectrum_layout *layout, int ky, int kx)
{
    return ((size_t)(kx / layout->block) * (size_t)layout->rows + (size_t)ky) * (size_t)layout->block +
           (size_t)(kx % layout->block);
}

/* Bytes of some half spectra. */
static inline size_t hada_spectra_bytes(const hada_spectrum_layout *layout, int images)
{
    return (size_t)images * layout->count * 2 * sizeof(float);
}

/* The layout as kernels take it. */
static inline hada_spectrum_shape hada_spectrum_shape_of(const hada_spectrum_layout *layout)
{
    return (hada_spectrum_shape){(unsigned)layout->count, (unsigned)layout->rows, (unsigned)layout->block,
                                 (unsigned)layout->cols};
}

typedef enum hada_fft_backend { HADA_FFT_AUTO = 0, HADA_FFT_OWN = 1, HADA_FFT_CLFFT = 2 } hada_fft_backend;

typedef enum hada_fft_direction { HADA_FFT_FORWARD = 1, HADA_FFT_INVERSE = 2 } hada_fft_direction;

/* What to transform. The real image of rows x cols is only present within a rectangle: outside it a forward transform
 * reads zeros, an inverse transform computes nothing. */
typedef struct hada_fft_desc {
    hada_fft_direction direction;
    hada_fft_backend backend;
    int rows, cols; /* transform size, any size from 1 x 1 */
    int batch;      /* images in one call, at most */
    /* the rectangle of the real image that exists in memory: top left and size; whole image: 0, 0, rows, cols */
    int row0, col0, real_rows, real_cols;
    size_t real_pitch;    /* floats from row to row */
    size_t real_distance; /* floats from image to image */
    /* Inverse: values with kx > band_cols or min(ky, rows-ky) > band_rows are taken as zero and not read. Forward:
     * values with kx > band_cols may be left out (unspecified). 0, 0 means no band limit. */
    int band_rows, band_cols;
} hada_fft_desc;

/* A part of an image: top left pixel and size. */
typedef struct hada_rectangle {
    int row0, col0, rows, cols;
} hada_rectangle;

/* A transform of rows x cols; `part` of each image is in memory, without gaps. */
static inline hada_fft_desc hada_fft_of(hada_fft_direction direction, int rows, int cols, int batch,
                                        hada_rectangle part)
{
    return (hada_fft_desc){.direction = direction,
                           .rows = rows,
                           .cols = cols,
                           .batch = batch,
                           .row0 = part.row0,
                           .col0 = part.col0,
                           .real_rows = part.rows,
                           .real_cols = part.cols,
                           .real_pitch = (size_t)part.cols,
                           .real_distance = (size_t)part.rows * (size_t)part.cols};
}

/* The same of whole images. */
static inline hada_fft_desc hada_fft_whole(hada_fft_direction direction, int rows, int cols, int batch)
{
    return hada_fft_of(direction, rows, cols, batch, (hada_rectangle){0, 0, rows, cols});
}

/* The layout of spectra on this context for a size, given the back end that would serve (AUTO: by the tuning file).
 * Both directions of a size and a back end share it. */
hada_spectrum_layout hada_fft_layout(const hada_context *context, int rows, int cols, hada_fft_backend backend);

typedef struct hada_fft hada_fft;

/* Makes the plan, its tables and scratch, compiles what it needs, and runs it once against known answers. */
hada_status hada_fft_create(hada_fft **out, hada_slot *slot, const hada_fft_desc *desc, hada_error *err);
void hada_fft_destroy(hada_fft **plan);

/* There and back, of the same images; the direction of desc is not read. */
typedef struct hada_fft_pair {
    hada_fft *forward, *inverse;
} hada_fft_pair;
hada_status hada_fft_pair_create(hada_fft_pair *pair, hada_slot *slot, hada_fft_desc desc, hada_error *err);
void hada_fft_pair_destroy(hada_fft_pair *pair);

/* Bytes of device memory that a plan with scratch of its own holds; 0 where there can be none. */
size_t hada_fft_bytes(const hada_context *context, const hada_fft_desc *desc);

hada_fft_backend hada_fft_serving(const hada_fft *plan); /* which back end serves */
const hada_spectrum_layout *hada_fft_plan_layout(const hada_fft *plan);

/* How the spectrum is made while an inverse reads it. With a filter, the plan's input is the product
 *     spectrum[image_of(b)] * filter[filter_of(b)]      (form complex)
 *     Re(s) Re(w) + i Im(s) Im(w)                       (form split)
 * where for batch member b: image_of(b) = b % spectrum_count and filter_of(b) = filter_first + b * stride. Filters have
 * the plan's layout, one after the other, float or half (stored half2 pairs). */
typedef enum hada_fft_product { HADA_FFT_PLAIN = 0, HADA_FFT_COMPLEX = 1, HADA_FFT_SPLIT = 2 } hada_fft_product;
typedef struct hada_fft_filter {
    hada_fft_product product;
    cl_mem filter;
    int half;           /* the filter is stored as half */
    int spectrum_count; /* images in the spectrum buffer (channels) */
    int filter_first;   /* first filter used */
    int stride; /* member b also writes the stride * b-th real image, as when one of several channels is done; 0: 1 */
    int band_rows, band_cols; /* a band of this call, at most the plan's; 0, 0: the plan's */
} hada_fft_filter;

/* Enqueues `batch` (<= desc.batch) transforms on the slot's compute queue. Offsets count floats on the real side and
 * complex numbers on the spectrum side, even ones with the own kernels. Forward: real -> spectrum. The real input is
 * preserved; an inverse preserves its spectrum as well (it works in the plan's own scratch). */
hada_status hada_fft_forward(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                             size_t spectrum_offset, hada_error *err);
hada_status hada_fft_inverse(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                             size_t real_offset, const hada_fft_filter *filter /* or NULL */, hada_error *err);

/* Transforms any number of images in the plan's direction, a batch a call. Spectra begin at the number `at`. */
hada_status hada_fft_all(hada_fft *plan, int images, cl_mem real, cl_mem spectra, size_t at, hada_error *err);

#endif
