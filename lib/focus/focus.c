#include "focus/focus.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "program/kernel.h"

#define LOCAL 16 /* items along x in a work-group of the window kernels, which take 8 columns each */
#define WIDE  64 /* of the others */

typedef enum image_name { BEST, BEFORE, AFTER, SECOND, LAST, WEIGHT_SUM, IMAGES } image_name;

struct hada_focus {
    hada_slot *slot;
    hada_focus_options options;
    int channels, rows, cols, depths;
    int radius, halo; /* halo: the radius rounded up to vectors of 8 columns */
    int wide;         /* vectors of 8 columns in a row of the response, with a halo on either side */
    int vectors;      /* in a row of the measure */
    double noise_mean, noise_deviation;

    unsigned char *competing; /* per depth */
    int competing_count;
    int begun, next; /* depths below `next` have come */
    int last;        /* the last depth that competed, -1: none yet */
    int seen;        /* depths that competed so far */

    hada_buffer weights, inverse_distances;
    hada_buffer light, response, smooth, measure;
    hada_buffer image[IMAGES], best_depth, fused;
    hada_buffer noise_bins, loser_bins;
    int64_t counted;                      /* pixels in the device's counts, which are int */
    int64_t *noise_counts, *loser_counts; /* the counts before them */
};

static int up_to(int n, int multiple)
{
    return (n + multiple - 1) / multiple * multiple;
}

static int window_radius(const hada_focus_options *options)
{
    return (int)ceil(3.0 * options->window_sigma);
}

/* A buffer of the object, its size in bytes and its name: one list serves the estimate and the allocation. */
typedef struct part {
    size_t offset; /* of the hada_buffer in the object */
    size_t bytes;
    const char *name;
} part;
#define PARTS (10 + IMAGES)

static void list_parts(const hada_focus_desc *desc, part *parts)
{
    const int radius = window_radius(&desc->options), halo = up_to(radius, 8), cols = up_to(desc->cols, 8);
    const size_t rows = (size_t)desc->rows, pixels = rows * (size_t)desc->cols,
                 wide = (size_t)(cols + 2 * halo) * sizeof(float), border = 2 * (size_t)radius;
    size_t n = 0;
    parts[n++] = (part){offsetof(hada_focus, weights), (size_t)(2 * radius + 1) * sizeof(float), "the focus window"};
    parts[n++] = (part){offsetof(hada_focus, inverse_distances), (size_t)desc->depths * sizeof(float), "the distances"};
    parts[n++] =
        (part){offsetof(hada_focus, light), (rows + border + 2) * (wide + 16 * sizeof(float)), "the luminance"};
    parts[n++] = (part){offsetof(hada_focus, response), (rows + border) * wide, "the focus response"};
    parts[n++] = (part){offsetof(hada_focus, smooth), rows * wide, "the focus response"};
    parts[n++] = (part){offsetof(hada_focus, measure), rows * (size_t)cols * sizeof(float), "the focus measure"};
    for (size_t i = 0; i < IMAGES; i++)
        parts[n++] = (part){offsetof(hada_focus, image) + i * sizeof(hada_buffer), pixels * sizeof(float),
                            "the running best of the focus"};
    parts[n++] = (part){offsetof(hada_focus, best_depth), pixels * sizeof(cl_int), "the best depths"};
    parts[n++] =
        (part){offsetof(hada_focus, fused), pixels * (size_t)desc->channels * sizeof(float), "the all-in-focus image"};
    parts[n++] = (part){offsetof(hada_focus, noise_bins), HADA_FOCUS_BINS * sizeof(cl_int), "the noise counts"};
    parts[n++] = (part){offsetof(hada_focus, loser_bins), HADA_FOCUS_BINS * sizeof(cl_int), "the noise counts"};
}

size_t hada_focus_bytes(const hada_focus_desc *desc)
{
    part parts[PARTS];
    size_t bytes = 0;
    list_parts(desc, parts);
    for (size_t i = 0; i < PARTS; i++)
        bytes += parts[i].bytes;
    return bytes;
}

enum { TABLES = 2 }; /* the first parts stay as they are from frame to frame; the others are scratch */

hada_status hada_focus_note(const hada_focus_desc *desc, hada_room *room, hada_error *err)
{
    part parts[PARTS];
    hada_status status = HADA_OK;
    list_parts(desc, parts);
    for (size_t i = TABLES; i < PARTS && !status; i++)
        status = hada_room_note(room, parts[i].bytes, parts[i].name, err);
    return status;
}

/* The window's weights and the distances go to the device; what noise does to the measure is worked out. */
static hada_status fill_tables(hada_focus *focus, const hada_focus_desc *desc, hada_error *err)
{
    const int taps = 2 * focus->radius + 1;
    void *memory = NULL, *singles = NULL;
    const size_t most = (size_t)(taps > desc->depths ? taps : desc->depths);
    hada_status status;
    if ((status = hada_alloc(&memory, (size_t)taps, sizeof(double), "the focus window", err)) ||
        (status = hada_alloc(&singles, most, sizeof(float), "the focus window", err)))
        goto done;
    double *weights = memory, sum = 0.0;
    float *single = singles;
    for (int k = 0; k < taps; k++) {
        const double x = (k - focus->radius) / desc->options.window_sigma;
        sum += weights[k] = exp(-0.5 * x * x);
    }
    for (int k = 0; k < taps; k++)
        single[k] = (float)(weights[k] /= sum);
    hada_focus_noise_moments(desc->options.measure, weights, focus->radius, &focus->noise_mean,
                             &focus->noise_deviation);
    if ((status = hada_buffer_write(&focus->weights, focus->slot, 0, single, (size_t)taps * sizeof(float), err)))
        goto done;
    for (int i = 0; i < desc->depths; i++)
        single[i] = (float)(1.0 / desc->distances_mm[i]);
    status =
        hada_buffer_write(&focus->inverse_distances, focus->slot, 0, single, (size_t)desc->depths * sizeof(float), err);
done:
    free(memory);
    free(singles);
    return status;
}

hada_status hada_focus_create(hada_focus **out, hada_slot *slot, const hada_focus_desc *desc, hada_error *err)
{
    *out = NULL;
    void *memory;
    hada_status status = hada_focus_check(desc, err);
    if (status || (status = hada_alloc(&memory, 1, sizeof(hada_focus), "a focus object", err)))
        return status;
    hada_focus *focus = memory;
    *focus = (hada_focus){.slot = slot,
                          .options = desc->options,
                          .channels = desc->channels,
                          .rows = desc->rows,
                          .cols = desc->cols,
                          .depths = desc->depths,
                          .radius = window_radius(&desc->options)};
    focus->halo = up_to(focus->radius, 8);
    focus->vectors = up_to(desc->cols, 8) / 8;
    focus->wide = focus->vectors + focus->halo / 4;
    if (!(status = hada_alloc(&memory, (size_t)desc->depths, 1, "a focus object", err)))
        focus->competing = memory;
    if (!status && !(status = hada_alloc(&memory, 2 * HADA_FOCUS_BINS, sizeof(int64_t), "the noise counts", err))) {
        focus->noise_counts = memory;
        focus->loser_counts = focus->noise_counts + HADA_FOCUS_BINS;
    }
    part parts[PARTS];
    list_parts(desc, parts);
    for (size_t i = 0; i < PARTS && !status; i++) {
        hada_buffer *buffer = (hada_buffer *)(void *)((char *)focus + parts[i].offset);
        status = i < TABLES ? hada_buffer_create(buffer, slot->context, parts[i].bytes, parts[i].name, err)
                            : hada_scratch_create(buffer, slot, parts[i].bytes, parts[i].name, err);
    }
    if (!status)
        status = fill_tables(focus, desc, err);
    if (status)
        hada_focus_destroy(&focus);
    *out = focus;
    return status;
}

void hada_focus_destroy(hada_focus **focus)
{
    hada_focus *f = focus ? *focus : NULL;
    if (!f)
        return;
    *focus = NULL;
    hada_slot_finish(f->slot, NULL);
    hada_buffer *const buffers[] = {&f->weights,    &f->inverse_distances, &f->light, &f->response,
                                    &f->smooth,     &f->measure,           &f->fused, &f->best_depth,
                                    &f->noise_bins, &f->loser_bins};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
    for (size_t i = 0; i < IMAGES; i++)
        hada_buffer_destroy(&f->image[i]);
    free(f->noise_counts);
    free(f->competing);
    free(f);
}

static hada_status clear_counts(hada_focus *f, hada_error *err)
{
    const size_t bytes = HADA_FOCUS_BINS * sizeof(cl_int);
    f->counted = 0;
    hada_status status = hada_buffer_clear(&f->noise_bins, f->slot, 0, bytes, err);
    return status ? status : hada_buffer_clear(&f->loser_bins, f->slot, 0, bytes, err);
}

/* Adds the device's counts to the host's, which are large enough for any stack. */
static hada_status take_counts(hada_focus *f, hada_error *err)
{
    const hada_buffer *const from[] = {&f->noise_bins, &f->loser_bins};
    int64_t *const to[] = {f->noise_counts, f->loser_counts};
    int *bins;
    hada_status status = hada_alloc((void **)&bins, HADA_FOCUS_BINS, sizeof *bins, "the noise counts", err);
    for (int k = 0; !status && k < 2; k++) {
        status = hada_buffer_read(from[k], f->slot, 0, bins, HADA_FOCUS_BINS * sizeof *bins, err);
        for (int i = 0; !status && i < HADA_FOCUS_BINS; i++)
            to[k][i] += bins[i];
    }
    free(bins);
    return status ? status : clear_counts(f, err);
}

hada_status hada_focus_begin(hada_focus *focus, const unsigned char *competing, hada_error *err)
{
    int count = 0;
    for (int i = 0; i < focus->depths; i++)
        count += focus->competing[i] = !competing || competing[i];
    if (!count)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "no depth competes for the focus; choose at least one");
    focus->competing_count = count;
    focus->begun = 1;
    focus->next = 0;
    focus->last = -1;
    focus->seen = 0;
    memset(focus->noise_counts, 0, 2 * HADA_FOCUS_BINS * sizeof *focus->noise_counts);
    return clear_counts(focus, err);
}

/* Luminance of a plane with its edges repeated, as far as window and edge filter reach. */
static hada_status luminance(hada_focus *f, cl_mem planes, cl_ulong offset, hada_error *err)
{
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(f->slot, "focus", "focus_luminance", "", &kernel, err);
    if (status)
        return status;
    const int border_rows = f->radius + 1, border_cols = f->halo + 8, pitch = 8 * f->wide + 16;
    const size_t local[2] = {WIDE, 1}, global[2] = {(size_t)up_to(pitch, WIDE), (size_t)(f->rows + 2 * border_rows)};
    const hada_arg args[] = {HADA_ARG(planes),      HADA_ARG(offset),  HADA_ARG(f->channels),
                             HADA_ARG(f->rows),     HADA_ARG(f->cols), HADA_ARG(border_rows),
                             HADA_ARG(border_cols), HADA_ARG(pitch),   HADA_ARG(f->light.mem)};
    hada_slot_cost(f->slot, 4.0 * ((double)f->channels * f->rows * f->cols + (double)pitch * (double)global[1]),
                   f->channels == 3 ? 5.0 * f->rows * f->cols : 0);
    return hada_slot_launch(f->slot, kernel, "focus_luminance", 2, global, local, args, HADA_COUNT(args), err);
}

/* The windowed response (contrast or energy) of the luminance. second: its root is multiplied into the measure, and the
 * noise, which the first one counted, is not counted again. */
static hada_status window(hada_focus *f, hada_focus_measure kind, int second, hada_error *err)
{
    cl_kernel measure, down, across;
    hada_status status;
    if ((status = hada_slot_kernel(f->slot, "focus", "focus_measure", "", &measure, err)) ||
        (status = hada_slot_kernel(f->slot, "focus", "focus_window_down", "", &down, err)) ||
        (status = hada_slot_kernel(f->slot, "focus", "focus_window_across", "", &across, err)))
        return status;
    const int border_rows = f->radius + 1, energy = kind == HADA_FOCUS_ENERGY, count = !second, pitch = 8 * f->wide;
    const size_t rows = (size_t)f->rows, all = (size_t)up_to(f->wide, LOCAL), local[2] = {LOCAL, 1};
    const size_t global_measure[2] = {all, rows + 2 * (size_t)f->radius}, global_down[2] = {all, rows},
                 global_across[2] = {(size_t)up_to(f->vectors, LOCAL), rows};
    const hada_arg args_measure[] = {HADA_ARG(f->light.mem),     HADA_ARG(f->rows), HADA_ARG(f->cols),
                                     HADA_ARG(border_rows),      HADA_ARG(f->halo), HADA_ARG(f->wide),
                                     HADA_ARG(energy),           HADA_ARG(count),   HADA_ARG(f->response.mem),
                                     HADA_ARG(f->noise_bins.mem)};
    const hada_arg args_down[] = {HADA_ARG(f->response.mem), HADA_ARG(f->weights.mem), HADA_ARG(f->radius),
                                  HADA_ARG(f->wide), HADA_ARG(f->smooth.mem)};
    const hada_arg args_across[] = {HADA_ARG(f->smooth.mem), HADA_ARG(f->weights.mem), HADA_ARG(f->radius),
                                    HADA_ARG(f->halo),       HADA_ARG(pitch),          HADA_ARG(f->vectors),
                                    HADA_ARG(second),        HADA_ARG(f->measure.mem)};
    const double taps = 2.0 * f->radius + 1, tall = (double)pitch * (double)global_measure[1],
                 wide = (double)pitch * (double)rows, plane = 8.0 * f->vectors * (double)rows;
    hada_slot_cost(f->slot, 8.0 * tall, ((energy ? 1 : 19) + (count ? 11 : 0)) * tall);
    if ((status = hada_slot_launch(f->slot, measure, "focus_measure", 2, global_measure, local, args_measure,
                                   HADA_COUNT(args_measure), err)))
        return status;
    hada_slot_cost(f->slot, 4.0 * (tall + wide), 2.0 * taps * wide);
    if ((status = hada_slot_launch(f->slot, down, "focus_window_down", 2, global_down, local, args_down,
                                   HADA_COUNT(args_down), err)))
        return status;
    hada_slot_cost(f->slot, 4.0 * (wide + (second ? 2.0 : 1.0) * plane), (2.0 * taps + (second ? 2 : 0)) * plane);
    return hada_slot_launch(f->slot, across, "focus_window_across", 2, global_across, local, args_across,
                            HADA_COUNT(args_across), err);
}

static hada_status measure_plane(hada_focus *f, cl_mem planes, cl_ulong offset, hada_error *err)
{
    hada_status status = luminance(f, planes, offset, err);
    const int combined = f->options.measure == HADA_FOCUS_COMBINED;
    if (!status)
        status = window(f, combined ? HADA_FOCUS_ENERGY : f->options.measure, 0, err);
    return status || !combined ? status : window(f, HADA_FOCUS_CONTRAST, 1, err);
}

static hada_status select_plane(hada_focus *f, int depth, cl_mem planes, cl_ulong offset, hada_error *err)
{
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(f->slot, "focus", "focus_select", "", &kernel, err);
    if (status)
        return status;
    const int measure_pitch = 8 * f->vectors, adjacent = f->last >= 0 && f->last == depth - 1, seen = f->seen,
              weighted = f->options.fuse == HADA_FOCUS_WEIGHTED;
    const size_t local[2] = {WIDE, 1}, global[2] = {(size_t)up_to(f->cols, WIDE), (size_t)f->rows};
    const hada_arg args[] = {HADA_ARG(f->measure.mem),
                             HADA_ARG(measure_pitch),
                             HADA_ARG(planes),
                             HADA_ARG(offset),
                             HADA_ARG(f->channels),
                             HADA_ARG(f->rows),
                             HADA_ARG(f->cols),
                             HADA_ARG(depth),
                             HADA_ARG(adjacent),
                             HADA_ARG(seen),
                             HADA_ARG(weighted),
                             HADA_ARG(f->image[BEST].mem),
                             HADA_ARG(f->best_depth.mem),
                             HADA_ARG(f->image[BEFORE].mem),
                             HADA_ARG(f->image[AFTER].mem),
                             HADA_ARG(f->image[SECOND].mem),
                             HADA_ARG(f->image[LAST].mem),
                             HADA_ARG(f->fused.mem),
                             HADA_ARG(f->image[WEIGHT_SUM].mem),
                             HADA_ARG(f->loser_bins.mem)};
    /* in: measure and planes; kept: six images and the depth, the fused image and the weights */
    const double pixels = (double)f->rows * f->cols, kept = 7.0 + f->channels;
    hada_slot_cost(f->slot, 4.0 * pixels * (1.0 + f->channels + (seen ? 2.0 : 1.0) * kept), 2.0 * pixels * f->channels);
    return hada_slot_launch(f->slot, kernel, "focus_select", 2, global, local, args, HADA_COUNT(args), err);
}

hada_status hada_focus_push(hada_focus *focus, int first, int count, cl_mem planes, size_t offset, hada_error *err)
{
    if (!focus->begun)
        return hada_fail(err, HADA_ERROR_STATE, "planes came to the focus before a frame was begun");
    if (first < focus->next || count < 1 || first + count > focus->depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "depths %d to %d came to the focus of %d depths, where %d or farther was due", first,
                         first + count - 1, focus->depths, focus->next);
    const size_t plane = (size_t)focus->channels * (size_t)focus->rows * (size_t)focus->cols;
    const int64_t pixels = (int64_t)focus->rows * focus->cols;
    hada_status status = HADA_OK;
    for (int i = 0; i < count && !status; i++) {
        const int depth = first + i;
        const cl_ulong at = (cl_ulong)(offset + (size_t)i * plane);
        if (!focus->competing[depth])
            continue;
        if (focus->counted > INT_MAX - pixels)
            status = take_counts(focus, err);
        if (!status && !(status = measure_plane(focus, planes, at, err)) &&
            !(status = select_plane(focus, depth, planes, at, err))) {
            focus->last = depth;
            focus->seen++;
            focus->counted += pixels;
        }
    }
    focus->next = first + count;
    return status;
}

/* The thresholds from the counts: see hadalens/focus.h. `base`: the level of losing depths. */
static hada_status thresholds(hada_focus *f, hada_focus_report *report, double *base, hada_error *err)
{
    const double z = hada_focus_normal_quantile(f->options.false_alarm / f->competing_count);
    *report = (hada_focus_report){.coverage = NAN};
    hada_status status = take_counts(f, err);
    if (status)
        return status;
    /* Immerkaer's operator has norm 6; the median of |x| of a normal variable is 0.6745 standard deviations */
    int64_t total;
    report->noise = hada_focus_bins_median_positive(f->noise_counts, &total) / (6.0 * 0.67448975);
    double spread;
    hada_focus_bins_spread(f->loser_counts, base, &spread);
    /* energy grows with the noise, contrast and the combination with its square */
    const double unit = f->options.measure == HADA_FOCUS_ENERGY ? report->noise : report->noise * report->noise;
    report->margin = z * spread;
    report->threshold = fmax(*base + z * spread, unit * (f->noise_mean + z * f->noise_deviation));
    return HADA_OK;
}

hada_status hada_focus_finish(hada_focus *focus, cl_mem all_in_focus, size_t all_in_focus_offset, cl_mem distance_map,
                              size_t distance_offset, hada_focus_report *report, hada_error *err)
{
    hada_focus *f = focus;
    if (!f->begun || f->last < 0)
        return hada_fail(err, HADA_ERROR_STATE, "no plane came to the focus; push those that compete first");
    hada_focus_report found;
    double base;
    hada_status status = thresholds(f, &found, &base, err);
    cl_kernel kernel;
    if (status || (status = hada_slot_kernel(f->slot, "focus", "focus_finish", "", &kernel, err)))
        return status;
    const int pixels = f->rows * f->cols;
    const float threshold = (float)found.threshold, margin = (float)found.margin, level = (float)base;
    const cl_ulong aif_at = all_in_focus_offset, map_at = distance_offset;
    const size_t local = WIDE, global = (size_t)up_to(pixels, WIDE);
    const hada_arg args[] = {HADA_ARG(f->image[BEST].mem),
                             HADA_ARG(f->best_depth.mem),
                             HADA_ARG(f->image[BEFORE].mem),
                             HADA_ARG(f->image[AFTER].mem),
                             HADA_ARG(f->image[SECOND].mem),
                             HADA_ARG(f->inverse_distances.mem),
                             HADA_ARG(f->depths),
                             HADA_ARG(pixels),
                             HADA_ARG(f->channels),
                             HADA_ARG(threshold),
                             HADA_ARG(margin),
                             HADA_ARG(level),
                             HADA_ARG(f->fused.mem),
                             HADA_ARG(all_in_focus),
                             HADA_ARG(aif_at),
                             HADA_ARG(distance_map),
                             HADA_ARG(map_at)};
    hada_slot_cost(f->slot, 4.0 * pixels * (6.0 + 2.0 * f->channels), pixels * 12.0);
    status = hada_slot_launch(f->slot, kernel, "focus_finish", 1, &global, &local, args, HADA_COUNT(args), err);
    f->begun = 0;
    if (!status && report)
        *report = found;
    return status;
}
