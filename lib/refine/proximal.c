#include "refine/proximal.h"

#include "kernels/shared_ridge_weights.h"

/* Rows of a work-group: enough groups for a few cores or many, few enough that a launch is cheap. */
enum { LANES_BAND = 16, GROUPS_BAND = 2 };

/* Rows of a band that a work-item of refine_tv_rows takes: each core has some bands, and few rows are done twice. */
enum { MOST_BAND = 96, LEAST_BAND = 24, BANDS_PER_CORE = 2 };

/* Of a launch on tiles. All six at once would leave a third of a tile right (19 x 19 of 32 x 32 pixels), three leave
 * two thirds: a launch more costs less than doing twice the work. */
enum { TILE_STEPS = 3 };

/* Groups have a program for the channels that images usually have. */
static int on_tiles(const hada_context *context, int channels)
{
    return context->shape == HADA_SHAPE_GROUPS && (channels == 1 || channels == 3) &&
           context->info.max_work_group >= HADA_REFINE_TV_GROUP;
}

/* As few tiles of a row as have room, all of the same width. */
static hada_refine_tv_rows rows_of(const hada_context *context, int channels, int rows, int cols)
{
    const int margins = 3 * HADA_REFINE_TV_ROWS_MARGIN, most = HADA_REFINE_TV_ROWS_ROOM / channels / 8 * 8 - margins;
    hada_refine_tv_rows by = {.window = {channels, rows, cols, rows}};
    if (context->shape != HADA_SHAPE_LANES || most < margins)
        return by;
    const int bands = BANDS_PER_CORE * (int)context->info.compute_units;
    by.tiles = (int)hada_divide_up((size_t)cols, (size_t)most);
    by.inner = 8 * (int)hada_divide_up((size_t)cols, 8 * (size_t)by.tiles);
    by.window.band = (int)hada_divide_up((size_t)rows, (size_t)bands);
    by.window.band = by.window.band < LEAST_BAND ? LEAST_BAND : by.window.band > MOST_BAND ? MOST_BAND : by.window.band;
    return by;
}

hada_status hada_variation_prepare(hada_variation *variation, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err)
{
    *variation = (hada_variation){.channels = channels, .rows = rows, .cols = cols};
    variation->program = HADA_PROGRAM_VARIANT(REFINE_TV, slot->context, cols >= 8);
    variation->group = (size_t)hada_macros_of_refine_tv(variation->program)->refine_group;
    variation->tiled = on_tiles(slot->context, channels);
    variation->tile_program = channels == 1 ? HADA_PROGRAM_REFINE_TV_TILE_GREY : HADA_PROGRAM_REFINE_TV_TILE_COLOUR;
    variation->by_rows = rows_of(slot->context, channels, rows, cols);
    if (variation->by_rows.tiles)
        HADA_TRY(hada_prepare_refine_tv_rows(slot, HADA_PROGRAM_REFINE_TV_ROWS_DEFAULT, err));
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

/* HADA_REFINE_TV_ROWS_STEPS steps on the dual. */
static hada_status row_steps(const hada_variation *v, hada_slot *slot, cl_mem planes, cl_mem old, cl_mem next,
                             int count, double theta, double colour, int fresh, hada_error *err)
{
    const double values = values_of(v, count);
    hada_refine_tv_rows rows = v->by_rows;
    rows.fresh = fresh;
    const size_t bands = hada_divide_up((size_t)v->rows, (size_t)rows.window.band);
    const hada_range range = hada_range_groups(bands * (size_t)rows.tiles, 1, (size_t)count, 1);
    hada_slot_cost(slot, (fresh ? 12.0 : 20.0) * values, 20.0 * HADA_REFINE_TV_ROWS_STEPS * values);
    return hada_launch_refine_tv_rows(slot, HADA_PROGRAM_REFINE_TV_ROWS_DEFAULT, &range, err, .given = planes,
                                      .old = old, .next = next, .rows = rows, .theta = (float)theta,
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

hada_status hada_variation_before(const hada_variation *v, hada_slot *slot, cl_mem planes, cl_mem duals, int count,
                                  double theta, hada_error *err)
{
    return primal_step(v, slot, planes, duals, count, -theta, err);
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
    const int launches = HADA_REFINE_TV_STEPS / TILE_STEPS, by_rows = variation->by_rows.tiles > 0;
    /* an even number of steps or launches: the duals end where they began */
    for (int k = 0; variation->tiled && k < launches; k++)
        HADA_TRY(tile_steps(variation, slot, planes, duals[k % 2], duals[!(k % 2)], count, theta, colour, fresh && !k,
                            k + 1 == launches, err));
    if (variation->tiled)
        return HADA_OK;
    for (int k = 0; by_rows && k < HADA_REFINE_TV_STEPS / HADA_REFINE_TV_ROWS_STEPS; k++)
        HADA_TRY(
            row_steps(variation, slot, planes, duals[k % 2], duals[!(k % 2)], count, theta, colour, fresh && !k, err));
    for (int k = 0; !by_rows && k < HADA_REFINE_TV_STEPS; k++)
        HADA_TRY(
            dual_step(variation, slot, planes, duals[k % 2], duals[!(k % 2)], count, theta, colour, fresh && !k, err));
    HADA_TRY(primal_step(variation, slot, planes, duals[0], count, theta, err));
    return HADA_OK;
}

hada_status hada_shrinkage_prepare(hada_shrinkage *shrinkage, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err)
{
    *shrinkage =
        (hada_shrinkage){.channels = channels, .rows = rows, .cols = cols, .program = hada_program_refine_dct_of(slot)};
    const hada_macros_refine_dct *macros = hada_macros_of_refine_dct(shrinkage->program);
    shrinkage->group = (size_t)macros->dct_group;
    shrinkage->tiles = hada_divide_up((size_t)rows, (size_t)macros->dct_tile_rows) *
                       hada_divide_up((size_t)cols, (size_t)macros->dct_tile_cols);
    return hada_prepare_refine_dct(slot, shrinkage->program, err);
}

/* Between channels and brightness with colours. */
static hada_status colours(const hada_shrinkage *s, hada_slot *slot, cl_mem from, size_t first, cl_mem to, int back,
                           hada_error *err)
{
    const size_t area = (size_t)s->rows * (size_t)s->cols;
    const size_t run = s->group > 1 ? 1 : HADA_REFINE_DCT_RUN;
    const hada_range range = hada_range_of(hada_divide_up(area, run), s->group, 1, 1);
    const hada_refine_window window = {.channels = s->channels, .rows = s->rows, .cols = s->cols};
    const double values = (double)area * s->channels;
    hada_slot_cost(slot, 8.0 * values, 2.0 * s->channels * values);
    return hada_launch_refine_dct_colours(slot, s->program, &range, err, .from = from, .first = (cl_uint)first,
                                          .out = to, .window = window, .back = back);
}

hada_status hada_shrinkage_step(const hada_shrinkage *s, hada_slot *slot, cl_mem image, cl_mem scratch,
                                double threshold, hada_error *err)
{
    const double values = (double)s->channels * s->rows * s->cols;
    const hada_refine_window window = {.channels = s->channels, .rows = s->rows, .cols = s->cols};
    const hada_range range = hada_range_groups(s->tiles, s->group, (size_t)s->channels, 1);
    HADA_TRY(colours(s, slot, image, 0, scratch, 0, err));
    /* 16 blocks hold a pixel: of each eight coefficients of a transform of eight, 34 operations, there and back */
    hada_slot_cost(slot, 8.0 * values, (8.0 * 2.0 * 34.0 / 4.0 + 64.0 * 5.0 / 4.0) * values);
    HADA_TRY(hada_launch_refine_dct_shrink(slot, s->program, &range, err, .planes = scratch, .window = window,
                                           .threshold = (float)threshold, .colour = (float)HADA_SHRINKAGE_COLOUR));
    return colours(s, slot, scratch, (size_t)values, image, 1, err);
}

hada_status hada_shrinkage_after_variation(const hada_shrinkage *s, const hada_variation *variation, hada_slot *slot,
                                           cl_mem image, const cl_mem duals[2], const hada_shrinkage_weights *weights,
                                           int fresh, hada_error *err)
{
    HADA_TRY(hada_variation_step(variation, slot, image, duals, 1, weights->variation * weights->theta, weights->colour,
                                 fresh, err));
    /* the duals are in the first buffer now, and the second, twice as large as an image, is free */
    return hada_shrinkage_step(s, slot, image, duals[1], weights->threshold * weights->theta, err);
}

hada_status hada_crosstalk_prepare(hada_crosstalk *crosstalk, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err)
{
    *crosstalk = (hada_crosstalk){
        .channels = channels, .rows = rows, .cols = cols, .program = hada_program_refine_crosstalk_of(slot)};
    const hada_macros_refine_crosstalk *macros = hada_macros_of_refine_crosstalk(crosstalk->program);
    crosstalk->group = (size_t)macros->crosstalk_group;
    crosstalk->width = (size_t)macros->crosstalk_width;
    return hada_prepare_refine_crosstalk(slot, crosstalk->program, err);
}

hada_status hada_crosstalk_fade(const hada_crosstalk *x, hada_slot *slot, cl_mem planes, cl_mem scratch, int depths,
                                double share, hada_error *err)
{
    const size_t items = hada_divide_up((size_t)x->cols, x->width), rows = (size_t)x->rows;
    const hada_range lit = hada_range_of(items, x->group, rows, (size_t)depths),
                     faded = hada_range_of(items, x->group, rows, 1);
    const hada_refine_window window = {.channels = x->channels, .rows = x->rows, .cols = x->cols};
    const double pixels = (double)depths * x->rows * x->cols;
    hada_slot_cost(slot, 4.0 * (x->channels + 1) * pixels, 5.0 * x->channels * pixels);
    HADA_TRY(hada_launch_refine_crosstalk_light(slot, x->program, &lit, err, .planes = planes, .light = scratch,
                                                .window = window));
    hada_slot_cost(slot, 4.0 * (2 * x->channels + 1) * pixels, (18.0 + x->channels) * pixels);
    return hada_launch_refine_crosstalk_fade(slot, x->program, &faded, err, .planes = planes, .light = scratch,
                                             .window = window, .depths = depths, .share = (float)share);
}

static int is_colour(int channels)
{
    return channels == 3;
}

hada_status hada_ridge_prepare(hada_ridge *ridge, hada_slot *slot, int channels, int rows, int cols, hada_error *err)
{
    const int groups = slot->context->shape == HADA_SHAPE_GROUPS, wide = slot->context->vector_floats >= 16;
    *ridge = (hada_ridge){.channels = channels, .rows = rows, .cols = cols};
    if (is_colour(channels))
        ridge->program = groups ? HADA_PROGRAM_REFINE_RIDGE_COLOUR_GROUPS
                         : wide ? HADA_PROGRAM_REFINE_RIDGE_COLOUR_WIDE
                                : HADA_PROGRAM_REFINE_RIDGE_COLOUR;
    else
        ridge->program = groups ? HADA_PROGRAM_REFINE_RIDGE_GREY_GROUPS
                         : wide ? HADA_PROGRAM_REFINE_RIDGE_GREY_WIDE
                                : HADA_PROGRAM_REFINE_RIDGE_GREY;
    const hada_macros_refine_ridge *macros = hada_macros_of_refine_ridge(ridge->program);
    ridge->group = (size_t)macros->ridge_group;
    ridge->tiles = hada_divide_up((size_t)rows, (size_t)macros->ridge_rows) *
                   hada_divide_up((size_t)cols, (size_t)macros->ridge_cols);
    return hada_prepare_refine_ridge(slot, ridge->program, err);
}

hada_ridge_step hada_ridge_step_of(int number, double noise)
{
    hada_ridge_step step = {.number = number,
                            .last = number + 1 == HADA_RIDGE_STEPS,
                            .length = hada_ridge_length[number],
                            .momentum = hada_ridge_momentum[number]};
    for (int k = 0; k < HADA_RIDGE_FILTERS; k++) {
        const double in = hada_ridge_in[number * HADA_RIDGE_FILTERS + k] / noise;
        step.in[k] = (float)in;
        step.out[k] = (float)(hada_ridge_share[number * HADA_RIDGE_FILTERS + k] / in);
    }
    return step;
}

hada_status hada_ridge_apply(const hada_ridge *ridge, hada_slot *slot, cl_mem planes, cl_mem scratch, int count,
                             double noise, hada_error *err)
{
    const int colour = is_colour(ridge->channels), seen = colour ? 3 : 1;
    const size_t images = (size_t)count * (size_t)(ridge->channels / seen);
    const size_t values = (size_t)count * (size_t)ridge->channels * (size_t)ridge->rows * (size_t)ridge->cols;
    const hada_range range = hada_range_groups(ridge->tiles, ridge->group, images, 1);
    const double taps = seen * HADA_RIDGE_SIZE * HADA_RIDGE_SIZE;
    for (int i = 0; i < HADA_RIDGE_STEPS; i++) {
        /* the two halves take turns; a step's result takes the place of what was before it */
        hada_ridge_step step = hada_ridge_step_of(i, noise);
        step.rows = ridge->rows;
        step.cols = ridge->cols;
        step.x_at = i > 0 ? (size_t) !(i % 2) * values : 0;
        step.before_at = i > 1 ? (size_t)(i % 2) * values : 0;
        step.next_at = step.last ? 0 : (size_t)(i % 2) * values;
        hada_slot_cost(slot, 16.0 * (double)values, 4.0 * taps * HADA_RIDGE_FILTERS * (double)values / seen);
        HADA_TRY(hada_launch_refine_ridge_step(slot, ridge->program, &range, err, .given = planes,
                                               .x = i > 0 ? scratch : planes, .before = i > 1 ? scratch : planes,
                                               .next = step.last ? planes : scratch, .step = step));
    }
    return HADA_OK;
}
