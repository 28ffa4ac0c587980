/* A pair of raw frame and scene on its way into a fit: checked, freed of its dark level, transformed. Internal. */
#ifndef HADA_FIT_FIT_PAIR_H
#define HADA_FIT_FIT_PAIR_H

#include "core/callers.h"
#include "dataset/dataset.h"
#include "fit/fit_grid.h"

typedef struct hada_fit_pair {
    const hada_fit_grid *grid;
    hada_fft *raw_fft, *scene_fft;
    hada_buffer raw, scene;                   /* pixels on the device */
    hada_buffer raw_spectrum, scene_spectrum; /* B and X, [channel][layout.count] complex */
    float *raw_pixels, *scene_pixels;         /* the same pixels on the host */
    double *raw_energy, *scene_energy;        /* per channel: sum of squared pixels, by Parseval's theorem the mean over
                                                 frequencies of |B|^2 and |X|^2 */
    float *scratch;                           /* a channel of a frame */
    uint64_t bytes;                           /* of device memory */
} hada_fit_pair;

hada_status hada_fit_pair_create(hada_fit_pair *pair, const hada_fit_grid *grid, hada_error *err);
void hada_fit_pair_destroy(hada_fit_pair *pair);

/* Whether a pair fits and is finite. */
hada_status hada_fit_pair_check(const hada_fit_grid *grid, int depth, const hada_image *raw, const hada_image *scene,
                                hada_error *err);

/* Pixels and energies of a checked pair: takes the dark level off, and the centre of a scene as large as the frame,
 * which it brings to linear light. */
void hada_fit_pair_take(hada_fit_pair *pair, const hada_image *raw, const hada_image *scene);

/* Spectra of pixels, `pair`'s own or others of that size; scene NULL: of the frame alone. */
hada_status hada_fit_pair_transform(hada_fit_pair *pair, const float *raw, const float *scene, hada_error *err);

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
