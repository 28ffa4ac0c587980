/* The kernels of focus.cl. */
#include "focus/focus_object.h"

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

hada_focus_way hada_focus_way_of(const hada_context *context)
{
    const int in_groups = context->shape == HADA_SHAPE_GROUPS;
    const unsigned groups = 2 * context->info.compute_units;
    const hada_program_focus program = program_of(context);
    const hada_macros_focus *tiles = hada_macros_of_focus(program);
    return (hada_focus_way){.groups = in_groups              ? 1
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

hada_status hada_focus_launch_measure(hada_focus *f, cl_mem planes, const hada_focus_batch *batch, hada_error *err)
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

hada_status hada_focus_launch_select(hada_focus *f, cl_mem planes, const hada_focus_batch *batch, hada_error *err)
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

hada_status hada_focus_launch_counts(hada_focus *f, hada_error *err)
{
    enum { ALL = 2 * HADA_FOCUS_BINS, GROUPS = 8 };
    const hada_range range = range_of(f, GROUPS);
    hada_slot_cost(f->slot, 4.0 * (f->way.groups + 1) * ALL, (double)f->way.groups * ALL);
    return hada_launch_focus_counts(f->slot, f->way.program, &range, err, .bins = f->bins.ints, .groups = f->way.groups,
                                    .share = ALL / GROUPS, .counts = f->counts.ints);
}

hada_status hada_focus_launch_finish(hada_focus *f, const hada_focus_report *found, double base, cl_mem all_in_focus,
                                     size_t all_in_focus_offset, cl_mem distance_map, size_t distance_offset,
                                     hada_error *err)
{
    const hada_focus_limits limits = {(float)found->threshold, (float)found->margin, (float)base};
    const double pixels = (double)f->rows * f->cols;
    const hada_range range = range_for(f, f->rows);
    hada_slot_cost(f->slot, 4.0 * pixels * (6.0 + 2.0 * f->channels), pixels * 12.0);
    return hada_launch_focus_finish(
        f->slot, f->way.program, &range, err, .kept = f->kept.mem, .inverse_distances = f->inverse_distances.mem,
        .depths = f->depths, .image = image_of(f), .limits = limits, .all_in_focus = all_in_focus,
        .all_in_focus_offset = all_in_focus_offset, .distance = distance_map, .distance_offset = distance_offset);
}
