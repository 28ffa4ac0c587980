/* What the files of the transform layer share. Internal to lib/fft. */
#ifndef HADA_FFT_INTERNAL_H
#define HADA_FFT_INTERNAL_H

#include "fft/fft.h"

/* A back end: `create` fills plan->state; all of it works on a slot's compute queue. */
typedef struct hada_fft_engine {
    hada_status (*create)(hada_fft *plan, hada_error *err);
    void (*destroy)(hada_fft *plan);
    hada_status (*forward)(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                           size_t spectrum_offset, hada_error *err);
    hada_status (*inverse)(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                           size_t real_offset, const hada_fft_filter *filter, hada_error *err);
    size_t (*bytes)(const hada_context *context, const hada_fft_desc *desc);
    int (*block)(const hada_context *context, int rows, int cols);
    size_t (*scratch)(const hada_context *context, const hada_fft_desc *desc); /* of the bytes, taken from the room */
} hada_fft_engine;

struct hada_fft {
    hada_slot *slot;
    hada_fft_desc desc; /* with the back end and the band resolved */
    hada_spectrum_layout layout;
    const hada_fft_engine *engine;
    void *state;
};

extern const hada_fft_engine hada_fft_own_engine, hada_fft_clfft_engine;

/* A call's filter with what its zeros stand for filled in: stride 1, the plan's band. */
hada_fft_filter hada_fft_resolve(const hada_fft *plan, const hada_fft_filter *filter /* or NULL */);

/* Which back end the table (or the tuning file) names for a size; never AUTO. */
hada_fft_backend hada_fft_choose(const hada_context *context, int rows, int cols);

/* Whether clFFT has the length's factors. */
int hada_clfft_takes(int n);

/* Runs a new plan once against known answers. */
hada_status hada_fft_check(hada_fft *plan, hada_error *err);

#endif
