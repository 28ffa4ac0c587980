/* What every module of a fit knows of it: the sizes of the model to be, how spectra and sums lie on the device, and
 * the queue. Nothing of it changes once it is made. Internal. */
#ifndef HADA_FIT_FIT_GRID_H
#define HADA_FIT_FIT_GRID_H

#include "dataset/dataset.h"
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
void hada_fit_grid_destroy(hada_fit_grid *grid); /* after all that uses it */

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

/* Bytes of so many spectra that lie one after the other, with what kernels write beyond the last frequency. */
size_t hada_fit_spectra_bytes(const hada_fit_grid *grid, size_t images);

/* The transform of frames (0) or of what is in the window (1), of all channels. */
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

/* A pair of raw frame and scene on its way into a fit: checked, freed of its dark level, transformed. */
typedef struct hada_fit_pair {
    const hada_fit_grid *grid;
    hada_fft *raw_fft, *scene_fft;
    hada_buffer raw, scene;                   /* pixels on the device */
    hada_buffer weights;                      /* for those who need raw_weights there; empty until then */
    hada_buffer raw_spectrum, scene_spectrum; /* B and X, [channel][layout.count] complex */
    float *raw_pixels, *scene_pixels;         /* the same pixels on the host */
    float *raw_weights; /* of the frame's values, as hada_refine_data has them: 1, 0 for colours that a pixel of a
                           mosaic does not hold, below 0 for saturated values */
    int weighted;       /* 0: all of them are 1, and not written */
    double *raw_energy, *scene_energy; /* per channel: sum of squared pixels, by Parseval's theorem the mean over
                                          frequencies of |B|^2 and |X|^2 */
    float *scratch;                    /* a channel of a frame */
    uint64_t bytes;                    /* of device memory */
} hada_fit_pair;

hada_status hada_fit_pair_create(hada_fit_pair *pair, const hada_fit_grid *grid, hada_error *err);
void hada_fit_pair_destroy(hada_fit_pair *pair);

/* Whether a pair fits and is finite. */
hada_status hada_fit_pair_check(const hada_fit_grid *grid, int depth, const hada_image *raw, const hada_image *scene,
                                hada_error *err);

/* Pixels and energies of a checked pair: takes the dark level off, and the centre of a scene as large as the frame,
 * which it brings to linear light. Frames get the scene's colours, by the matrix of the grid's info. weights: of the
 * frame's values, as hada_pair has them; NULL: all are 1. */
void hada_fit_pair_take(hada_fit_pair *pair, const hada_image *raw, const hada_image *scene, const hada_image *weights);

/* Spectra of pixels, `pair`'s own or others of that size; scene NULL: of the frame alone. */
hada_status hada_fit_pair_transform(hada_fit_pair *pair, const float *raw, const float *scene, hada_error *err);

/* A pair that stays on the device: pixels of the frame, their weights (empty: all alike), X. */
typedef struct hada_fit_stored {
    hada_buffer raw, weights, spectrum;
} hada_fit_stored;
hada_status hada_fit_stored_create(hada_fit_stored *stored, const hada_fit_pair *pair, hada_error *err);
void hada_fit_stored_free(hada_fit_stored *stored);

/* The pair that was read, to the device: the frame's pixels, their weights (created where there are any) and the
 * scene's spectra. */
hada_status hada_fit_pair_upload(hada_fit_pair *pair, hada_buffer *raw, hada_buffer *weights,
                                 const hada_buffer *spectrum, hada_error *err);

/* The frame through a filter (hada_fit_product) into the window: pixels of all channels in pair->scene. */
hada_status hada_fit_pair_filter(hada_fit_pair *pair, hada_fft *inverse, const hada_fft_filter *filter,
                                 hada_error *err);

/* Reads the pairs of a fit from a data set. */
typedef struct hada_fit_reader {
    const hada_dataset *pairs;
    hada_fit_pair *pair;
    const hada_monitor *monitor;
    const char *why;        /* they are read, for the monitor */
    hada_progress progress; /* begins with the first pair */
    double *energy;         /* per channel: of the frames read since it was last cleared */
} hada_fit_reader;
hada_status hada_fit_reader_create(hada_fit_reader *reader, const hada_dataset *pairs, hada_fit_pair *pair,
                                   const hada_monitor *monitor, const char *why, hada_error *err);
void hada_fit_reader_destroy(hada_fit_reader *reader);

/* Pixels and energies of pair i of depth z, in reader->pair. next: a pair of that depth that is read soon, -1: none. */
hada_status hada_fit_read(hada_fit_reader *reader, int z, int64_t i, int64_t next, hada_error *err);

/* After clearing, once every pair of a depth was read: HADA_ERROR_STATE where they are not those of its sums, whose
 * energy is raw_energy. */
void hada_fit_reader_clear(hada_fit_reader *reader);
hada_status hada_fit_reader_check(const hada_fit_reader *reader, int z, const double *raw_energy, hada_error *err);

#endif
