#include "focus/focus_object.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/callers.h"

hada_status hada_focus_check(const hada_focus_desc *desc, hada_error *err)
{
    const hada_focus_options *o = &desc->options;
    if ((o->measure != HADA_FOCUS_CONTRAST && o->measure != HADA_FOCUS_ENERGY && o->measure != HADA_FOCUS_COMBINED) ||
        (o->fuse != HADA_FOCUS_WEIGHTED && o->fuse != HADA_FOCUS_SUM))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "focus measure %d with fusion %d is not known", (int)o->measure,
                         (int)o->fuse);
    if (!(o->window_sigma >= 0.5 && o->window_sigma <= 20.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a focus window of %g pixels is not possible; use 0.5 to 20",
                         o->window_sigma);
    if (!(o->false_alarm > 0.0 && o->false_alarm < 0.5))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a false alarm rate of %g is not possible; use a value above 0 and below 0.5", o->false_alarm);
    if ((desc->channels != 1 && desc->channels != 3) || desc->rows < 1 || desc->cols < 1 || desc->depths < 1)
        return hada_fail(err, HADA_ERROR_SIZE, "a stack of %d depths of %d channels, %d x %d cannot be focused",
                         desc->depths, desc->channels, desc->rows, desc->cols);
    /* kernels count pixels as int, in whole groups */
    if ((int64_t)desc->channels * desc->rows * desc->cols > INT_MAX - 256)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "planes of %d channels, %d x %d are too large to be focused: %d values "
                         "at most",
                         desc->channels, desc->rows, desc->cols, INT_MAX - 256);
    /* a camera of one depth may not know its distance: 0 */
    for (int i = 0; i < desc->depths && !(desc->depths == 1 && desc->distances_mm[0] == 0.0); i++)
        if (!(desc->distances_mm[i] > 0.0) || (i && !(desc->distances_mm[i] > desc->distances_mm[i - 1])))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "distance %d of %d (%g mm) is not possible; distances must be above 0 and rise", i + 1,
                             desc->depths, desc->distances_mm[i]);
    return HADA_OK;
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

enum { PARTS = 6 };

static void list_parts(const hada_context *context, const hada_focus_desc *desc, hada_buffer_row *parts)
{
    const hada_focus_way way = hada_focus_way_of(context);
    const size_t radius = (size_t)window_radius(&desc->options),
                 pitch = hada_round_up((size_t)desc->cols, (size_t)way.width);
    const size_t row = pitch * sizeof(float), rows = (size_t)desc->rows;
    const size_t planes = (size_t)(desc->depths < way.depths ? desc->depths : way.depths);
    const size_t bins = 2 * HADA_FOCUS_BINS * sizeof(cl_int);
    const hada_buffer_row rows_of[PARTS] = {
        {offsetof(hada_focus, weights), (2 * radius + 1) * sizeof(float), "the focus window", HADA_LASTING},
        {offsetof(hada_focus, inverse_distances), (size_t)desc->depths * sizeof(float), "the distances", HADA_LASTING},
        {offsetof(hada_focus, response), planes * (size_t)kinds_of(&desc->options) * (rows + 2) * row,
         "the focus response", HADA_OWN_STEPS},
        {offsetof(hada_focus, kept), (size_t)(KEPT + desc->channels) * rows * row, "the running best of the focus",
         HADA_OWN_STEPS},
        {offsetof(hada_focus, bins), (size_t)way.groups * bins, "the noise counts", HADA_OWN_STEPS},
        {offsetof(hada_focus, counts), bins, "the noise counts", HADA_OWN_STEPS}};
    memcpy(parts, rows_of, sizeof rows_of);
}

/* The window's weights and the distances go to the device; what noise does to the measure is worked out. */
static hada_status fill_tables(hada_focus *focus, const hada_focus_desc *desc, hada_error *err)
{
    const int taps = 2 * focus->radius + 1;
    const size_t most = (size_t)(taps > desc->depths ? taps : desc->depths);
    double *weights = NULL, sum = 0.0;
    float *single = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(weights = hada_alloc((size_t)taps, sizeof *weights, "the focus window", err)));
    HADA_TRY_OR_DONE(hada_allocated(single = hada_alloc(most, sizeof *single, "the focus window", err)));
    for (int k = 0; k < taps; k++) {
        const double x = (k - focus->radius) / desc->options.window_sigma;
        sum += weights[k] = exp(-0.5 * x * x);
    }
    for (int k = 0; k < taps; k++)
        single[k] = (float)(weights[k] /= sum);
    hada_focus_noise_moments(desc->options.measure, weights, focus->radius, &focus->noise_mean,
                             &focus->noise_deviation);
    HADA_TRY_OR_DONE(hada_buffer_write(&focus->weights, focus->slot, 0, single, (size_t)taps * sizeof(float), err));
    for (int i = 0; i < desc->depths; i++)
        single[i] = (float)(1.0 / desc->distances_mm[i]);
    HADA_TRY_OR_DONE(hada_buffer_write(&focus->inverse_distances, focus->slot, 0, single,
                                       (size_t)desc->depths * sizeof(float), err));
done:
    free(weights);
    free(single);
    return status;
}

hada_status hada_focus_create(hada_focus **out, hada_slot *slot, const hada_focus_desc *desc, hada_error *err)
{
    hada_focus *focus = NULL;
    hada_buffer_row parts[PARTS];
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_focus_check(desc, err));
    HADA_TRY_OR_DONE(hada_allocated(focus = hada_alloc(1, sizeof *focus, "a focus object", err)));
    *focus = (hada_focus){.slot = slot,
                          .options = desc->options,
                          .channels = desc->channels,
                          .rows = desc->rows,
                          .cols = desc->cols,
                          .depths = desc->depths,
                          .radius = window_radius(&desc->options),
                          .kinds = kinds_of(&desc->options),
                          .way = hada_focus_way_of(slot->context)};
    focus->pitch = (int)hada_round_up((size_t)desc->cols, (size_t)focus->way.width);
    HADA_TRY_OR_DONE(hada_allocated(focus->competing = hada_alloc((size_t)desc->depths, 1, "a focus object", err)));
    HADA_TRY_OR_DONE(hada_allocated(
        focus->noise_counts = hada_alloc(2 * HADA_FOCUS_BINS, sizeof *focus->noise_counts, "the noise counts", err)));
    focus->loser_counts = focus->noise_counts + HADA_FOCUS_BINS;
    list_parts(slot->context, desc, parts);
    HADA_TRY_OR_DONE(hada_buffer_rows_take(focus, slot, parts, PARTS, err));
    HADA_TRY_OR_DONE(fill_tables(focus, desc, err));
done:
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
    cl_int *counts = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(counts = hada_alloc(ALL, sizeof *counts, "the noise counts", err)));
    HADA_TRY_OR_DONE(hada_focus_launch_counts(f, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&f->counts, f->slot, 0, counts, ALL * sizeof *counts, err));
    for (int i = 0; i < ALL; i++)
        f->noise_counts[i] += counts[i];
done:
    free(counts);
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
    focus->pushed = 0;
    memset(focus->noise_counts, 0, 2 * HADA_FOCUS_BINS * sizeof *focus->noise_counts);
    return clear_counts(focus, err);
}

/* The planes gathered so far go to the device. */
static hada_status push_gathered(hada_focus *f, cl_mem planes, hada_focus_batch *batch, hada_error *err)
{
    const int64_t pixels = (int64_t)f->rows * f->cols;
    if (!batch->count)
        return HADA_OK;
    if (f->counted > INT_MAX - batch->count * pixels) {
        HADA_TRY(take_counts(f, err));
        HADA_TRY(clear_counts(f, err));
    }
    HADA_TRY(hada_focus_launch_measure(f, planes, batch, err));
    HADA_TRY(hada_focus_launch_select(f, planes, batch, err));
    f->last = batch->depth[batch->count - 1];
    f->pushed += batch->count;
    f->counted += batch->count * pixels;
    batch->count = 0;
    return HADA_OK;
}

/* Depths `list` or, without one, first .. */
static hada_status push(hada_focus *focus, const int *list, int first, int count, cl_mem planes, size_t offset,
                        hada_error *err)
{
    if (!focus->begun)
        return hada_fail(err, HADA_ERROR_STATE, "planes came to the focus before a frame was begun");
    const int64_t fit = INT_MAX / ((int64_t)focus->rows * focus->cols); /* into counts that are int */
    const int most = fit < focus->way.depths ? (int)fit : focus->way.depths;
    hada_focus_batch gathered = {.offset = offset};
    for (int i = 0; i < count; i++) {
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
            HADA_TRY(push_gathered(focus, planes, &gathered, err));
    }
    return push_gathered(focus, planes, &gathered, err);
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
    int64_t total;
    double spread;
    *report = (hada_focus_report){.coverage = NAN};
    HADA_TRY(take_counts(f, err));
    /* Immerkaer's operator has norm 6; the median of |x| of a normal variable is 0.6745 standard deviations */
    report->noise = hada_focus_bins_median_positive(f->noise_counts, &total) / (6.0 * 0.67448975);
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
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(thresholds(f, &found, &base, err));
    HADA_TRY_OR_DONE(hada_focus_launch_finish(f, &found, base, all_in_focus, all_in_focus_offset, distance_map,
                                              distance_offset, err));
    if (report)
        *report = found;
done:
    f->begun = 0;
    return status;
}
