#include "refine/variation.h"

/* Rows of a work-group: enough groups for a few cores or many, few enough that a launch is cheap. */
enum { LANES_BAND = 16, GROUPS_BAND = 2 };

/* Of a launch on tiles. All six at once would leave a third of a tile right (19 x 19 of 32 x 32 pixels), three leave
 * two thirds: a launch more costs less than doing twice the work. */
enum { TILE_STEPS = 3 };

/* Groups have a program for the channels that images usually have. */
static int on_tiles(const hada_context *context, int channels)
{
    return context->shape == HADA_SHAPE_GROUPS && (channels == 1 || channels == 3) &&
           context->info.max_work_group >= HADA_REFINE_TV_GROUP;
}

hada_status hada_variation_prepare(hada_variation *variation, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err)
{
    *variation = (hada_variation){.channels = channels, .rows = rows, .cols = cols};
    variation->program = HADA_PROGRAM_VARIANT(REFINE_TV, slot->context, cols >= 8);
    variation->group = (size_t)hada_macros_of_refine_tv(variation->program)->refine_group;
    variation->tiled = on_tiles(slot->context, channels);
    variation->tile_program = channels == 1 ? HADA_PROGRAM_REFINE_TV_TILE_GREY : HADA_PROGRAM_REFINE_TV_TILE_COLOUR;
    return variation->tiled ? hada_prepare_refine_tv_tile(slot, variation->tile_program, err)
                            : hada_prepare_refine_tv(slot, variation->program, err);
}

size_t hada_variation_floats(const hada_context *context, int channels, int rows, int cols, int planes)
{
    /* two directions; between launches on tiles a copy of the planes stands behind them */
    const size_t each = on_tiles(context, channels) ? 3 : 2;
    return each * (size_t)planes * (size_t)channels * (size_t)rows * (size_t)cols + HADA_VARIATION_ROOM;
}

static hada_refine_window window_of(const hada_variation *v)
{
    return (hada_refine_window){
        .channels = v->channels, .rows = v->rows, .cols = v->cols, .band = v->group > 1 ? GROUPS_BAND : LANES_BAND};
}

static hada_range bands_of(const hada_variation *v, const hada_refine_window *window, int count)
{
    const size_t bands = hada_divide_up((size_t)window->rows, (size_t)window->band);
    return hada_range_groups(bands, v->group, (size_t)count, 1);
}

static double values_of(const hada_variation *v, int count)
{
    return (double)count * v->channels * v->rows * v->cols;
}

/* One channel has no colour. */
static double per_colour_of(const hada_variation *v, double colour)
{
    return v->channels > 1 ? 1.0 / (colour * colour) : 1.0;
}

/* A projected gradient step on the dual. */
static hada_status dual_step(const hada_variation *v, hada_slot *slot, cl_mem planes, cl_mem old, cl_mem next,
                             int count, double theta, double colour, int fresh, hada_error *err)
{
    const hada_refine_window window = window_of(v);
    const hada_range range = bands_of(v, &window, count);
    hada_slot_cost(slot, (fresh ? 12.0 : 20.0) * values_of(v, count), 20.0 * values_of(v, count));
    return hada_launch_refine_tv_duals(slot, v->program, &range, err, .given = planes, .old = old, .next = next,
                                       .fresh = fresh, .window = window, .theta = (float)theta,
                                       .step = (float)(HADA_REFINE_TV_LENGTH / theta),
                                       .per_colour = (float)per_colour_of(v, colour));
}

/* The planes that the dual stands for. */
static hada_status primal_step(const hada_variation *v, hada_slot *slot, cl_mem planes, cl_mem duals, int count,
                               double theta, hada_error *err)
{
    const hada_refine_window window = window_of(v);
    const hada_range range = bands_of(v, &window, count);
    hada_slot_cost(slot, 16.0 * values_of(v, count), 5.0 * values_of(v, count));
    return hada_launch_refine_tv_planes(slot, v->program, &range, err, .planes = planes, .duals = duals,
                                        .window = window, .theta = (float)theta);
}

/* TILE_STEPS steps on the dual, the first ones or the last ones, which make the planes as well. */
static hada_status tile_steps(const hada_variation *v, hada_slot *slot, cl_mem planes, cl_mem old, cl_mem next,
                              int count, double theta, double colour, int fresh, int last, hada_error *err)
{
    const size_t inner = HADA_REFINE_TV_TILE - 2 * TILE_STEPS - (size_t)last;
    const size_t tiles = hada_divide_up((size_t)v->rows, inner) * hada_divide_up((size_t)v->cols, inner);
    const double values = values_of(v, count), done = TILE_STEPS * (double)(HADA_REFINE_TV_TILE * HADA_REFINE_TV_TILE);
    const hada_refine_tv_tile tile = {.copy = 2 * (cl_ulong)values,
                                      .rows = v->rows,
                                      .cols = v->cols,
                                      .steps = TILE_STEPS,
                                      .fresh = fresh,
                                      .first = !last,
                                      .last = last};
    const hada_range range = hada_range_groups(tiles, HADA_REFINE_TV_GROUP, (size_t)count, 1);
    hada_slot_cost(slot, (fresh ? 16.0 : 24.0) * values, 20.0 * done * (double)tiles * count * v->channels);
    return hada_launch_refine_tv_tile(slot, v->tile_program, &range, err, .planes = planes, .old = old, .next = next,
                                      .tile = tile, .theta = (float)theta,
                                      .step = (float)(HADA_REFINE_TV_LENGTH / theta),
                                      .per_colour = (float)per_colour_of(v, colour));
}

hada_status hada_variation_step(const hada_variation *variation, hada_slot *slot, cl_mem planes, const cl_mem duals[2],
                                int count, double theta, double colour, int fresh, hada_error *err)
{
    const int launches = HADA_REFINE_TV_STEPS / TILE_STEPS;
    /* an even number of steps or launches: the duals end where they began */
    for (int k = 0; variation->tiled && k < launches; k++)
        HADA_TRY(tile_steps(variation, slot, planes, duals[k % 2], duals[!(k % 2)], count, theta, colour, fresh && !k,
                            k + 1 == launches, err));
    if (variation->tiled)
        return HADA_OK;
    for (int k = 0; k < HADA_REFINE_TV_STEPS; k++)
        HADA_TRY(
            dual_step(variation, slot, planes, duals[k % 2], duals[!(k % 2)], count, theta, colour, fresh && !k, err));
    HADA_TRY(primal_step(variation, slot, planes, duals[0], count, theta, err));
    return HADA_OK;
}
