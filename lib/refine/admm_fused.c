/* What the kernels of a step are told, and a step in two launches. */
#include "refine/admm_steps.h"

#include <math.h>

#include "launch/refine_columns.h"
#include "launch/refine_frame_rows.h"
#include "launch/refine_group_columns.h"
#include "launch/refine_group_rows.h"
#include "launch/refine_group_score.h"
#include "launch/refine_odd_columns.h"
#include "launch/refine_odd_rows.h"
#include "launch/refine_rows.h"

double hada_refine_rho_at(const hada_refine_rule *rule, int step)
{
    return rule->first_rho > 0.0 ? fmin(rule->rho, rule->first_rho * pow(rule->growth, step + rule->before))
                                 : rule->rho;
}

static double relaxation_at(const hada_refine_rule *rule, int step)
{
    return step + rule->before < rule->first_steps ? rule->first_relaxation : rule->relaxation;
}

hada_refine_sums hada_refine_sums_at(const hada_refine_run *r, int place)
{
    return (hada_refine_sums){HADA_REFINE_SLICE, (unsigned)(r->refiner->partials * (size_t)place)};
}

hada_refine_problem hada_refine_problem_of(const hada_refine_run *r, int place)
{
    return (hada_refine_problem){.otf_offset = r->data->otf_offset,
                                 .frame_offset = r->data->spectrum_offset,
                                 .spectrum = hada_spectrum_shape_of(&r->refiner->layout),
                                 .depths = r->depths,
                                 .channels = (unsigned)r->refiner->shape.channels,
                                 .sums = hada_refine_sums_at(r, place)};
}

hada_refine_step hada_refine_step_of(const hada_refine_run *r, const hada_refine_rule *rule, int start, int step,
                                     int place)
{
    return (hada_refine_step){
        .problem = hada_refine_problem_of(r, place),
        .split = r->refiner->split,
        .rho = (float)(hada_refine_rho_at(rule, step) / r->refiner->mu),
        .keep = rule->noise > 0.0        ? 0.0f
                : !step && rule->resumes ? (float)(r->refiner->last_rho / hada_refine_rho_at(rule, step))
                : step + rule->before    ? (float)(hada_refine_rho_at(rule, step - 1) / hada_refine_rho_at(rule, step))
                                         : 1.0f,
        .relaxation = start == HADA_REFINE_CONTINUE ? (float)relaxation_at(rule, step) : 1.0f,
        .start = start,
        .padded = r->padded,
        .has_prior = r->data->prior && !(rule->tv > 0.0)};
}

enum { GROUP_ROWS = 16 }; /* that a work-item of refine_rows or refine_frame_rows takes */

/* A pass along rows: the steps on planes and on the frame, and the data's step. */
typedef struct rows_pass {
    int planes, frame; /* of hada_refine_pass; frame 0: no frame */
    hada_refine_data_step now;
} rows_pass;

/* How the kernels of a shape of devices do it. */
typedef struct fused_way {
    /* Columns that a work-group takes of each depth of a set; 0: it cannot. */
    int (*columns)(const hada_context *context, const hada_refine_shape *shape, int depths);
    int least_columns;
    int scores; /* 1: it has a kernel for scores */
    hada_status (*prepare)(hada_slot *slot, const hada_fft_fused *fused, int padded, hada_error *err);
    hada_status (*launch_columns)(const hada_refine_run *run, const hada_refine_step *now, hada_error *err);
    hada_status (*launch_rows)(const hada_refine_run *run, const rows_pass *pass, hada_error *err);
    int (*frame_rows)(const hada_context *context, const hada_refine_shape *shape); /* for each sum */
} fused_way;

static const fused_way *way_of(const hada_context *context);

/* Blocks of columns that stand side by side: one of each depth, and of a cropped frame. */
static int blocks_of(const hada_refine_shape *shape, int depths)
{
    return depths + (shape->boundary == HADA_BOUNDARY_PADDED);
}

static int can_fuse(const hada_context *context, const hada_refine_shape *shape, int depths)
{
    return way_of(context)->columns(context, shape, blocks_of(shape, depths)) > 0;
}

/* Whether a grid's transforms can be fused at all. */
static int fused_grid(const hada_context *context, const hada_refine_shape *shape)
{
    return can_fuse(context, shape, 1);
}

hada_status hada_refine_fused_make(hada_refiner *refiner, hada_error *err)
{
    const hada_refine_shape *shape = &refiner->shape;
    hada_slot *slot = refiner->slot;
    hada_buffer *table = &refiner->fused.columns.table;
    const size_t list = hada_round_up((size_t)shape->max_planes, HADA_FFT_BLOCK) * sizeof(cl_int);
    const int fuses = fused_grid(slot->context, shape);
    if (fuses)
        HADA_TRY(hada_fft_fused_make(&refiner->fused, slot, shape->grid_rows, shape->grid_cols, err));
    HADA_TRY(
        hada_buffer_create(&refiner->list, slot->context, list + table->bytes, "the list of occupied depths", err));
    if (!fuses)
        return HADA_OK;
    refiner->table = (int)(list / sizeof(cl_int));
    HADA_TRY(hada_buffer_copy(slot, table->mem, 0, refiner->list.mem, list, table->bytes, err));
    hada_buffer_destroy(table);
    return way_of(slot->context)->prepare(slot, &refiner->fused, shape->boundary == HADA_BOUNDARY_PADDED, err);
}

int hada_refine_fused_takes(const hada_refiner *refiner, int depths)
{
    return refiner->table && can_fuse(refiner->slot->context, &refiner->shape, depths);
}

int hada_refine_fused_most_slices(const hada_context *context, const hada_spectrum_layout *layout)
{
    return layout->blocks * (HADA_FFT_BLOCK / way_of(context)->least_columns);
}

/* Work-groups along the columns of a spectrum, of so many columns each; each adds a sum. */
static size_t parts_of(const hada_refiner *refiner, int width)
{
    return (size_t)(refiner->layout.blocks * (HADA_FFT_BLOCK / width));
}

size_t hada_refine_fused_slices(const hada_refine_run *run)
{
    const hada_context *context = run->refiner->slot->context;
    const hada_refine_shape *shape = &run->refiner->shape;
    return parts_of(run->refiner, way_of(context)->columns(context, shape, blocks_of(shape, run->depths)));
}

/* The usual count of a transform of n points, in operations. */
static double transform(double n)
{
    return 5.0 * n * log2(n > 2.0 ? n : 2.0);
}

static hada_refine_rows rows_of(const hada_refiner *refiner, const hada_rectangle *rect, int pass, int width)
{
    return (hada_refine_rows){.row0 = rect->row0,
                              .rows = rect->rows,
                              .col0 = rect->col0,
                              .cols = rect->cols,
                              .pass = pass,
                              .scale = (float)hada_refine_per_pixel(refiner),
                              .back_table = refiner->fused.back_table,
                              .width = width};
}

static hada_refine_columns columns_of(const hada_refiner *refiner, const hada_refine_step *now, int width)
{
    const hada_rectangle *window = &refiner->shape.window, *frame = &refiner->shape.frame;
    return (hada_refine_columns){.step = *now,
                                 .row0 = window->row0,
                                 .rows = window->rows,
                                 .frame_row0 = frame->row0,
                                 .frame_rows = frame->rows,
                                 .width = width,
                                 .table = refiner->table};
}

hada_status hada_refine_fused_columns(const hada_refine_run *run, const hada_refine_rule *rule, int start, int step,
                                      int place, hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const hada_refine_data *data = run->data;
    const hada_refine_step now = hada_refine_step_of(run, rule, start, step, place);
    const int channels = refiner->shape.channels, all = run->sets * run->depths;
    const double columns = (refiner->layout.cols / 2 + 1.0) * channels, grid = refiner->layout.rows;
    const int cold = start == HADA_REFINE_COLD, ways = cold ? 1 : 2;
    const int once = all < data->otf_depths ? all : data->otf_depths; /* one that several sets share is read once */
    const int crops = run->padded ? run->sets : 0, kept = start == HADA_REFINE_CONTINUE ? 2 : 1;
    hada_slot_cost(
        refiner->slot,
        columns * (8.0 * grid * (once + 1.0 + kept * (all + crops)) + (now.has_prior ? 4.0 * grid : 0) +
                   8.0 * ways * all * refiner->shape.window.rows + 8.0 * kept * crops * refiner->shape.frame.rows),
        columns *
            ((ways * all + kept * crops) * transform(grid) + grid * ((cold ? 20.0 : 44.0) * all + 16.0 * run->sets)));
    refiner->transforms += (size_t)((all + crops) * channels);
    return way_of(refiner->slot->context)->launch_columns(run, &now, err);
}

/* The sums over channels take as much memory as two columns of a plane. */
enum { SCORE_COLUMNS = 2 };

int hada_refine_fused_scores(const hada_refiner *refiner, int depths)
{
    const hada_context *context = refiner->slot->context;
    return refiner->table && way_of(context)->scores && !refiner->fused.odd_columns &&
           can_fuse(context, &refiner->shape, depths + SCORE_COLUMNS);
}

hada_status hada_refine_fused_score(const hada_refine_run *run, const hada_refine_band *band, size_t *slices,
                                    hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const hada_refine_data *data = run->data;
    const int columns = run->depths + SCORE_COLUMNS, images = run->sets * run->depths * refiner->shape.channels;
    const int width = way_of(refiner->slot->context)->columns(refiner->slot->context, &refiner->shape, columns);
    const hada_rectangle *window = &refiner->shape.window;
    const hada_refine_scoring job = {hada_refine_problem_of(run, 0), *band,          .row0 = window->row0,
                                     .rows = window->rows,           .width = width, .table = refiner->table};
    const hada_local sums = {(size_t)(width * columns * refiner->layout.rows) * 2 * sizeof(float)};
    *slices = parts_of(refiner, width);
    const hada_range range = hada_range_groups(*slices, HADA_REFINE_FUSED_GROUP, (size_t)run->sets, 1);
    const double frequencies = refiner->layout.rows * (refiner->layout.cols / 2 + 1.0);
    hada_slot_cost(refiner->slot, frequencies * images * (8.0 + (band->has_variance ? 12.0 : 8.0)),
                   images * (frequencies * 14.0 + (refiner->layout.cols / 2 + 1.0) * transform(refiner->layout.rows)));
    refiner->transforms += (size_t)images;
    return hada_launch_refine_group_score(refiner->slot, HADA_PROGRAM_REFINE_GROUP_SCORE_DEFAULT, &range, err,
                                          .planes = refiner->now_u.mem, .otf = data->otf, .list = refiner->list.ints,
                                          .frame = data->spectrum, .prior = data->prior, .variance = data->variance,
                                          .partial = refiner->partial.mem, .job = job, .sums = sums);
}

/* What a pass along the rows of so many images costs; touched: arrays of pixels that are read or written. */
static void cost_rows(const hada_refine_run *run, int pass, const hada_rectangle *rect, int images, int touched,
                      double operations, double *bytes, double *flops)
{
    const hada_spectrum_layout *layout = &run->refiner->layout;
    const int inverse = !!(pass & HADA_REFINE_TO_PIXELS), forward = !!(pass & HADA_REFINE_TO_SPECTRA);
    const int ways = inverse + forward;
    const double rows = (double)images * rect->rows;
    *bytes += rows * (8.0 * ways * (layout->cols / 2 + 1.0) + 4.0 * touched * rect->cols);
    *flops += rows * (0.5 * ways * transform(layout->cols) + operations * rect->cols);
    run->refiner->transforms += forward ? (size_t)images : 0;
}

static void cost_planes(const hada_refine_run *run, int pass, double *bytes, double *flops)
{
    cost_rows(run, pass, &run->refiner->shape.window, run->sets * run->depths * run->refiner->shape.channels,
              !!(pass & HADA_REFINE_TO_PIXELS) + !!(pass & HADA_REFINE_TO_SPECTRA), pass & HADA_REFINE_CLIP ? 1.0 : 0.0,
              bytes, flops);
}

static void cost_frame(const hada_refine_run *run, int pass, double *bytes, double *flops)
{
    const int inverse = !!(pass & HADA_REFINE_TO_PIXELS), forward = !!(pass & HADA_REFINE_TO_SPECTRA);
    cost_rows(run, pass, &run->refiner->shape.frame, run->sets * run->refiner->shape.channels, 2 * inverse + forward,
              4.0 * inverse, bytes, flops);
}

size_t hada_refine_fused_frame_slices(const hada_context *context, const hada_refine_shape *shape)
{
    return hada_divide_up((size_t)shape->frame.rows, (size_t)way_of(context)->frame_rows(context, shape));
}

/* Work-groups along the rows of the frame. */
static size_t frame_groups(const hada_refine_run *run)
{
    const hada_refiner *refiner = run->refiner;
    return (size_t)(run->sets * refiner->shape.channels) *
           hada_refine_fused_frame_slices(refiner->slot->context, &refiner->shape);
}

hada_status hada_refine_fused_rows(const hada_refine_run *run, int planes, int frame, double mu, int place,
                                   hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const rows_pass pass = {.planes = planes,
                            .frame = frame,
                            .now = {.at = refiner->split,
                                    .frame_offset = run->data->frame_offset,
                                    .channels = (unsigned)refiner->shape.channels,
                                    .sums = (unsigned)(refiner->partials * (size_t)place),
                                    .scale = run->data->weights ? 1.0f : (float)(1.0 / (1.0 + mu)),
                                    .mu = (float)mu,
                                    .has_weights = run->data->weights != NULL}};
    return way_of(refiner->slot->context)->launch_rows(run, &pass, err);
}

/* Work-groups of one, a block of columns each. */
static int lane_columns(const hada_context *context, const hada_refine_shape *shape, int depths)
{
    return hada_fft_fuses(context, shape->grid_rows, shape->grid_cols, depths) ? HADA_FFT_BLOCK : 0;
}

static hada_status prepare_lanes(hada_slot *slot, const hada_fft_fused *fused, int padded, hada_error *err)
{
    (void)fused;
    HADA_TRY(hada_prepare_refine_columns(slot, HADA_PROGRAM_REFINE_COLUMNS_DEFAULT, err));
    HADA_TRY(hada_prepare_refine_rows(slot, HADA_PROGRAM_REFINE_ROWS_DEFAULT, err));
    if (padded)
        HADA_TRY(hada_prepare_refine_frame_rows(slot, HADA_PROGRAM_REFINE_FRAME_ROWS_DEFAULT, err));
    return HADA_OK;
}

static hada_status launch_lane_columns(const hada_refine_run *run, const hada_refine_step *now, hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const hada_refine_data *data = run->data;
    const hada_own_pass *pass = &refiner->fused.columns;
    const hada_refine_columns job = columns_of(refiner, now, HADA_FFT_BLOCK);
    const hada_local scratch = {pass->local_bytes * (size_t)blocks_of(&refiner->shape, run->depths)};
    const hada_range range =
        hada_range_groups((size_t)refiner->layout.blocks, 1, (size_t)refiner->shape.channels, (size_t)run->sets);
    return hada_launch_refine_columns(refiner->slot, HADA_PROGRAM_REFINE_COLUMNS_DEFAULT, &range, err,
                                      .planes = refiner->now_u.mem, .otf = data->otf, .list = refiner->list.ints,
                                      .frame = data->spectrum, .prior = data->prior, .now_w = refiner->now_w.mem,
                                      .partial = refiner->partial.mem, .job = job, .scratch = scratch);
}

static hada_status launch_lane_frame(const hada_refine_run *run, const rows_pass *pass, hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const hada_refine_rows rows = rows_of(refiner, &refiner->shape.frame, pass->frame, 0);
    const hada_local scratch = {refiner->fused.rows.local_bytes};
    const hada_range range = hada_range_groups(frame_groups(run), 1, 1, 1);
    double bytes = 0.0, flops = 0.0;
    cost_frame(run, pass->frame, &bytes, &flops);
    hada_slot_cost(refiner->slot, bytes, flops);
    return hada_launch_refine_frame_rows(refiner->slot, HADA_PROGRAM_REFINE_FRAME_ROWS_DEFAULT, &range, err,
                                         .spectra = refiner->now_u.mem, .duals = refiner->dual.mem,
                                         .frame = run->data->frame, .weights = run->data->weights,
                                         .partial = refiner->partial.mem, .now = pass->now, .rows = rows,
                                         .tables = refiner->fused.row_tables.ints, .scratch = scratch);
}

static hada_status launch_lane_rows(const hada_refine_run *run, const rows_pass *pass, hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const int images = run->sets * run->depths * refiner->shape.channels;
    const hada_refine_rows rows = rows_of(refiner, &refiner->shape.window, pass->planes, 0);
    const hada_local scratch = {refiner->fused.rows.local_bytes};
    const hada_range range = hada_range_groups((size_t)images * hada_divide_up((size_t)rows.rows, GROUP_ROWS), 1, 1, 1);
    double bytes = 0.0, flops = 0.0;
    cost_planes(run, pass->planes, &bytes, &flops);
    hada_slot_cost(refiner->slot, bytes, flops);
    HADA_TRY(hada_launch_refine_rows(refiner->slot, HADA_PROGRAM_REFINE_ROWS_DEFAULT, &range, err,
                                     .spectra = refiner->now_u.mem, .planes = refiner->planes.mem, .rows = rows,
                                     .tables = refiner->fused.row_tables.ints, .scratch = scratch));
    if (pass->frame)
        HADA_TRY(launch_lane_frame(run, pass, err));
    return HADA_OK;
}

static int lane_frame_rows(const hada_context *context, const hada_refine_shape *shape)
{
    (void)context;
    (void)shape;
    return GROUP_ROWS;
}

/* Work-groups with local memory. Lengths with a stage of radix 43 have kernels of their own, for what is not cropped:
 * grids where a sensor crops are of good sizes. */
static int group_columns(const hada_context *context, const hada_refine_shape *shape, int depths)
{
    const int odd = hada_fft_group_odd(shape->grid_rows) || hada_fft_group_odd(shape->grid_cols);
    if (odd && shape->boundary == HADA_BOUNDARY_PADDED)
        return 0;
    return hada_fft_group_columns(context, shape->grid_rows, shape->grid_cols, depths, HADA_REFINE_FUSED_GROUP);
}

/* Frames that are cropped have programs of their own. */
static hada_program_refine_group_columns group_columns_program(int padded)
{
    return padded ? HADA_PROGRAM_REFINE_GROUP_COLUMNS_CROPPED : HADA_PROGRAM_REFINE_GROUP_COLUMNS_DEFAULT;
}

static hada_program_refine_group_rows group_rows_program(int padded)
{
    return padded ? HADA_PROGRAM_REFINE_GROUP_ROWS_CROPPED : HADA_PROGRAM_REFINE_GROUP_ROWS_DEFAULT;
}

static hada_status prepare_groups(hada_slot *slot, const hada_fft_fused *fused, int padded, hada_error *err)
{
    HADA_TRY(fused->odd_columns ? hada_prepare_refine_odd_columns(slot, HADA_PROGRAM_REFINE_ODD_COLUMNS_DEFAULT, err)
                                : hada_prepare_refine_group_columns(slot, group_columns_program(padded), err));
    HADA_TRY(fused->odd_rows ? hada_prepare_refine_odd_rows(slot, HADA_PROGRAM_REFINE_ODD_ROWS_DEFAULT, err)
                             : hada_prepare_refine_group_rows(slot, group_rows_program(padded), err));
    if (!fused->odd_columns)
        HADA_TRY(hada_prepare_refine_group_score(slot, HADA_PROGRAM_REFINE_GROUP_SCORE_DEFAULT, err));
    return HADA_OK;
}

static hada_status launch_odd_columns(const hada_refine_run *run, const hada_refine_columns *job, hada_local scratch,
                                      hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const hada_refine_data *data = run->data;
    const hada_range range = hada_range_groups(hada_refine_fused_slices(run), HADA_REFINE_ODD_GROUP,
                                               (size_t)refiner->shape.channels, (size_t)run->sets);
    return hada_launch_refine_odd_columns(refiner->slot, HADA_PROGRAM_REFINE_ODD_COLUMNS_DEFAULT, &range, err,
                                          .planes = refiner->now_u.mem, .otf = data->otf, .list = refiner->list.ints,
                                          .frame = data->spectrum, .prior = data->prior, .now_w = refiner->now_w.mem,
                                          .partial = refiner->partial.mem, .job = *job, .scratch = scratch);
}

static hada_status launch_group_columns(const hada_refine_run *run, const hada_refine_step *now, hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const hada_refine_data *data = run->data;
    const int blocks = blocks_of(&refiner->shape, run->depths);
    const int width = group_columns(refiner->slot->context, &refiner->shape, blocks);
    const hada_refine_columns job = columns_of(refiner, now, width);
    const hada_local scratch = {(size_t)(width * blocks * refiner->layout.rows) * 2 * sizeof(float)};
    const hada_range range = hada_range_groups(hada_refine_fused_slices(run), HADA_REFINE_FUSED_GROUP,
                                               (size_t)refiner->shape.channels, (size_t)run->sets);
    if (refiner->fused.odd_columns)
        return launch_odd_columns(run, &job, scratch, err);
    return hada_launch_refine_group_columns(refiner->slot, group_columns_program(run->padded), &range, err,
                                            .planes = refiner->now_u.mem, .otf = data->otf, .list = refiner->list.ints,
                                            .frame = data->spectrum, .prior = data->prior, .now_w = refiner->now_w.mem,
                                            .partial = refiner->partial.mem, .job = job, .scratch = scratch);
}

static int group_frame_rows(const hada_context *context, const hada_refine_shape *shape)
{
    const int pairs = hada_fft_group_pairs(context, shape->grid_cols, HADA_REFINE_FUSED_GROUP);
    return pairs > 0 ? 2 * pairs : 2; /* the grid cannot be fused: for bounds alone */
}

/* Planes, and behind them the frame, in one launch. */
static hada_status launch_group_rows(const hada_refine_run *run, const rows_pass *pass, hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const size_t group = HADA_REFINE_FUSED_GROUP;
    const int pairs = hada_fft_group_pairs(refiner->slot->context, refiner->layout.cols, group);
    const int images = run->sets * run->depths * refiner->shape.channels;
    const hada_refine_rows rows = rows_of(refiner, &refiner->shape.window, pass->planes, pairs);
    const hada_local scratch = {(size_t)(pairs * refiner->layout.cols) * 2 * sizeof(float)};
    const size_t planes = (size_t)images * hada_divide_up((size_t)rows.rows, 2 * (size_t)pairs);
    const hada_range range = hada_range_groups(planes + (pass->frame ? frame_groups(run) : 0), group, 1, 1);
    hada_refine_rows_pair job = {pass->now, rows, rows_of(refiner, &refiner->shape.frame, pass->frame, pairs)};
    double bytes = 0.0, flops = 0.0;
    job.data.first_group = (int)planes;
    cost_planes(run, pass->planes, &bytes, &flops);
    if (pass->frame)
        cost_frame(run, pass->frame, &bytes, &flops);
    hada_slot_cost(refiner->slot, bytes, flops);
    if (refiner->fused.odd_rows) {
        const hada_range of_planes = hada_range_groups(planes, HADA_REFINE_ODD_GROUP, 1, 1);
        return hada_launch_refine_odd_rows(refiner->slot, HADA_PROGRAM_REFINE_ODD_ROWS_DEFAULT, &of_planes, err,
                                           .spectra = refiner->now_u.mem, .planes = refiner->planes.mem, .rows = rows,
                                           .table = refiner->fused.rows.table.ints, .scratch = scratch);
    }
    return hada_launch_refine_group_rows(
        refiner->slot, group_rows_program(run->padded), &range, err, .spectra = refiner->now_u.mem,
        .planes = refiner->planes.mem, .duals = refiner->dual.mem, .frame = run->padded ? run->data->frame : NULL,
        .weights = run->padded ? run->data->weights : NULL, .partial = refiner->partial.mem, .job = job,
        .table = refiner->fused.rows.table.ints, .scratch = scratch);
}

/* The one place that asks for the shape. */
static const fused_way *way_of(const hada_context *context)
{
    static const fused_way lanes = {.columns = lane_columns,
                                    .least_columns = HADA_FFT_BLOCK,
                                    .prepare = prepare_lanes,
                                    .launch_columns = launch_lane_columns,
                                    .launch_rows = launch_lane_rows,
                                    .frame_rows = lane_frame_rows};
    static const fused_way groups = {.columns = group_columns,
                                     .least_columns = HADA_FFT_LEAST_COLUMNS,
                                     .scores = 1,
                                     .prepare = prepare_groups,
                                     .launch_columns = launch_group_columns,
                                     .launch_rows = launch_group_rows,
                                     .frame_rows = group_frame_rows};
    return context->shape == HADA_SHAPE_GROUPS ? &groups : &lanes;
}
