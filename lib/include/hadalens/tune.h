/* Hadalens: measuring which of several ways of doing the same is the fastest on a device, on request.
 *
 * The library never measures by itself: what serves is read from shipped tables, so that the same input gives the same
 * bits. A tuning file overrides the tables (hada_context_options.tuning, HADALENS_TUNING); these functions make one.
 * Results by different ways differ in their last bits. docs/reference/devices.md describes the file. A context is
 * measured in by one thread, and nothing else should run on the device meanwhile. */
#ifndef HADALENS_TUNE_H
#define HADALENS_TUNE_H

#include <hadalens/device.h>
#include <hadalens/status.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Who transforms: the library's own kernels, or clFFT. */
typedef enum hada_tune_backend { HADA_TUNE_OWN = 1, HADA_TUNE_CLFFT = 2 } hada_tune_backend;

/* One back end at one size: milliseconds for a batch, medians. NaN where it cannot serve; `reason` says why. */
typedef struct hada_tune_time {
    double forward_ms, inverse_ms;
    char reason[256];
} hada_tune_time;

typedef struct hada_tune_row {
    int rows, cols, batch;
    hada_tune_time own, clfft;
    hada_tune_backend before; /* who serves in this context now: by its tuning file, else our own */
    hada_tune_backend chosen; /* the faster one */
} hada_tune_row;

/* Measures both back ends on real images of rows x cols, forward and inverse, taking turns for `rounds` rounds
 * (HADA_AUTO: 15, at most 1000). A back end whose plan cannot be made, or does not give the known answers, is left out.
 * clFFT is chosen when it needs less than 95 % of the time: the own kernels save more than is measured here, since they
 * prune and multiply by filters as they read. HADA_ERROR_SELF_TEST or another error of the plan when neither can serve.
 * A new size may compile for a minute. */
HADA_API hada_status hada_tune_fft(hada_context *context, int rows, int cols, int rounds, hada_tune_row *row,
                                   hada_error *err);

/* Writes the choices for the kind of the context's device into a tuning file. Lines of an existing file that are about
 * something else stay. Written beside the file and renamed. */
HADA_API hada_status hada_tune_save(const hada_context *context, const char *path, const hada_tune_row *rows,
                                    size_t count, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
