/* Conjugate gradients for filters judged in the window. */
#include "fit/window.h"

#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "runtime/kernel.h"

enum { GROUP = 64 };

/* A channel's place in the recurrences of a weight. */
typedef struct shifted {
    double shift;        /* sigma less that of the first weight */
    double zeta, before; /* its residual is zeta times the first weight's */
} shifted;

typedef struct progress {
    double start, square;      /* <z, z> at the start and now */
    double step, keep;         /* of this round */
    double old_step, old_keep; /* of the round before */
    shifted of[HADA_FIT_WEIGHTS];
} progress;

struct hada_fit_window {
    hada_fitter *fitter;
    hada_fft *inverse;
    int most, count, rounds;
    double alpha, lambda;
    const double *raw_energy;
    double outside[HADA_FIT_WEIGHTS];
    hada_buffer z, t;                                     /* [channel][count] complex: residual; product with T */
    hada_buffer x[HADA_FIT_WEIGHTS], p[HADA_FIT_WEIGHTS]; /* filters and directions */
    hada_buffer partial;                                  /* [channel][chunks] */
    float *sums, *planes;
    double *total; /* per channel */
    progress *channel;
};

void hada_fit_window_destroy(hada_fit_window **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_fit_window *window = *pointer;
    *pointer = NULL;
    hada_slot_finish(window->fitter->slot, NULL);
    hada_fft_destroy(&window->inverse);
    hada_buffer_destroy(&window->z);
    hada_buffer_destroy(&window->t);
    hada_buffer_destroy(&window->partial);
    for (int s = 0; s < window->most; s++) {
        hada_buffer_destroy(&window->x[s]);
        hada_buffer_destroy(&window->p[s]);
    }
    free(window->sums);
    free(window->planes);
    free(window->total);
    free(window->channel);
    free(window);
}

hada_status hada_fit_window_create(hada_fit_window **out, hada_fitter *fitter, int most, hada_error *err)
{
    const size_t channels = (size_t)fitter->info.channels, sums = channels * (size_t)fitter->chunks;
    const size_t bytes = channels * fitter->layout.count * 8 + 64;
    const hada_fft_desc desc = hada_fitter_describe(fitter, HADA_FFT_INVERSE, 1);
    hada_fit_window *window;
    *out = NULL;
    hada_status status = hada_alloc((void **)&window, 1, sizeof *window, "filters judged in the window", err);
    if (status)
        return status;
    window->fitter = fitter;
    window->most = most;
    status = hada_fft_create(&window->inverse, fitter->slot, &desc, err);
    if (!status)
        status = hada_buffer_create(&window->z, fitter->context, bytes, "residuals of filters", err);
    if (!status)
        status = hada_buffer_create(&window->t, fitter->context, bytes, "residuals of filters", err);
    for (int s = 0; !status && s < most; s++) {
        status = hada_buffer_create(&window->x[s], fitter->context, bytes, "filters judged in the window", err);
        if (!status)
            status = hada_buffer_create(&window->p[s], fitter->context, bytes, "directions of filters", err);
    }
    if (!status)
        status = hada_buffer_create(&window->partial, fitter->context, 4 * sums, "partial sums", err);
    if (!status)
        status = hada_alloc_raw((void **)&window->sums, sums, sizeof(float), "partial sums", err);
    if (!status)
        status = hada_alloc_raw((void **)&window->planes, fitter->scene.bytes, 1, "planes", err);
    if (!status)
        status = hada_alloc((void **)&window->total, channels, sizeof(double), "a fit", err);
    if (!status)
        status = hada_alloc((void **)&window->channel, channels, sizeof *window->channel, "a fit", err);
    if (status)
        hada_fit_window_destroy(&window);
    *out = window;
    return status;
}

/* x += step p, p = turn z + keep p, of a channel and a weight. */
static hada_status move(hada_fit_window *window, int c, int s, double step, double turn, double keep, hada_error *err)
{
    hada_fitter *fitter = window->fitter;
    const cl_ulong offset = (cl_ulong)c * fitter->layout.count, count = fitter->layout.count;
    const cl_ulong vectors = fitter->vectors;
    const cl_float along = (cl_float)step, fresh = (cl_float)turn, old = (cl_float)keep;
    const hada_arg args[] = {HADA_ARG(window->x[s].mem),
                             HADA_ARG(window->p[s].mem),
                             HADA_ARG(window->z.mem),
                             HADA_ARG(offset),
                             HADA_ARG(count),
                             HADA_ARG(along),
                             HADA_ARG(fresh),
                             HADA_ARG(old),
                             HADA_ARG(vectors)};
    hada_slot_cost(fitter->slot, 320.0 * (double)vectors, 80.0 * (double)vectors);
    return hada_fitter_launch(fitter, "fit_window", "fit_move", args, HADA_COUNT(args), err);
}

/* fit_apply (one: p, other: t) or fit_descend (z, t), whose arguments are the same but for one number. */
static hada_status reduce(hada_fit_window *window, const char *name, int c, cl_mem one, double number, hada_error *err)
{
    hada_fitter *fitter = window->fitter;
    const size_t local = fitter->context->shape == HADA_SHAPE_LANES ? 1 : 32;
    const size_t global = ((size_t)fitter->chunks + local - 1) / local * local;
    const cl_ulong offset = (cl_ulong)c * fitter->layout.count, count = fitter->layout.count;
    const cl_ulong stride = fitter->stride, vectors = fitter->vectors;
    const cl_float alpha = (cl_float)window->alpha, ridge = (cl_float)(window->lambda * window->raw_energy[c]);
    const cl_float value = (cl_float)number;
    const cl_int chunks = fitter->chunks, first = c * chunks;
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(fitter->slot, "fit_window", name, fitter->macros, &kernel, err);
    const hada_arg args[] = {HADA_ARG(one),
                             HADA_ARG(window->t.mem),
                             HADA_ARG(offset),
                             HADA_ARG(count),
                             HADA_ARG(fitter->sums[c].mem),
                             HADA_ARG(fitter->pool[c].mem),
                             HADA_ARG(stride),
                             HADA_ARG(fitter->weights.mem),
                             HADA_ARG(alpha),
                             HADA_ARG(ridge),
                             HADA_ARG(value),
                             HADA_ARG(window->partial.mem),
                             HADA_ARG(first),
                             HADA_ARG(chunks),
                             HADA_ARG(vectors)};
    hada_slot_cost(fitter->slot, (fitter->sum_count > 4 ? 480.0 : 288.0) * (double)vectors, 120.0 * (double)vectors);
    return status ? status
                  : hada_slot_launch(fitter->slot, kernel, name, 1, &global, &local, args, HADA_COUNT(args), err);
}

/* The sums over frequencies that reduce() left, per channel. */
static hada_status add_up(hada_fit_window *window, hada_error *err)
{
    const size_t chunks = (size_t)window->fitter->chunks, channels = (size_t)window->fitter->info.channels;
    hada_status status =
        hada_buffer_read(&window->partial, window->fitter->slot, 0, window->sums, 4 * channels * chunks, err);
    for (size_t c = 0; !status && c < channels; c++) {
        double sum = 0.0;
        for (size_t i = 0; i < chunks; i++)
            sum += window->sums[c * chunks + i];
        window->total[c] = sum;
        if (!isfinite(sum))
            status = hada_fail(err, HADA_ERROR_NUMERIC,
                               "the fit of filters in the window left single precision; give a larger lambda, or "
                               "outside = 1");
    }
    return status;
}

hada_status hada_fit_window_begin(hada_fit_window *window, int z, double alpha, double lambda, const double *outside,
                                  int count, hada_error *err)
{
    hada_fitter *fitter = window->fitter;
    const int channels = fitter->info.channels;
    const double first = outside[0] / (1.0 - outside[0]);
    window->alpha = alpha;
    window->lambda = lambda;
    window->count = count;
    window->rounds = 0;
    window->raw_energy = fitter->depth[z].raw_energy;
    hada_status status = hada_buffer_clear(&window->t, fitter->slot, 0, window->t.bytes, err);
    for (int s = 0; !status && s < count; s++) {
        window->outside[s] = outside[s];
        status = hada_buffer_clear(&window->x[s], fitter->slot, 0, window->x[s].bytes, err);
        if (!status)
            status = hada_buffer_clear(&window->p[s], fitter->slot, 0, window->p[s].bytes, err);
    }
    for (int c = 0; !status && c < channels; c++)
        status = hada_fitter_solve_filter(fitter, c, alpha, lambda * window->raw_energy[c], window->z.mem,
                                          (size_t)c * fitter->layout.count, err);
    for (int c = 0; !status && c < channels; c++) {
        window->channel[c] = (progress){.old_step = 1.0};
        for (int s = 0; !status && s < count; s++) {
            window->channel[c].of[s] = (shifted){outside[s] / (1.0 - outside[s]) - first, 1.0, 1.0};
            status = move(window, c, s, 0.0, 1.0, 0.0, err);
        }
        if (!status)
            status = reduce(window, "fit_descend", c, window->z.mem, 0.0, err);
    }
    if (!status)
        status = add_up(window, err);
    for (int c = 0; !status && c < channels; c++)
        window->channel[c].start = window->channel[c].square = window->total[c];
    return status;
}

static hada_fft_filter product(const hada_fitter *fitter, cl_mem filters)
{
    return (hada_fft_filter){.product = fitter->sum_count == HADA_FIT_SUMS ? HADA_FFT_COMPLEX : HADA_FFT_SPLIT,
                             .filter = filters,
                             .spectrum_count = fitter->info.channels};
}

hada_status hada_fit_window_pair(hada_fit_window *window, hada_error *err)
{
    hada_fitter *fitter = window->fitter;
    const int channels = fitter->info.channels;
    const hada_fft_filter filter = product(fitter, window->p[0].mem);
    const cl_ulong vectors = ((size_t)channels * fitter->layout.count + 7) / 8;
    const size_t local = GROUP, global = ((size_t)vectors + GROUP - 1) / GROUP * GROUP;
    cl_kernel kernel;
    hada_status status =
        hada_fft_inverse(window->inverse, channels, fitter->b.mem, 0, fitter->scene.mem, 0, &filter, err);
    if (!status)
        status = hada_fft_forward(fitter->scene_fft, channels, fitter->scene.mem, 0, fitter->x.mem, 0, err);
    if (!status)
        status = hada_slot_kernel(fitter->slot, "fit_window", "fit_gather", fitter->macros, &kernel, err);
    const hada_arg args[] = {HADA_ARG(fitter->x.mem), HADA_ARG(fitter->b.mem), HADA_ARG(window->t.mem),
                             HADA_ARG(vectors)};
    hada_slot_cost(fitter->slot, 256.0 * (double)vectors, 80.0 * (double)vectors);
    return status
               ? status
               : hada_slot_launch(fitter->slot, kernel, "fit_gather", 1, &global, &local, args, HADA_COUNT(args), err);
}

/* The factors of a weight's recurrences after a round: its step, and what turns the residual into its direction. */
static void follow(progress *at, shifted *of, double *step, double *turn, double *keep)
{
    const double over = of->zeta * of->before * at->old_step;
    const double under =
        at->step * at->old_keep * (of->before - of->zeta) + of->before * at->old_step * (1.0 + of->shift * at->step);
    const double zeta = under > 0.0 ? over / under : 0.0, ratio = of->zeta > 0.0 ? zeta / of->zeta : 0.0;
    *step = at->step * ratio;
    *turn = zeta;
    *keep = at->keep * ratio * ratio;
    of->before = of->zeta;
    of->zeta = zeta;
}

hada_status hada_fit_window_round(hada_fit_window *window, int *settled, hada_error *err)
{
    hada_fitter *fitter = window->fitter;
    const int channels = fitter->info.channels;
    const double shift = window->outside[0] / (1.0 - window->outside[0]);
    hada_status status = HADA_OK;
    for (int c = 0; !status && c < channels; c++)
        status = reduce(window, "fit_apply", c, window->p[0].mem, shift, err);
    if (!status)
        status = add_up(window, err);
    for (int c = 0; !status && c < channels; c++) {
        progress *at = &window->channel[c];
        at->step = window->total[c] > 0.0 ? at->square / window->total[c] : 0.0; /* a dark channel has no filter */
        status = reduce(window, "fit_descend", c, window->z.mem, at->step, err);
    }
    if (!status)
        status = add_up(window, err);
    *settled = ++window->rounds == HADA_FIT_ROUNDS;
    double left = 0.0;
    for (int c = 0; !status && c < channels; c++) {
        progress *at = &window->channel[c];
        const double square = window->total[c];
        at->keep = at->square > 0.0 ? square / at->square : 0.0;
        for (int s = 0; !status && s < window->count; s++) {
            double along, turn, keep;
            follow(at, &at->of[s], &along, &turn, &keep);
            left = fmax(left, at->start > 0.0 ? turn * sqrt(square / at->start) : 0.0);
            status = move(window, c, s, along / (1.0 - window->outside[s]), turn, keep, err);
        }
        at->square = square;
        at->old_step = at->step > 0.0 ? at->step : 1.0;
        at->old_keep = at->keep;
    }
    *settled |= left < HADA_FIT_SETTLED;
    return status ? status : hada_buffer_clear(&window->t, fitter->slot, 0, window->t.bytes, err);
}

const hada_buffer *hada_fit_window_filters(const hada_fit_window *window, int weight)
{
    return weight < 0 ? &window->z : &window->x[weight];
}

hada_status hada_fit_window_error(hada_fit_window *window, int weight, double *error, hada_error *err)
{
    hada_fitter *fitter = window->fitter;
    const size_t count = fitter->scene.bytes / sizeof(float);
    const hada_fft_filter filter = product(fitter, hada_fit_window_filters(window, weight)->mem);
    hada_status status =
        hada_fft_inverse(window->inverse, fitter->info.channels, fitter->b.mem, 0, fitter->scene.mem, 0, &filter, err);
    if (!status)
        status = hada_buffer_read(&fitter->scene, fitter->slot, 0, window->planes, fitter->scene.bytes, err);
    double sum = 0.0;
    for (size_t i = 0; !status && i < count; i++) {
        const double difference = (double)window->planes[i] - fitter->scene_pixels[i];
        sum += difference * difference;
    }
    *error = sum / (double)count;
    return status;
}
