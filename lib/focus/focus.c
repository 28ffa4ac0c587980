#include "focus/focus_object.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

static int up_to(int n, int multiple)
{
    return (n + multiple - 1) / multiple * multiple;
}

static int window_radius(const hada_focus_options *options)
{
    return (int)ceil(3.0 * options->window_sigma);
}

static int kinds_of(const hada_focus_options *options)
{
    return options->measure == HADA_FOCUS_COMBINED ? 2 : 1;
}

#define KEPT 7 /* images of the running best, before the all-in-focus sums */

/* A buffer of the object, its size in bytes and its name: one list serves the estimate and the allocation. */
typedef struct part {
    size_t offset; /* of the hada_buffer in the object */
    size_t bytes;
    const char *name;
} part;
enum { TABLES = 2, PARTS = 6 }; /* the first parts stay as they are from frame to frame; the others are scratch */

static void list_parts(const hada_context *context, const hada_focus_desc *desc, part *parts)
{
    const hada_focus_way way = hada_focus_way_of(context);
    const size_t radius = (size_t)window_radius(&desc->options), pitch = (size_t)up_to(desc->cols, way.width);
    const size_t row = pitch * sizeof(float), rows = (size_t)desc->rows;
    const size_t planes = (size_t)(desc->depths < HADA_FOCUS_DEPTHS ? desc->depths : HADA_FOCUS_DEPTHS);
    const size_t bins = 2 * HADA_FOCUS_BINS * sizeof(cl_int);
    parts[0] = (part){offsetof(hada_focus, weights), (2 * radius + 1) * sizeof(float), "the focus window"};
    parts[1] = (part){offsetof(hada_focus, inverse_distances), (size_t)desc->depths * sizeof(float), "the distances"};
    parts[2] = (part){offsetof(hada_focus, response), planes * (size_t)kinds_of(&desc->options) * (rows + 2) * row,
                      "the focus response"};
    parts[3] = (part){offsetof(hada_focus, kept), (size_t)(KEPT + desc->channels) * rows * row,
                      "the running best of the focus"};
    parts[4] = (part){offsetof(hada_focus, bins), (size_t)way.groups * bins, "the noise counts"};
    parts[5] = (part){offsetof(hada_focus, counts), bins, "the noise counts"};
}

size_t hada_focus_bytes(const hada_context *context, const hada_focus_desc *desc)
{
    part parts[PARTS];
    size_t bytes = 0;
    list_parts(context, desc, parts);
    for (size_t i = 0; i < PARTS; i++)
        bytes += parts[i].bytes;
    return bytes;
}

hada_status hada_focus_note(const hada_context *context, const hada_focus_desc *desc, hada_room *room, hada_error *err)
{
    part parts[PARTS];
    hada_status status = HADA_OK;
    list_parts(context, desc, parts);
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
                          .radius = window_radius(&desc->options),
                          .kinds = kinds_of(&desc->options),
                          .way = hada_focus_way_of(slot->context)};
    focus->pitch = up_to(desc->cols, focus->way.width);
    if (!(status = hada_alloc(&memory, (size_t)desc->depths, 1, "a focus object", err)))
        focus->competing = memory;
    if (!status && !(status = hada_alloc(&memory, 2 * HADA_FOCUS_BINS, sizeof(int64_t), "the noise counts", err))) {
        focus->noise_counts = memory;
        focus->loser_counts = focus->noise_counts + HADA_FOCUS_BINS;
    }
    part parts[PARTS];
    list_parts(slot->context, desc, parts);
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
    hada_buffer *const buffers[] = {&f->weights, &f->inverse_distances, &f->response, &f->kept, &f->bins, &f->counts};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
    free(f->noise_counts);
    free(f->competing);
    free(f);
}

static hada_status clear_counts(hada_focus *f, hada_error *err)
{
    f->counted = 0;
    return hada_buffer_clear(&f->bins, f->slot, 0, (size_t)f->way.groups * 2 * HADA_FOCUS_BINS * sizeof(cl_int), err);
}

/* Adds the device's counts to the host's, which are large enough for any stack. */
static hada_status take_counts(hada_focus *f, hada_error *err)
{
    enum { ALL = 2 * HADA_FOCUS_BINS };
    void *memory;
    hada_status status = hada_alloc(&memory, ALL, sizeof(cl_int), "the noise counts", err);
    if (status)
        return status;
    const cl_int *counts = memory;
    if (!(status = hada_focus_launch_counts(f, err)) &&
        !(status = hada_buffer_read(&f->counts, f->slot, 0, memory, ALL * sizeof(cl_int), err)))
        for (int i = 0; i < ALL; i++)
            f->noise_counts[i] += counts[i];
    free(memory);
    return status;
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

/* The planes gathered so far go to the device. */
static hada_status push_gathered(hada_focus *f, hada_focus_planes *planes, hada_error *err)
{
    const int64_t pixels = (int64_t)f->rows * f->cols;
    hada_status status = HADA_OK;
    if (!planes->count)
        return HADA_OK;
    if (f->counted > INT_MAX - planes->count * pixels && !(status = take_counts(f, err)))
        status = clear_counts(f, err);
    if (status || (status = hada_focus_launch_measure(f, planes, err)) ||
        (status = hada_focus_launch_select(f, planes, err)))
        return status;
    f->last = planes->depth[planes->count - 1];
    f->seen += planes->count;
    f->counted += planes->count * pixels;
    planes->count = 0;
    return HADA_OK;
}

/* Depths `list` or, without one, first .. */
static hada_status push(hada_focus *focus, const int *list, int first, int count, cl_mem planes, size_t offset,
                        hada_error *err)
{
    if (!focus->begun)
        return hada_fail(err, HADA_ERROR_STATE, "planes came to the focus before a frame was begun");
    const int64_t fit = INT_MAX / ((int64_t)focus->rows * focus->cols); /* into counts that are int */
    const int most = fit < HADA_FOCUS_DEPTHS ? (int)fit : HADA_FOCUS_DEPTHS;
    hada_focus_planes gathered = {.planes = planes, .offset = offset};
    hada_status status = HADA_OK;
    for (int i = 0; i < count && !status; i++) {
        const int depth = list ? list[i] : first + i;
        if (depth < focus->next || depth >= focus->depths)
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "depth %d came to the focus of %d depths, where %d or farther was due", depth,
                             focus->depths, focus->next);
        focus->next = depth + 1;
        if (!focus->competing[depth])
            continue;
        gathered.place[gathered.count] = i;
        gathered.depth[gathered.count++] = depth;
        if (gathered.count == most)
            status = push_gathered(focus, &gathered, err);
    }
    return status ? status : push_gathered(focus, &gathered, err);
}

hada_status hada_focus_push(hada_focus *focus, int first, int count, cl_mem planes, size_t offset, hada_error *err)
{
    return push(focus, NULL, first, count, planes, offset, err);
}

hada_status hada_focus_push_list(hada_focus *focus, const int *depths, int count, cl_mem planes, size_t offset,
                                 hada_error *err)
{
    return push(focus, depths, 0, count, planes, offset, err);
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
    if (!status)
        status = hada_focus_launch_finish(f, &found, base, all_in_focus, all_in_focus_offset, distance_map,
                                          distance_offset, err);
    f->begun = 0;
    if (!status && report)
        *report = found;
    return status;
}
