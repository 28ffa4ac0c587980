/* The kernels of focus.cl. */
#include "focus/focus_object.h"
#include "runtime/kernel.h"

/* Groups of one item that count for themselves: two for each unit, so that they can share the work out; a few units
 * are enough to read planes as fast as memory gives them. */
#define GROUPS_MOST 16

hada_focus_way hada_focus_way_of(const hada_context *context)
{
    if (context->shape == HADA_SHAPE_GROUPS)
        return (hada_focus_way){.groups = 1,
                                .width = 1,
                                .members = 64,
                                .rows = 4,
                                .cols = 128,
                                .band = 1,
                                .options = "-DFOCUS_WIDTH=1 -DFOCUS_GROUP=64 -DFOCUS_ROWS=4 -DFOCUS_COLS=128 "
                                           "-DFOCUS_BAND=1 -DFOCUS_SIDE=1"};
    const unsigned groups = 2 * context->info.compute_units;
    return (hada_focus_way){.groups = groups < GROUPS_MOST ? (int)groups : GROUPS_MOST,
                            .width = 64,
                            .members = 1,
                            .rows = 8,
                            .cols = 256,
                            .band = 32,
                            .options = ""};
}

static int parts(int n, int of)
{
    return (n + of - 1) / of;
}

/* Work-groups for a number of tiles. */
static size_t groups_for(const hada_focus *f, int tiles)
{
    return (size_t)(f->way.members > 1 || tiles < f->way.groups ? tiles : f->way.groups);
}

static hada_status launch(hada_focus *f, const char *name, size_t groups, const hada_arg *args, size_t count,
                          hada_error *err)
{
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(f->slot, "focus", name, f->way.options, &kernel, err);
    const size_t local = (size_t)f->way.members, global = groups * local;
    return status ? status : hada_slot_launch(f->slot, kernel, name, 1, &global, &local, args, count, err);
}

static cl_int4 list_of(const cl_int *values)
{
    cl_int4 list;
    for (int i = 0; i < HADA_FOCUS_DEPTHS; i++)
        list.s[i] = values[i];
    return list;
}

hada_status hada_focus_launch_measure(hada_focus *f, const hada_focus_planes *planes, hada_error *err)
{
    const cl_int4 place = list_of(planes->place);
    const int measure = (int)f->options.measure;
    const hada_arg args[] = {HADA_ARG(planes->planes), HADA_ARG(planes->offset), HADA_ARG(place),
                             HADA_ARG(planes->count),  HADA_ARG(f->channels),    HADA_ARG(f->rows),
                             HADA_ARG(f->cols),        HADA_ARG(f->weights.mem), HADA_ARG(f->radius),
                             HADA_ARG(measure),        HADA_ARG(f->pitch),       HADA_ARG(f->response.mem),
                             HADA_ARG(f->bins.mem)};
    const double pixels = (double)planes->count * f->rows * f->cols, taps = 2.0 * f->radius + 1;
    const double edges = measure == HADA_FOCUS_ENERGY ? 0 : 19;
    hada_slot_cost(f->slot, 4.0 * pixels * (f->channels + f->kinds),
                   pixels * ((f->channels == 3 ? 5 : 0) + edges + 11 + 2.0 * taps * f->kinds));
    const int tiles = planes->count * parts(f->rows + 2, f->way.rows) * parts(f->cols, f->way.cols);
    return launch(f, "focus_measure", groups_for(f, tiles), args, HADA_COUNT(args), err);
}

hada_status hada_focus_launch_select(hada_focus *f, const hada_focus_planes *planes, hada_error *err)
{
    const cl_int4 place = list_of(planes->place), depth = list_of(planes->depth);
    const int measure = (int)f->options.measure, weighted = f->options.fuse == HADA_FOCUS_WEIGHTED;
    const hada_arg args[] = {HADA_ARG(f->response.mem), HADA_ARG(f->weights.mem), HADA_ARG(f->radius),
                             HADA_ARG(measure),         HADA_ARG(planes->planes), HADA_ARG(planes->offset),
                             HADA_ARG(place),           HADA_ARG(depth),          HADA_ARG(planes->count),
                             HADA_ARG(f->channels),     HADA_ARG(f->rows),        HADA_ARG(f->cols),
                             HADA_ARG(f->pitch),        HADA_ARG(f->pushed),      HADA_ARG(f->last),
                             HADA_ARG(weighted),        HADA_ARG(f->kept.mem),    HADA_ARG(f->bins.mem)};
    const double pixels = (double)f->rows * f->cols, taps = 2.0 * f->radius + 1, kept = 7.0 + f->channels;
    hada_slot_cost(f->slot,
                   4.0 * pixels * (planes->count * (double)(f->channels + f->kinds) + (f->pushed ? 2.0 : 1.0) * kept),
                   pixels * planes->count * (2.0 * taps * f->kinds + 12 + 2.0 * f->channels));
    const int tiles = parts(f->rows, f->way.band) * parts(f->cols, f->way.width * f->way.members);
    return launch(f, "focus_select", groups_for(f, tiles), args, HADA_COUNT(args), err);
}

hada_status hada_focus_launch_counts(hada_focus *f, hada_error *err)
{
    enum { ALL = 2 * HADA_FOCUS_BINS, GROUPS = 8, SHARE = ALL / GROUPS };
    const int share = SHARE;
    const hada_arg args[] = {HADA_ARG(f->bins.mem), HADA_ARG(f->way.groups), HADA_ARG(share), HADA_ARG(f->counts.mem)};
    hada_slot_cost(f->slot, 4.0 * (f->way.groups + 1) * ALL, (double)f->way.groups * ALL);
    return launch(f, "focus_counts", GROUPS, args, HADA_COUNT(args), err);
}

hada_status hada_focus_launch_finish(hada_focus *f, const hada_focus_report *found, double base, cl_mem all_in_focus,
                                     size_t all_in_focus_offset, cl_mem distance_map, size_t distance_offset,
                                     hada_error *err)
{
    const float threshold = (float)found->threshold, margin = (float)found->margin, level = (float)base;
    const cl_ulong aif_at = all_in_focus_offset, map_at = distance_offset;
    const hada_arg args[] = {HADA_ARG(f->kept.mem),  HADA_ARG(f->inverse_distances.mem),
                             HADA_ARG(f->depths),    HADA_ARG(f->rows),
                             HADA_ARG(f->cols),      HADA_ARG(f->pitch),
                             HADA_ARG(f->channels),  HADA_ARG(threshold),
                             HADA_ARG(margin),       HADA_ARG(level),
                             HADA_ARG(all_in_focus), HADA_ARG(aif_at),
                             HADA_ARG(distance_map), HADA_ARG(map_at)};
    const double pixels = (double)f->rows * f->cols;
    hada_slot_cost(f->slot, 4.0 * pixels * (6.0 + 2.0 * f->channels), pixels * 12.0);
    return launch(f, "focus_finish", groups_for(f, f->rows), args, HADA_COUNT(args), err);
}
