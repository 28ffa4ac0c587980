#include "ref/ref_ridge.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "kernels/shared_ridge_weights.h"
#include "refine/proximal.h"

enum { SIZE = HADA_RIDGE_SIZE, REACH = SIZE - 1, FILTERS = HADA_RIDGE_FILTERS, SOME = HADA_RIDGE_SOME };

/* Weight of a filter at a pixel that it sees. */
static double weight_of(int channels, int number, int filter, int channel, int row, int col)
{
    const int taps = channels * SIZE * SIZE, block = number * FILTERS + filter / SOME * SOME;
    const size_t at =
        (size_t)block * (size_t)taps + (size_t)(((channel * SIZE + row) * SIZE + col) * SOME + filter % SOME);
    return channels == 3 ? hada_ridge_colour[at] : hada_ridge_grey[at];
}

/* Calls for each weight with the response and the pixel that it joins. */
static void apply(double *image, int channels, int rows, int cols, int number, double *responses, int back)
{
    const int high = rows - REACH, wide = cols - REACH;
    for (int k = 0; k < FILTERS; k++)
        for (int c = 0; c < channels; c++)
            for (int a = 0; a < SIZE; a++)
                for (int b = 0; b < SIZE; b++) {
                    const double weight = weight_of(channels, number, k, c, a, b);
                    for (int i = 0; i < high; i++)
                        for (int j = 0; j < wide; j++) {
                            double *response = responses + ((size_t)k * (size_t)high + (size_t)i) * (size_t)wide + j;
                            double *pixel = image + ((size_t)c * (size_t)rows + (size_t)(i + a)) * (size_t)cols + j + b;
                            if (back)
                                *pixel += weight * *response;
                            else
                                *response += weight * *pixel;
                        }
                }
}

static size_t responses_of(int rows, int cols)
{
    return rows > REACH && cols > REACH ? (size_t)FILTERS * (size_t)(rows - REACH) * (size_t)(cols - REACH) : 0;
}

void hada_ref_ridge_respond(const double *image, int channels, int rows, int cols, int number, double *responses)
{
    memset(responses, 0, responses_of(rows, cols) * sizeof *responses);
    apply((double *)(size_t)image, channels, rows, cols, number, responses, 0);
}

void hada_ref_ridge_gather(const double *responses, int channels, int rows, int cols, int number, double *image)
{
    memset(image, 0, (size_t)channels * (size_t)rows * (size_t)cols * sizeof *image);
    apply(image, channels, rows, cols, number, (double *)(size_t)responses, 1);
}

hada_status hada_ref_ridge(const double *image, int channels, int rows, int cols, double noise, double *out,
                           hada_error *err)
{
    const int seen = channels == 3 ? 3 : 1;
    const size_t values = (size_t)seen * (size_t)rows * (size_t)cols, count = responses_of(rows, cols);
    double *now = NULL, *before = NULL, *gradient = NULL, *responses = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(now = hada_alloc(values, sizeof *now, "a reference", err)));
    HADA_TRY_OR_DONE(hada_allocated(before = hada_alloc(values, sizeof *before, "a reference", err)));
    HADA_TRY_OR_DONE(hada_allocated(gradient = hada_alloc(values, sizeof *gradient, "a reference", err)));
    HADA_TRY_OR_DONE(hada_allocated(responses = hada_alloc(count + 1, sizeof *responses, "a reference", err)));
    for (int first = 0; first < channels; first += seen, image += values, out += values) {
        memcpy(now, image, values * sizeof *now);
        memcpy(before, image, values * sizeof *before);
        for (int number = 0; number < HADA_RIDGE_STEPS; number++) {
            const hada_ridge_step step = hada_ridge_step_of(number, noise);
            hada_ref_ridge_respond(now, seen, rows, cols, number, responses);
            for (size_t i = 0; i < count; i++) {
                const size_t k = i / (count / FILTERS);
                const double t = step.in[k] * responses[i];
                responses[i] = step.out[k] * t / (1.0 + t * t);
            }
            hada_ref_ridge_gather(responses, seen, rows, cols, number, gradient);
            for (size_t i = 0; i < values; i++) {
                const double next =
                    now[i] - step.length * (now[i] - image[i] + gradient[i]) + step.momentum * (now[i] - before[i]);
                before[i] = now[i];
                now[i] = step.last ? fmax(next, 0.0) : next;
            }
        }
        memcpy(out, now, values * sizeof *out);
    }
done:
    HADA_FREE(now, before, gradient, responses);
    return status;
}
