/* Hadalens: measuring which of several ways of doing the same is the fastest on a device, on request.
 *
 * The library never measures by itself: what serves is read from shipped tables, so that the same input gives the same
 * bits. A tuning file overrides the tables (hada_context_options.tuning, HADALENS_TUNING); these functions make one.
 * Results by different ways differ in their last bits. docs/devices.md describes the file. A context is measured in by
 * one thread, and nothing else should run on the device meanwhile. */
#ifndef HADALENS_TUNE_H
#define HADALENS_TUNE_H

#include <hadalens/device.h>
#include <hadalens/net.h>
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
    hada_tune_backend before; /* who serves in this context now: by its tuning file, else by the table */
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

/* A convolution of a net at a size, and what was measured of it. Words are those of the tuning file. */
typedef struct hada_tune_conv_row {
    int in_channels, out_channels, in_rows, in_cols;
    int kernel, stride, pad, transposed, output_pad;
    int layers;                  /* of the net that have it */
    char shape[64];              /* "3x3/1/1+1:16>32:256x256" */
    char before[64], chosen[64]; /* "winograd4 block=16 blocks=2 tiles=24": serving in this context now, the fastest */
    double before_ms, chosen_ms; /* medians, of one image */
    int measured, refused, skipped; /* variants timed; left out as wrong; left out for lack of time */
    char reason[256];               /* of the last refusal, "" without one */
} hada_tune_conv_row;

/* The distinct convolutions of a net for images of rows x cols, in the order of its layers; *out is given back
 * by hada_tune_convs_destroy().
 * HADA_ERROR_SIZE where the net does not take the size. */
HADA_API hada_status hada_tune_net(hada_context *context, const hada_net *net, int rows, int cols,
                                   hada_tune_conv_row **out, size_t *count, hada_error *err);
/* Frees the rows and clears the pointer; NULL is fine. */
HADA_API void hada_tune_convs_destroy(hada_tune_conv_row **rows);

/* Measures the implementations, tile sizes and shares of work that can serve a convolution (forward, with bias and
 * ReLU), taking turns, for about `seconds` and what the plain one takes once. Each is first held against the plain one,
 * which is the definition, on random values: relative rms 2e-6, Winograd's F(4x4,3x3) 6e-6; one that differs by more is
 * left out. What serves already is always measured, and stays unless another needs less than 97 % of its time. New
 * programs are compiled, which takes seconds each and counts. */
HADA_API hada_status hada_tune_conv(hada_context *context, hada_tune_conv_row *row, double seconds, hada_error *err);

/* As hada_tune_save(), for convolutions: the shape, and what was chosen. */
HADA_API hada_status hada_tune_save_convs(const hada_context *context, const char *path, const hada_tune_conv_row *rows,
                                          size_t count, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
