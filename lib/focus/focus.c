#include "focus/focus.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/callers.h"
#include "core/numbers.h"
#include "launch/focus.h"

/* How the kernels part the work. */
typedef struct focus_way {
    int groups;  /* work-groups of one item that take many tiles each, every one with counts of its own; 1 on a GPU */
    int depths;  /* planes of a launch, at most */
    int width;   /* pixels of an item of focus_select, which rows of the object's own images are multiples of */
    int members; /* items in a group */
    int rows, cols, band; /* tiles of focus_measure; rows of a tile of focus_select */
    hada_program_focus program;
} focus_way;

struct hada_focus {
    hada_slot *slot;
    hada_focus_options options;
    int channels, rows, cols, depths;
    int radius, pitch, kinds; /* of the window; of a row; responses of a plane */
    focus_way way;
    double noise_mean, noise_deviation;

    unsigned char *competing; /* per depth */
    int competing_count;
    int begun, next; /* depths below `next` have come */
    int last;        /* the last depth that competed, -1: none yet */
    int pushed;      /* depths that competed so far */

    hada_buffer weights, inverse_distances;
    hada_buffer response; /* of the planes of a launch, averaged across */
    hada_buffer kept;     /* the running best and the all-in-focus sums */
    hada_buffer bins, counts;
    int64_t counted;                      /* pixels in the device's counts, which are int */
    int64_t *noise_counts, *loser_counts; /* the counts before them */
};

/* The kernels of focus.cl. */

_Static_assert(FOCUS_MEASURE_CONTRAST == (int)HADA_FOCUS_CONTRAST && FOCUS_MEASURE_ENERGY == (int)HADA_FOCUS_ENERGY &&
                   FOCUS_MEASURE_COMBINED == (int)HADA_FOCUS_COMBINED,
               "the kernels' numbers are those of the interface");

/* Groups of one item that count for themselves: two for each unit, so that they can share the work out; a few units
 * are enough to read planes as fast as memory gives them. */
#define GROUPS_MOST 16

/* Planes of a launch where responses are to stay in a CPU's caches until they are read again. */
enum { LANES_DEPTHS = 4 };

/* Local memory of focus_measure: luminance, with a row at either end, and two kinds of responses. */
static size_t local_bytes(const hada_macros_focus *tiles)
{
    const int light = (tiles->focus_rows + 2) * HADA_FOCUS_LIGHT_PITCH(tiles->focus_cols, tiles->focus_width);
    const int edges = 2 * tiles->focus_rows * HADA_FOCUS_EDGES_PITCH(tiles->focus_cols);
    return (size_t)(light + edges) * sizeof(float);
}

static hada_program_focus program_of(const hada_context *context)
{
    if (context->shape == HADA_SHAPE_GROUPS)
        return HADA_PROGRAM_FOCUS_GROUPS;
    return local_bytes(hada_macros_of_focus(HADA_PROGRAM_FOCUS_DEFAULT)) <= context->info.local_memory_bytes
               ? HADA_PROGRAM_FOCUS_DEFAULT
               : HADA_PROGRAM_FOCUS_SMALL;
}

static focus_way way_of(const hada_context *context)
{
    const int in_groups = context->shape == HADA_SHAPE_GROUPS;
    const unsigned groups = 2 * context->info.compute_units;
    const hada_program_focus program = program_of(context);
    const hada_macros_focus *tiles = hada_macros_of_focus(program);
    return (focus_way){.groups = in_groups              ? 1
                                 : groups < GROUPS_MOST ? (int)groups
                                                        : GROUPS_MOST,
                       .depths = in_groups ? HADA_FOCUS_DEPTHS : LANES_DEPTHS,
                       .width = tiles->focus_width * tiles->focus_side,
                       .members = tiles->focus_group,
                       .rows = tiles->focus_rows,
                       .cols = tiles->focus_cols,
                       .band = tiles->focus_band,
                       .program = program};
}

static int parts(int n, int of)
{
    return (int)hada_divide_up((size_t)n, (size_t)of);
}

static hada_range range_of(const hada_focus *f, int groups)
{
    return hada_range_groups((size_t)groups, (size_t)f->way.members, 1, 1);
}

/* Work-groups for a number of tiles. */
static hada_range range_for(const hada_focus *f, int tiles)
{
    return range_of(f, f->way.members > 1 || tiles < f->way.groups ? tiles : f->way.groups);
}

static hada_focus_image image_of(const hada_focus *f)
{
    return (hada_focus_image){f->channels, f->rows, f->cols, f->pitch, f->radius, (int)f->options.measure};
}

static hada_status launch_measure(hada_focus *f, cl_mem planes, const hada_focus_batch *batch, hada_error *err)
{
    const double pixels = (double)batch->count * f->rows * f->cols, taps = 2.0 * f->radius + 1;
    const double edges = f->options.measure == HADA_FOCUS_ENERGY ? 0 : 19;
    const hada_range range = range_for(f, batch->count * parts(f->rows + 2, f->way.rows) * parts(f->cols, f->way.cols));
    hada_slot_cost(f->slot, 4.0 * pixels * (f->channels + f->kinds),
                   pixels * ((f->channels == 3 ? 5 : 0) + edges + 11 + 2.0 * taps * f->kinds));
    return hada_launch_focus_measure(f->slot, f->way.program, &range, err, .planes = planes, .batch = *batch,
                                     .image = image_of(f), .weights = f->weights.mem, .response = f->response.mem,
                                     .bins = f->bins.ints);
}

static hada_status launch_select(hada_focus *f, cl_mem planes, const hada_focus_batch *batch, hada_error *err)
{
    const hada_focus_past past = {f->pushed, f->last, f->options.fuse == HADA_FOCUS_WEIGHTED};
    const double pixels = (double)f->rows * f->cols, taps = 2.0 * f->radius + 1, kept = 7.0 + f->channels;
    const hada_range range = range_for(f, parts(f->rows, f->way.band) * parts(f->cols, f->way.width * f->way.members));
    hada_slot_cost(f->slot,
                   4.0 * pixels * (batch->count * (double)(f->channels + f->kinds) + (f->pushed ? 2.0 : 1.0) * kept),
                   pixels * batch->count * (2.0 * taps * f->kinds + 12 + 2.0 * f->channels));
    return hada_launch_focus_select(f->slot, f->way.program, &range, err, .response = f->response.mem,
                                    .weights = f->weights.mem, .planes = planes, .batch = *batch, .image = image_of(f),
                                    .past = past, .kept = f->kept.mem, .bins = f->bins.ints);
}

static hada_status launch_counts(hada_focus *f, hada_error *err)
{
    enum { ALL = 2 * HADA_FOCUS_BINS, GROUPS = 8 };
    const hada_range range = range_of(f, GROUPS);
    hada_slot_cost(f->slot, 4.0 * (f->way.groups + 1) * ALL, (double)f->way.groups * ALL);
    return hada_launch_focus_counts(f->slot, f->way.program, &range, err, .bins = f->bins.ints, .groups = f->way.groups,
                                    .share = ALL / GROUPS, .counts = f->counts.ints);
}

static hada_status launch_finish(hada_focus *f, const hada_focus_limits *limits, cl_mem all_in_focus,
                                 size_t all_in_focus_offset, cl_mem distance_map, size_t distance_offset,
                                 hada_error *err)
{
    const double pixels = (double)f->rows * f->cols;
    const hada_range range = range_for(f, f->rows);
    hada_slot_cost(f->slot, 4.0 * pixels * (6.0 + 2.0 * f->channels), pixels * 12.0);
    return hada_launch_focus_finish(
        f->slot, f->way.program, &range, err, .kept = f->kept.mem, .inverse_distances = f->inverse_distances.mem,
        .depths = f->depths, .image = image_of(f), .limits = *limits, .all_in_focus = all_in_focus,
        .all_in_focus_offset = all_in_focus_offset, .distance = distance_map, .distance_offset = distance_offset);
}

/* Whether options, sizes and distances are possible; create checks it as well. */
static hada_status focus_check(const hada_focus_desc *desc, hada_error *err)
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
    return hada_distances_check(desc->distances_mm, desc->depths, err);
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
    const focus_way way = way_of(context);
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
    HADA_TRY_OR_DONE(HADA_NEW(weights, (size_t)taps, "the focus window", err));
    HADA_TRY_OR_DONE(HADA_NEW(single, most, "the focus window", err));
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
    HADA_FREE(weights, single);
    return status;
}

hada_status hada_focus_create(hada_focus **out, hada_slot *slot, const hada_focus_desc *desc, hada_error *err)
{
    hada_focus *focus = NULL;
    hada_buffer_row parts[PARTS];
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(focus_check(desc, err));
    HADA_TRY_OR_DONE(HADA_NEW(focus, 1, "a focus object", err));
    *focus = (hada_focus){.slot = slot,
                          .options = desc->options,
                          .channels = desc->channels,
                          .rows = desc->rows,
                          .cols = desc->cols,
                          .depths = desc->depths,
                          .radius = window_radius(&desc->options),
                          .kinds = kinds_of(&desc->options),
                          .way = way_of(slot->context)};
    focus->pitch = (int)hada_round_up((size_t)desc->cols, (size_t)focus->way.width);
    HADA_TRY_OR_DONE(HADA_NEW(focus->competing, (size_t)desc->depths, "a focus object", err));
    HADA_TRY_OR_DONE(HADA_NEW(focus->noise_counts, 2 * HADA_FOCUS_BINS, "the noise counts", err));
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
    hada_focus *f = hada_taken(focus);
    if (!f)
        return;
    hada_slot_finish(f->slot, NULL);
    HADA_DESTROY_BUFFERS(&f->weights, &f->inverse_distances, &f->response, &f->kept, &f->bins, &f->counts);
    HADA_FREE(f->noise_counts, f->competing, f);
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
    HADA_TRY_OR_DONE(HADA_NEW(counts, ALL, "the noise counts", err));
    HADA_TRY_OR_DONE(launch_counts(f, err));
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
    HADA_TRY(launch_measure(f, planes, batch, err));
    HADA_TRY(launch_select(f, planes, batch, err));
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

hada_status hada_focus_push_list(hada_focus *focus, const int *depths, int count, cl_mem planes, hada_error *err)
{
    return push(focus, depths, 0, count, planes, 0, err);
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

hada_status hada_focus_finish(hada_focus *focus, double light, cl_mem all_in_focus, size_t all_in_focus_offset,
                              cl_mem distance_map, size_t distance_offset, hada_focus_report *report, hada_error *err)
{
    hada_focus *f = focus;
    if (!f->begun || f->last < 0)
        return hada_fail(err, HADA_ERROR_STATE, "no plane came to the focus; push those that compete first");
    hada_focus_report found;
    double base;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(thresholds(f, &found, &base, err));
    const hada_focus_limits limits = {(float)found.threshold, (float)found.margin, (float)base, (float)light};
    HADA_TRY_OR_DONE(launch_finish(f, &limits, all_in_focus, all_in_focus_offset, distance_map, distance_offset, err));
    if (report)
        *report = found;
done:
    f->begun = 0;
    return status;
}

/* A stack on the host, focused plane by plane. */

static hada_status check_planes(const hada_image *planes, int depths, hada_error *err)
{
    if (depths < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a stack of %d depths cannot be focused", depths);
    for (int i = 0; i < depths; i++) {
        HADA_TRY(hada_image_check(&planes[i], NULL, "hada_focus_stack", "one of planes", err));
        if (planes[i].channels != planes[0].channels || planes[i].rows != planes[0].rows ||
            planes[i].cols != planes[0].cols)
            return hada_fail(err, HADA_ERROR_SIZE,
                             "plane %d of %d channels, %d x %d differs from the first of %d channels, %d x %d", i + 1,
                             planes[i].channels, planes[i].rows, planes[i].cols, planes[0].channels, planes[0].rows,
                             planes[0].cols);
        if (hada_image_count_not_finite(&planes[i]))
            return hada_fail(err, HADA_ERROR_NOT_FINITE, "plane %d holds NaN or infinite values", i + 1);
    }
    return HADA_OK;
}

/* Pushes the planes through one device buffer; the results come behind each other in `results`. */
static hada_status focus_planes(hada_focus *focus, hada_slot *slot, hada_buffer *plane, hada_buffer *results,
                                const hada_image *planes, int depths, const unsigned char *competing,
                                hada_focus_report *report, hada_error *err)
{
    const size_t count = hada_image_count(&planes[0]);
    HADA_TRY(hada_focus_begin(focus, competing, err));
    for (int i = 0; i < depths; i++) {
        if (competing && !competing[i])
            continue;
        HADA_TRY(hada_buffer_write(plane, slot, 0, planes[i].data, count * sizeof(float), err));
        HADA_TRY(hada_focus_push(focus, i, 1, plane->mem, 0, err));
    }
    return hada_focus_finish(focus, 0.0, results->mem, 0, results->mem, count, report, err);
}

static hada_status read_results(const hada_buffer *results, hada_slot *slot, const hada_image *like,
                                hada_image *all_in_focus, hada_image *distance_map, hada_error *err)
{
    const size_t count = hada_image_count(like) * sizeof(float);
    HADA_TRY(hada_image_create(all_in_focus, like->channels, like->rows, like->cols, err));
    HADA_TRY(hada_image_create(distance_map, 1, like->rows, like->cols, err));
    HADA_TRY(hada_buffer_read(results, slot, 0, all_in_focus->data, count, err));
    return hada_buffer_read(results, slot, count, distance_map->data, hada_image_count(distance_map) * sizeof(float),
                            err);
}

/* The share of pixels that have a distance. */
static double coverage_of(const hada_image *distance_map)
{
    size_t covered = 0;
    for (size_t i = 0; i < hada_image_count(distance_map); i++)
        covered += !isnan(distance_map->data[i]);
    return (double)covered / (double)hada_image_count(distance_map);
}

hada_status hada_focus_stack(hada_context *context, const hada_image *planes, const double *distances_mm, int depths,
                             const unsigned char *competing, const hada_focus_options *options,
                             hada_image *all_in_focus, hada_image *distance_map, hada_focus_report *report,
                             hada_error *err)
{
    HADA_NEED(context && planes && all_in_focus && distance_map, err);
    hada_slot *slot = NULL;
    hada_focus *focus = NULL;
    hada_buffer plane = {0}, results = {0};
    hada_focus_report found = {0};
    hada_status status = HADA_OK;
    *all_in_focus = *distance_map = (hada_image){0};
    HADA_TRY_OR_DONE(check_planes(planes, depths, err));
    HADA_TRY_OR_DONE(HADA_REPORT_CHECK(report, hada_focus_report, err));
    hada_focus_desc desc = {.channels = planes[0].channels,
                            .rows = planes[0].rows,
                            .cols = planes[0].cols,
                            .depths = depths,
                            .distances_mm = distances_mm};
    hada_focus_options_init(&desc.options, 0);
    HADA_TRY_OR_DONE(hada_sized_take(&desc.options, sizeof desc.options, options, "hada_focus_options", err));
    const size_t bytes = hada_image_count(&planes[0]) * sizeof(float),
                 map = (size_t)desc.rows * (size_t)desc.cols * sizeof(float);
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(hada_focus_create(&focus, slot, &desc, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&plane, context, bytes, "a plane", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&results, context, bytes + map, "the focused image", err));
    HADA_TRY_OR_DONE(focus_planes(focus, slot, &plane, &results, planes, depths, competing, &found, err));
    HADA_TRY_OR_DONE(read_results(&results, slot, &planes[0], all_in_focus, distance_map, err));
    if (report) {
        found.coverage = coverage_of(distance_map);
        HADA_REPORT_GIVE(report, &found);
    }
done:
    if (status) {
        hada_image_destroy(all_in_focus);
        hada_image_destroy(distance_map);
    }
    hada_focus_destroy(&focus);
    if (slot)
        hada_slot_finish(slot, NULL);
    HADA_DESTROY_BUFFERS(&plane, &results);
    hada_slot_destroy(&slot);
    return status;
}
