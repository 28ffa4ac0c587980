/* What the files of the transform layer share. Internal to lib/fft. */
#ifndef HADA_FFT_INTERNAL_H
#define HADA_FFT_INTERNAL_H

#include "fft/fft.h"
#include "kernels/shared_fft.h"

/* A back end: `create` fills plan->state; all of it works on a slot's compute queue. `use` is a call's filter with what
 * its zeros stand for filled in; product HADA_FFT_PLAIN: there is none. */
typedef struct hada_fft_engine {
    hada_status (*create)(hada_fft *plan, hada_error *err);
    void (*destroy)(hada_fft *plan);
    hada_status (*forward)(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                           size_t spectrum_offset, hada_error *err);
    hada_status (*inverse)(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                           size_t real_offset, const hada_fft_filter *use, hada_error *err);
    int (*block)(int cols); /* columns in a block of the spectra */
} hada_fft_engine;

struct hada_fft {
    hada_slot *slot;
    hada_fft_desc desc; /* with the back end and the band resolved */
    hada_spectrum_layout layout;
    const hada_fft_engine *engine;
    void *state;
};

extern const hada_fft_engine hada_fft_own_engine, hada_fft_clfft_engine;

/* The plan's rectangle of `images` images as kernels take it, each `stride` images from the other. */
static inline hada_fft_real hada_fft_real_of(const hada_fft_desc *desc, size_t offset, int stride, int images)
{
    return (hada_fft_real){.offset = offset,
                           .distance = desc->real_distance * (size_t)stride,
                           .pitch = desc->real_pitch,
                           .row0 = desc->row0,
                           .col0 = desc->col0,
                           .rows = desc->real_rows,
                           .cols = desc->real_cols,
                           .images = images,
                           .scale = (float)(1.0 / ((double)desc->rows * (double)desc->cols))};
}

/* Which back end serves a size, by the tuning file; never AUTO. */
hada_fft_backend hada_fft_choose(const hada_context *context, int rows, int cols);

/* Whether clFFT has the length's factors. */
int hada_clfft_takes(int n);

#endif
