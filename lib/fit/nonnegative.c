/* Transfer functions of non-negative point spread functions: buffers, transforms and the loop. */
#include "fit/nonnegative.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "runtime/buffer.h"
#include "runtime/kernel.h"

enum { GROUP = 64 };

/* Frames whose energy is less than this many times the noise's leave the image as good as what the pairs say where
 * scenes have their mean power: by measurement (docs/filters.md). */
#define LEAST_RATIO 1e4

/* Noise that is known and faint still leaves the image this weight, so that dark frequencies have a solution. */
#define LEAST_TRUST 1e-6

struct hada_nonnegative {
    hada_slot *slot;
    int channels;
    size_t pixels; /* of a channel */
    hada_spectrum_layout layout;
    hada_fft *forward, *inverse;
    hada_buffer spectrum;     /* [channel][count] complex: guesses, then transfer functions */
    hada_buffer image, state; /* [channel][pixels] */
    cl_kernel blend, clip;
};

void hada_nonnegative_rule_init(hada_nonnegative_rule *rule)
{
    *rule = (hada_nonnegative_rule){.steps = 12, .first = 0.3, .last = 0.03, .relaxation = 1.8};
}

double hada_nonnegative_trust(double noise, double raw_energy)
{
    const double trust = LEAST_RATIO * noise / fmax(raw_energy, DBL_MIN);
    return noise > 0.0 && trust < 1.0 ? fmax(trust, LEAST_TRUST) : 1.0;
}

static hada_fft_desc describe(int rows, int cols, int channels, hada_fft_direction direction)
{
    return (hada_fft_desc){.direction = direction,
                           .rows = rows,
                           .cols = cols,
                           .batch = channels,
                           .real_rows = rows,
                           .real_cols = cols,
                           .real_pitch = (size_t)cols,
                           .real_distance = (size_t)rows * (size_t)cols};
}

/* Kernels take eight values at a time, hence the bytes beyond the last one. */
static size_t image_bytes(int rows, int cols, int channels)
{
    return (size_t)channels * (size_t)rows * (size_t)cols * sizeof(float) + 64;
}

static size_t spectrum_bytes(const hada_spectrum_layout *layout, int channels)
{
    return (size_t)channels * layout->count * 2 * sizeof(float) + 64;
}

size_t hada_nonnegative_bytes(const hada_context *context, int rows, int cols, int channels)
{
    const hada_fft_desc forward = describe(rows, cols, channels, HADA_FFT_FORWARD);
    const hada_fft_desc inverse = describe(rows, cols, channels, HADA_FFT_INVERSE);
    const hada_spectrum_layout layout = hada_fft_layout(context, rows, cols, HADA_FFT_AUTO);
    return hada_fft_bytes(context, &forward) + hada_fft_bytes(context, &inverse) + spectrum_bytes(&layout, channels) +
           2 * image_bytes(rows, cols, channels);
}

hada_status hada_nonnegative_create(hada_nonnegative **out, hada_slot *slot, int rows, int cols, int channels,
                                    hada_error *err)
{
    const hada_fft_desc forward = describe(rows, cols, channels, HADA_FFT_FORWARD);
    const hada_fft_desc inverse = describe(rows, cols, channels, HADA_FFT_INVERSE);
    const size_t image = image_bytes(rows, cols, channels);
    hada_nonnegative *plan = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY(hada_alloc((void **)&plan, 1, sizeof *plan, "point spread functions", err));
    plan->slot = slot;
    plan->channels = channels;
    plan->pixels = forward.real_distance;
    plan->layout = hada_fft_layout(slot->context, rows, cols, HADA_FFT_AUTO);
    HADA_TRY(hada_fft_create(&plan->forward, slot, &forward, err));
    HADA_TRY(hada_fft_create(&plan->inverse, slot, &inverse, err));
    HADA_TRY(hada_buffer_create(&plan->spectrum, slot->context, spectrum_bytes(&plan->layout, channels),
                                "the spectra of point spread functions", err));
    HADA_TRY(hada_buffer_create(&plan->image, slot->context, image, "point spread functions", err));
    HADA_TRY(hada_buffer_create(&plan->state, slot->context, image, "point spread functions", err));
    HADA_TRY(hada_slot_kernel(slot, "fit_nonnegative", "fit_blend", "", &plan->blend, err));
    HADA_TRY(hada_slot_kernel(slot, "fit_nonnegative", "fit_clip", "", &plan->clip, err));
done:
    if (status)
        hada_nonnegative_destroy(&plan);
    *out = plan;
    return status;
}

void hada_nonnegative_destroy(hada_nonnegative **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_nonnegative *plan = *pointer;
    *pointer = NULL;
    hada_slot_finish(plan->slot, NULL);
    hada_fft_destroy(&plan->forward);
    hada_fft_destroy(&plan->inverse);
    hada_buffer_destroy(&plan->spectrum);
    hada_buffer_destroy(&plan->image);
    hada_buffer_destroy(&plan->state);
    free(plan);
}

/* Every channel's transfer function, between its sums and (guessed) the plan's spectra. weight: of all channels, times
 * that of each (or NULL). */
static hada_status blend(hada_nonnegative *plan, int channels, const hada_buffer *sums, size_t stride,
                         const double *mean, double weight, const double *weights, int guessed, cl_mem out, size_t at,
                         hada_error *err)
{
    const size_t local = GROUP, global = ((plan->layout.count + 7) / 8 + GROUP - 1) / GROUP * GROUP;
    const cl_ulong step = stride, count = plan->layout.count;
    const cl_int has_guess = guessed;
    hada_status status = HADA_OK;
    for (int c = 0; c < channels; c++) {
        const cl_float scale = mean[c] > FLT_MIN ? (cl_float)(1.0 / mean[c]) : 0.0f; /* 0: scenes were dark */
        const cl_float share = (cl_float)(weights ? weight * weights[c] : weight);
        const cl_ulong guess_at = (cl_ulong)c * count, to = at + guess_at;
        const hada_arg args[] = {
            HADA_ARG(sums[c].mem), HADA_ARG(step),      HADA_ARG(scale), HADA_ARG(share), HADA_ARG(plan->spectrum.mem),
            HADA_ARG(guess_at),    HADA_ARG(has_guess), HADA_ARG(out),   HADA_ARG(to),    HADA_ARG(count)};
        hada_slot_cost(plan->slot, (guessed ? 28.0 : 20.0) * (double)count, 9.0 * (double)count);
        HADA_TRY(
            hada_slot_launch(plan->slot, plan->blend, "fit_blend", 1, &global, &local, args, HADA_COUNT(args), err));
    }
done:
    return status;
}

static hada_status clip(hada_nonnegative *plan, int channels, double over, double keep, int first, int last,
                        hada_error *err)
{
    const cl_ulong vectors = ((size_t)channels * plan->pixels + 7) / 8;
    const size_t local = GROUP, global = ((size_t)vectors + GROUP - 1) / GROUP * GROUP;
    const cl_float relaxation = (cl_float)over, dual = (cl_float)keep;
    const cl_int start = first, end = last;
    const hada_arg args[] = {HADA_ARG(plan->image.mem), HADA_ARG(plan->state.mem),
                             HADA_ARG(relaxation),      HADA_ARG(dual),
                             HADA_ARG(start),           HADA_ARG(end),
                             HADA_ARG(vectors)};
    hada_slot_cost(plan->slot, (first ? 96.0 : 128.0) * (double)vectors, 64.0 * (double)vectors);
    return hada_slot_launch(plan->slot, plan->clip, "fit_clip", 1, &global, &local, args, HADA_COUNT(args), err);
}

hada_status hada_nonnegative_solve(hada_nonnegative *plan, const hada_nonnegative_rule *rule, int channels,
                                   const hada_buffer *sums, size_t stride, const double *mean, const double *trust,
                                   cl_mem out, size_t at, hada_error *err)
{
    const double factor = rule->steps > 1 ? pow(rule->last / rule->first, 1.0 / (rule->steps - 1)) : 1.0;
    hada_status status = HADA_OK;
    if (rule->steps < 1 || !(rule->first > 0.0) || !(rule->last > 0.0) || channels < 1 || channels > plan->channels)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "non-negative point spread functions: steps, weights and channels "
                         "must be positive, channels at most %d",
                         plan->channels);
    double weight = rule->first;
    for (int i = 0; i < rule->steps; i++, weight *= factor) {
        const int last = i + 1 == rule->steps;
        HADA_TRY(blend(plan, channels, sums, stride, mean, weight, NULL, i > 0, plan->spectrum.mem, 0, err));
        HADA_TRY(hada_fft_inverse(plan->inverse, channels, plan->spectrum.mem, 0, plan->image.mem, 0, NULL, err));
        HADA_TRY(clip(plan, channels, rule->relaxation, 1.0 / factor, !i, last, err));
        HADA_TRY(hada_fft_forward(plan->forward, channels, plan->image.mem, 0, plan->spectrum.mem, 0, err));
    }
    HADA_TRY(blend(plan, channels, sums, stride, mean, 1.0, trust, 1, out, at, err));
done:
    return status;
}
