/* What every module of a fit knows of it: the sizes of the model to be, how spectra and sums stand on the device, and
 * the queue. Nothing of it changes once it is made. Internal. */
#ifndef HADA_FIT_FIT_GRID_H
#define HADA_FIT_FIT_GRID_H

#include <hadalens/fit.h>

#include "core/callers.h"
#include "fft/fft.h"
#include "kernels/shared_fit.h"
#include "model/model.h"
#include "runtime/buffer.h"
#include "runtime/launch.h"

/* A filter's penalties: the weight of the other depths' light, and the dimensionless regularisation. */
typedef struct hada_fit_setting {
    double alpha, lambda;
} hada_fit_setting;

typedef struct hada_fit_grid {
    hada_slot *slot;
    hada_model_info info; /* sizes and conventions of the model to be; distances_mm points to `distances` */
    double *distances;
    hada_geometry geometry;
    hada_spectrum_layout layout;
    size_t vectors; /* groups of eight frequencies in an image */
    size_t stride;  /* floats from one array of sums to the next */
    size_t chunks;  /* partial sums over an image's frequencies */
    int sum_count;  /* per frequency */
    hada_communicator communicator;
} hada_fit_grid;

/* The description of a model of such sizes, checked. */
hada_status hada_fit_info(hada_model_info *info, const hada_fit_options *options, hada_error *err);

hada_status hada_fit_grid_create(hada_fit_grid *grid, hada_context *context, const hada_fit_options *options,
                                 hada_error *err);
void hada_fit_grid_destroy(hada_fit_grid *grid); /* after all that stands on it */

/* A program of a file that has one of each form, and others for work-groups. */
#define HADA_FIT_PROGRAM(FILE, split, groups)                                                                          \
    ((groups) ? ((split) ? HADA_PROGRAM_##FILE##_SPLIT_SHARED : HADA_PROGRAM_##FILE##_SHARED)                          \
              : ((split) ? HADA_PROGRAM_##FILE##_SPLIT : HADA_PROGRAM_##FILE##_DEFAULT))

static inline int hada_fit_in_groups(const hada_fit_grid *grid)
{
    return grid->slot->context->shape == HADA_SHAPE_GROUPS;
}

static inline int hada_fit_is_split(const hada_fit_grid *grid)
{
    return grid->info.form == HADA_FORM_SPLIT;
}

/* Floats of all channels of a raw frame, and of the window. */
size_t hada_fit_raw_floats(const hada_fit_grid *grid);
size_t hada_fit_window_floats(const hada_fit_grid *grid);

/* Bytes of so many spectra that stand one after the other, with what kernels write beyond the last frequency. */
size_t hada_fit_spectra_bytes(const hada_fit_grid *grid, size_t images);

/* The transform of frames (0) or of what stands in the window (1), of all channels. */
hada_fft_desc hada_fit_transform_desc(const hada_fit_grid *grid, hada_fft_direction direction, int window);

/* How filters act on a spectrum, beside which ones. */
hada_fft_filter hada_fit_product(const hada_fit_grid *grid, cl_mem filters, int first);

/* One spectrum on the device, at complex number `at` of `from`, in rows; `blocks`: 2 layout.count floats. `what` names
 * it where it is not finite. */
hada_status hada_fit_read_plane(const hada_fit_grid *grid, const hada_buffer *from, size_t at, float *blocks, float *to,
                                const char *what, hada_error *err);

/* For kernels: an image among those of all channels or depths, the n-th. */
hada_fit_image hada_fit_image_of(const hada_fit_grid *grid, size_t n);

/* Work-items: a vector of eight frequencies of an image each, or a chunk of vectors. */
hada_range hada_fit_vectors(const hada_fit_grid *grid);
hada_range hada_fit_chunks(const hada_fit_grid *grid);

#endif
