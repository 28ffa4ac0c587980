/* Transfer functions of non-negative point spread functions: buffers, transforms and the loop. */
#include "fit/nonnegative.h"

#include <float.h>

#include "launch/fit_nonnegative.h"

enum { GROUP = 64 };

/* Frames whose energy is less than this many times the noise's leave the image as good as what the pairs say where
 * scenes have their mean power: by measurement (docs/explanation/learning-a-camera.md). */
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

/* Kernels take vectors of eight complex values at most, hence the bytes beyond the last one. */
enum { VECTOR_BYTES = HADA_FIT_VECTOR * 2 * sizeof(float) };

hada_status hada_nonnegative_create(hada_nonnegative **out, hada_slot *slot, int rows, int cols, int channels,
                                    hada_error *err)
{
    const hada_rectangle whole = {0, 0, rows, cols};
    const hada_fft_desc forward = hada_fft_of(HADA_FFT_FORWARD, rows, cols, channels, whole);
    const hada_fft_desc inverse = hada_fft_of(HADA_FFT_INVERSE, rows, cols, channels, whole);
    const size_t image = (size_t)channels * forward.real_distance * sizeof(float) + VECTOR_BYTES;
    hada_nonnegative *plan = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(plan, 1, "point spread functions", err));
    plan->slot = slot;
    plan->channels = channels;
    plan->pixels = forward.real_distance;
    plan->layout = hada_fft_layout(slot->context, rows, cols, HADA_FFT_AUTO);
    HADA_TRY_OR_DONE(hada_fft_create(&plan->forward, slot, &forward, err));
    HADA_TRY_OR_DONE(hada_fft_create(&plan->inverse, slot, &inverse, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&plan->spectrum, slot->context,
                                        hada_spectra_bytes(&plan->layout, channels) + VECTOR_BYTES,
                                        "the spectra of point spread functions", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&plan->image, slot->context, image, "point spread functions", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&plan->state, slot->context, image, "point spread functions", err));
    HADA_TRY_OR_DONE(hada_prepare_fit_nonnegative(slot, HADA_PROGRAM_FIT_NONNEGATIVE_DEFAULT, err));
done:
    if (status)
        hada_nonnegative_destroy(&plan);
    *out = plan;
    return status;
}

void hada_nonnegative_destroy(hada_nonnegative **pointer)
{
    hada_nonnegative *plan = hada_taken(pointer);
    if (!plan)
        return;
    hada_slot_finish(plan->slot, NULL);
    hada_fft_destroy(&plan->forward);
    hada_fft_destroy(&plan->inverse);
    HADA_DESTROY_BUFFERS(&plan->spectrum, &plan->image, &plan->state);
    free(plan);
}

/* Every channel's transfer function, between the data and (guessed) the plan's spectra. weight: of all channels, times
 * that of each (or NULL). */
static hada_status blend(hada_nonnegative *plan, int channels, const hada_nonnegative_data *data, double weight,
                         const double *weights, int guessed, cl_mem out, size_t at, hada_error *err)
{
    const size_t count = plan->layout.count, vectors = hada_divide_up(count, HADA_FIT_VECTOR);
    const hada_range range = hada_range_of(vectors, GROUP, 1, 1);
    for (int c = 0; c < channels; c++) {
        const size_t first = (size_t)c * count;
        const hada_fit_image image = {.first = at + first, .count = count, .vectors = vectors, .stride = data->stride};
        const hada_fit_blend_rule rule = {.scale = data->mean[c] > FLT_MIN ? (float)(1.0 / data->mean[c])
                                                                           : 0.0f, /* 0: scenes were dark */
                                          .weight = (float)(weights ? weight * weights[c] : weight)};
        hada_slot_cost(plan->slot, (guessed ? 28.0 : 20.0) * (double)count, 9.0 * (double)count);
        HADA_TRY(
            hada_launch_fit_blend(plan->slot, HADA_PROGRAM_FIT_NONNEGATIVE_DEFAULT, &range, err,
                                  .sums = data->sums[c].mem, .filled = data->filled ? data->filled : plan->spectrum.mem,
                                  .is_filled = data->filled != NULL, .guess = plan->spectrum.mem, .guess_first = first,
                                  .guessed = guessed, .out = out, .image = image, .rule = rule));
    }
    return HADA_OK;
}

static hada_status clip(hada_nonnegative *plan, int channels, hada_fit_clip_rule rule, hada_error *err)
{
    const size_t vectors = hada_divide_up((size_t)channels * plan->pixels, HADA_FIT_VECTOR);
    const hada_range range = hada_range_of(vectors, GROUP, 1, 1);
    const double values = (double)vectors * HADA_FIT_VECTOR;
    hada_slot_cost(plan->slot, (rule.start ? 12.0 : 16.0) * values, 8.0 * values);
    return hada_launch_fit_clip(plan->slot, HADA_PROGRAM_FIT_NONNEGATIVE_DEFAULT, &range, err, .x = plan->image.mem,
                                .v = plan->state.mem, .rule = rule, .vectors = vectors);
}

/* From transfer functions to the next guess, by a step of their images. */
static hada_status constrain(hada_nonnegative *plan, int channels, cl_mem transfers, hada_fit_clip_rule rule,
                             hada_error *err)
{
    HADA_TRY(hada_fft_inverse(plan->inverse, channels, transfers, 0, plan->image.mem, 0, NULL, err));
    HADA_TRY(clip(plan, channels, rule, err));
    return hada_fft_forward(plan->forward, channels, plan->image.mem, 0, plan->spectrum.mem, 0, err);
}

hada_status hada_nonnegative_step(hada_nonnegative *plan, int channels, const hada_nonnegative_data *data,
                                  const hada_nonnegative_weights *at, cl_mem out, hada_error *err)
{
    const hada_fit_clip_rule rule = {
        .relaxation = (float)at->relaxation, .dual_scale = (float)at->dual_scale, .start = at->start, .last = at->last};
    const cl_mem transfers = out ? out : plan->spectrum.mem;
    HADA_TRY(blend(plan, channels, data, at->weight, NULL, !at->start, transfers, 0, err));
    return constrain(plan, channels, transfers, rule, err);
}

hada_status hada_nonnegative_begin(hada_nonnegative *plan, int channels, cl_mem transfers, hada_error *err)
{
    const hada_fit_clip_rule rule = {.relaxation = 1.0f, .dual_scale = 0.0f, .start = 1, .last = 1};
    return constrain(plan, channels, transfers, rule, err);
}

/* The image, or (last 0) the guess of a step to come, as the plan's spectra: without relaxation the state stays. */
static hada_status bring_out(hada_nonnegative *plan, int channels, int last, hada_error *err)
{
    const hada_fit_clip_rule rule = {.relaxation = 0.0f, .dual_scale = 1.0f, .last = last};
    HADA_TRY(clip(plan, channels, rule, err));
    return hada_fft_forward(plan->forward, channels, plan->image.mem, 0, plan->spectrum.mem, 0, err);
}

hada_status hada_nonnegative_end(hada_nonnegative *plan, int channels, const hada_nonnegative_data *data,
                                 const double *trust, cl_mem out, hada_error *err)
{
    HADA_TRY(bring_out(plan, channels, 1, err));
    HADA_TRY(blend(plan, channels, data, 1.0, trust, 1, out, 0, err));
    return bring_out(plan, channels, 0, err);
}

hada_status hada_nonnegative_solve(hada_nonnegative *plan, const hada_nonnegative_rule *rule, int channels,
                                   const hada_buffer *sums, size_t stride, const double *mean, const double *trust,
                                   cl_mem out, size_t at, hada_error *err)
{
    const double factor = rule->steps > 1 ? pow(rule->last / rule->first, 1.0 / (rule->steps - 1)) : 1.0;
    const hada_nonnegative_data data = {.sums = sums, .stride = stride, .mean = mean};
    if (rule->steps < 1 || !(rule->first > 0.0) || !(rule->last > 0.0) || channels < 1 || channels > plan->channels)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "non-negative point spread functions: steps, weights and channels "
                         "must be positive, channels at most %d",
                         plan->channels);
    double weight = rule->first;
    for (int i = 0; i < rule->steps; i++, weight *= factor) {
        const hada_nonnegative_weights step = {.weight = weight,
                                               .relaxation = rule->relaxation,
                                               .dual_scale = 1.0 / factor,
                                               .start = i == 0,
                                               .last = i + 1 == rule->steps};
        HADA_TRY(hada_nonnegative_step(plan, channels, &data, &step, NULL, err));
    }
    return blend(plan, channels, &data, 1.0, trust, 1, out, at, err);
}
