/* Frames to planes through the filters that are trained, and gradients of planes to those of filters. Internal.
 *
 * The gradient of a filter (docs/explanation/nets.md): with x = crop(irfft(W B)), N pixels of the grid, and G =
 * rfft(pad(dL/dx)), dL/dW = m / N conj(B) G for the form complex (m: 2 for columns that stand for two, else 1), and
 * dL/dWr = m / N Re(B) Re(G), dL/dWi = m / N Im(B) Im(G) for split. */
#ifndef HADA_TRAIN_FILTER_STEP_H
#define HADA_TRAIN_FILTER_STEP_H

#include "train/parameters.h"
#include "train/sample.h"

typedef struct hada_filter_step {
    hada_step_images *images;
    hada_parameters *parameters;
    hada_fft *forward, *inverse, *back; /* frames; planes; gradients of planes */
} hada_filter_step;

hada_status hada_filter_step_create(hada_filter_step *step, hada_step_images *images, hada_parameters *parameters,
                                    hada_error *err);
void hada_filter_step_destroy(hada_filter_step *step);

/* Raw frames to planes: clipped at zero or as they are. */
hada_status hada_filter_step_forward(hada_filter_step *step, const hada_sample *samples, int count, int clipped,
                                     hada_error *err);

/* Gradients of `count` planes, plain floats in `planes`, to those of filters. */
hada_status hada_filter_step_backward(hada_filter_step *step, const hada_sample *samples, int count, cl_mem planes,
                                      unsigned char *touched, hada_error *err);

/* FILTERS: the squared error of the planes, times `weight` over the samples; they become its gradient. */
hada_status hada_filter_step_error(hada_filter_step *step, int count, double weight, hada_error *err);

/* The gradient of clipping at zero, in HADA_STEP_PLAIN. */
hada_status hada_filter_step_mask(hada_filter_step *step, hada_error *err);

#endif
