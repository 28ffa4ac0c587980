#include "refine/admm.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "launch/refine.h"
#include "launch/refine_move.h"
#include "refine/admm_steps.h"
#include "refine/shift.h"

size_t hada_rect_area(const hada_rectangle *rect)
{
    return (size_t)rect->rows * (size_t)rect->cols;
}

int hada_rect_inside(const hada_rectangle *rect, int rows, int cols)
{
    return rect->row0 >= 0 && rect->col0 >= 0 && rect->rows > 0 && rect->cols > 0 && rect->row0 + rect->rows <= rows &&
           rect->col0 + rect->cols <= cols;
}

int hada_rect_grid_size(int size, double shrink)
{
    return shrink == 1.0 ? size : hada_fft_good_size(2 * (int)lround(size / shrink / 2.0));
}

static void shrink_span(int first, int size, int full, int small, int outward, int margin, int *to_first, int *to_size)
{
    const double scale = (double)small / full;
    int from = outward ? (int)floor(first * scale) - margin : (int)ceil(first * scale) + margin;
    int end = outward ? (int)ceil((first + size) * scale) + margin : (int)floor((first + size) * scale) - margin;
    from = from < 0 ? 0 : from;
    end = end > small ? small : end;
    *to_first = from;
    *to_size = end - from;
}

hada_rectangle hada_rect_shrink(const hada_rectangle *rect, int rows, int cols, int small_rows, int small_cols,
                                int outward, int margin)
{
    hada_rectangle out;
    shrink_span(rect->row0, rect->rows, rows, small_rows, outward, margin, &out.row0, &out.rows);
    shrink_span(rect->col0, rect->cols, cols, small_cols, outward, margin, &out.col0, &out.cols);
    return out;
}

void hada_refine_rule_init(hada_refine_rule *rule)
{
    *rule = (hada_refine_rule){
        .steps = 8, .whole = 16, .rho = 1e-3, .growth = 1.0, .relaxation = 1.6, .mu = 1.0, .tv_colour = 1.0};
}

/* Several depths behind a sensor that crops, and a depth that goes on from another frame: rho begins low, so that
 * depths part, and grows, so that what lies beyond the frame settles (docs/explanation/refinement.md). In units of the
 * largest |OTF(0)|^2. */
#define CROPPED_FIRST_RHO 1e-3
#define CROPPED_GROWTH    1.25
#define RESUMED_GROWTH    1.4 /* where light wraps around */

/* Depths that are close share their light out slowly: longer steps at first (docs/explanation/refinement.md). */
#define PARTING_RELAXATION 1.95
enum { PARTING_STEPS = 7 };

/* A single depth: rho begins where weak frequencies of diffusers settle, too, and grows within this share of the steps
 * to so many times what several depths bear, with longer steps (perf/results/refinement.md). */
#define ALONE_MU              0.3
#define ALONE_FIRST_RHO       2e-4
#define ALONE_RHO             8.0
#define ALONE_RHO_CROPPED     6.0
#define ALONE_GROWING         0.5
#define ALONE_GROWING_CROPPED 0.8
#define ALONE_RELAXATION      1.9

/* The steps with the learned regulariser, for a usual weight of total variation and a single depth: rho in units of the
 * gain, and the noise that they take out with strength 1 in units of the frame's root mean square. With the weight they
 * grow by these powers. Several depths have a larger rho, and by that less noise. Found by trial on cameras that were
 * learned, and on others that were known by their point spread function (docs/explanation/refinement.md). */
#define RIDGE_WEIGHT      0.0026
#define RIDGE_RHO         0.1
#define RIDGE_RHO_SEVERAL 0.25
#define RIDGE_NOISE       0.16
#define RIDGE_RHO_POWER   0.6
#define RIDGE_NOISE_POWER 0.37

void hada_refine_rule_weigh(hada_refine_rule *rule, const hada_model_info *info, const hada_refine_weights *weights,
                            int depths, double gain, double mean_square)
{
    const int same = (weights->tv > 0.0) == (info->refine_tv > 0.0);
    const int cropped = info->boundary == HADA_BOUNDARY_PADDED;
    rule->rho = (same ? info->refine_rho : hada_refine_rho(info->boundary, weights->tv)) * gain;
    rule->tv = weights->tv * sqrt(info->channels * gain * mean_square);
    rule->tv_colour = weights->colour;
    rule->ridge = weights->ridge > 0.0;
    /* so faint that the step on the dual would leave single precision: black */
    if (!(rule->tv / rule->rho > 1e-36))
        rule->tv = 0.0;
    if (!(rule->tv > 0.0))
        return;
    const double usual = rule->rho;
    if (depths > 1) {
        rule->first_relaxation = PARTING_RELAXATION;
        rule->first_steps = PARTING_STEPS;
    } else {
        rule->rho *= cropped ? ALONE_RHO_CROPPED : ALONE_RHO;
        rule->mu = cropped ? ALONE_MU : 1.0;
    }
    if (depths == 1 && !rule->resumes) {
        const double growing = (cropped ? ALONE_GROWING_CROPPED : ALONE_GROWING) * rule->whole;
        rule->relaxation = ALONE_RELAXATION;
        rule->first_rho = ALONE_FIRST_RHO * gain;
        rule->growth = fmax(pow(rule->rho / rule->first_rho, 1.0 / growing), 1.0);
    } else if (cropped) {
        rule->first_rho = CROPPED_FIRST_RHO * gain;
        rule->growth = CROPPED_GROWTH;
    } else if (depths == 1) {
        rule->first_rho = usual;
        rule->growth = RESUMED_GROWTH;
    }
}

void hada_refine_rule_ridge(hada_refine_rule *rule, int steps, const hada_model_info *info,
                            const hada_refine_weights *weights, int depths, double gain)
{
    const double usual = weights->tv / RIDGE_WEIGHT, light = rule->tv / (weights->tv * sqrt(info->channels) * gain);
    const double rho = depths > 1 ? RIDGE_RHO_SEVERAL : RIDGE_RHO;
    rule->steps = steps;
    rule->noise = weights->ridge * RIDGE_NOISE * sqrt(RIDGE_RHO / rho) * pow(usual, RIDGE_NOISE_POWER) * light;
    rule->rho = rule->first_rho = rho * pow(usual, RIDGE_RHO_POWER) * gain;
    rule->growth = rule->relaxation = 1.0;
    rule->first_steps = rule->before = rule->ridge = 0;
    rule->resumes = rule->quiet = 1;
    rule->stop = rule->settle = 0.0;
    rule->start = HADA_REFINE_CONTINUE;
}

/* The least rho that follows a weight, in units of the gain. */
#define LEAST_RHO 3e-4

void hada_refine_rule_follow(hada_refine_rule *rule, double tv, double gain, double per, double most)
{
    rule->rho = gain * fmin(fmax(per * tv, LEAST_RHO), fmax(most, tv));
    rule->first_rho = fmin(rule->first_rho, rule->rho);
}

/* A `stop` that ended within 0.1 dB of the best number of steps, for such a rule (docs/explanation/refinement.md).
 * Padded, what is known of a step is |b - v| within the frame, which settles before the planes do. Steps with the
 * learned regulariser settle what those before them left, which need not have come so near. */
static double residual_stop(hada_boundary boundary, const hada_refine_rule *rule)
{
    if (boundary == HADA_BOUNDARY_PADDED)
        return rule->ridge ? 0.006 : 0.003;
    return rule->ridge ? 0.1 : rule->tv > 0.0 ? 0.006 : 0.01;
}

/* Four steps that change planes by less than this leave them within 0.1 dB of what more would make of them
 * (docs/explanation/refinement.md). */
#define SETTLED 0.015

void hada_refine_rule_settle(hada_refine_rule *rule)
{
    rule->settle = SETTLED;
    rule->stop = 0.0;
}

/* Steps in which rho grows. */
static int growing_steps(const hada_refine_rule *rule)
{
    return rule->first_rho > 0.0 && rule->growth > 1.0 ? (int)ceil(log(rule->rho / rule->first_rho) / log(rule->growth))
                                                       : 0;
}

/* Steps before the residual says anything: while depths part it may stand still; while rho grows, light beyond the
 * frame settles where the sensor crops, and the residual of a noisy frame is noise long before its planes are what the
 * learned regulariser needs. */
static int least_steps(hada_boundary boundary, const hada_refine_rule *rule)
{
    enum { SETTLING_STEPS = 5 };
    const int parting = rule->first_steps > 0 ? rule->first_steps + SETTLING_STEPS : 0;
    const int growing = boundary == HADA_BOUNDARY_PADDED || rule->ridge ? growing_steps(rule) : 0;
    return parting > growing ? parting : growing;
}

void hada_refine_rule_stop(hada_refine_rule *rule, hada_boundary boundary, int depths)
{
    if (depths > 1 && rule->tv > 0.0) {
        hada_refine_rule_settle(rule);
        rule->steps = hada_refine_most_steps(rule->steps, depths);
    } else {
        rule->stop = residual_stop(boundary, rule);
        rule->least = least_steps(boundary, rule);
    }
}

hada_refine_shape hada_refine_shape_of(const hada_model_info *info, int max_depths, int max_steps)
{
    hada_refine_shape shape = {.grid_rows = info->grid_rows,
                               .grid_cols = info->grid_cols,
                               .frame = {(info->grid_rows - info->raw_rows) / 2, (info->grid_cols - info->raw_cols) / 2,
                                         info->raw_rows, info->raw_cols},
                               .boundary = info->boundary,
                               .channels = info->channels,
                               .max_sets = 1,
                               .max_planes = max_depths,
                               .max_steps = max_steps};
    shape.window = (hada_rectangle){shape.frame.row0 + (info->raw_rows - info->window_rows) / 2,
                                    shape.frame.col0 + (info->raw_cols - info->window_cols) / 2, info->window_rows,
                                    info->window_cols};
    return shape;
}

static hada_status check_shape(const hada_refine_shape *shape, hada_error *err)
{
    if (shape->channels < 1 || shape->max_sets < 1 || shape->max_planes < shape->max_sets || shape->max_steps < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "refinement: channels, sets, planes and steps must be at least 1 (got %d, %d, %d, %d)",
                         shape->channels, shape->max_sets, shape->max_planes, shape->max_steps);
    if (!hada_rect_inside(&shape->window, shape->grid_rows, shape->grid_cols))
        return hada_fail(err, HADA_ERROR_SIZE, "refinement: the window of %d x %d pixels leaves the grid of %d x %d",
                         shape->window.rows, shape->window.cols, shape->grid_rows, shape->grid_cols);
    if (shape->boundary == HADA_BOUNDARY_PADDED && !hada_rect_inside(&shape->frame, shape->grid_rows, shape->grid_cols))
        return hada_fail(err, HADA_ERROR_SIZE, "refinement: the frame of %d x %d pixels leaves the grid of %d x %d",
                         shape->frame.rows, shape->frame.cols, shape->grid_rows, shape->grid_cols);
    return HADA_OK;
}

/* Transforms of one rectangle's images, at most HADA_REFINE_BATCH at once, so that the plans' scratch stays small. */
static hada_status make_transforms(hada_fft_pair *pair, const hada_refiner *refiner, const hada_rectangle *rect,
                                   int images, hada_error *err)
{
    const hada_refine_shape *shape = &refiner->shape;
    const int batch = hada_least(images * shape->channels, HADA_REFINE_BATCH);
    return hada_fft_pair_create(pair, refiner->slot,
                                hada_fft_of(HADA_FFT_FORWARD, shape->grid_rows, shape->grid_cols, batch, *rect), err);
}

/* Bytes of every buffer. */
typedef struct sizes {
    size_t spectra, planes, shown, kept, split, dual, partial, partials, tv, places, cells, residual;
    int slices;
} sizes;

static sizes sizes_of(const hada_context *context, const hada_refine_shape *shape)
{
    sizes b = {0};
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    const size_t images = (size_t)shape->max_planes * (size_t)shape->channels;
    const size_t sets = (size_t)shape->max_sets * (size_t)shape->channels;
    const size_t complex_bytes = 2 * sizeof(float);
    size_t longest = layout.count;
    b.residual = shape->past ? sets * layout.count * complex_bytes : 0;
    b.spectra = images * layout.count * complex_bytes;
    /* total variation's loads reach a vector beyond the last image */
    b.planes = hada_round_up(images * hada_rect_area(&shape->window) + 8, HADA_REFINE_PAD) * sizeof(float);
    b.shown = images * hada_rect_area(&shape->shown) * sizeof(float);
    const size_t settling_images = shape->settle ? images : 0;
    const size_t looks = hada_refine_looks(context);
    b.kept = looks * settling_images * hada_rect_area(&shape->window) * sizeof(float);
    b.tv = shape->tv ? hada_variation_floats(context, shape->channels, shape->window.rows, shape->window.cols,
                                             shape->max_planes) *
                           sizeof(float)
                     : 0;
    if (shape->boundary == HADA_BOUNDARY_PADDED) {
        b.split = b.residual = sets * layout.count * complex_bytes;
        b.dual = sets * hada_rect_area(&shape->frame) * sizeof(float);
        if (hada_rect_area(&shape->frame) > longest)
            longest = hada_rect_area(&shape->frame);
    }
    b.slices = (int)((longest + HADA_REFINE_SLICE - 1) / HADA_REFINE_SLICE);
    const int fused = hada_refine_fused_most_slices(context, &layout);
    if (b.slices < fused)
        b.slices = fused;
    const int rows = (int)hada_refine_fused_frame_slices(context, shape);
    if (shape->boundary == HADA_BOUNDARY_PADDED && b.slices < rows)
        b.slices = rows;
    b.partials = sets * (size_t)b.slices;
    b.partial = ((size_t)shape->max_steps + 2) * b.partials * sizeof(float);
    b.partial += looks * 2 * settling_images * hada_refine_slices(hada_rect_area(&shape->window)) * sizeof(float);
    b.places = shape->past ? images * hada_divide_up(hada_rect_area(&shape->window), HADA_REFINE_PLACE) : 0;
    if (b.partial < b.places * sizeof(float))
        b.partial = b.places * sizeof(float);
    b.cells = b.partial / sizeof(float);
    b.partial +=
        shape->past ? hada_shift_floats(shape->max_planes, shape->window.rows, shape->window.cols) * sizeof(float) : 0;
    return b;
}

enum { ROWS = 15 };

static void list_buffers(const sizes *b, hada_buffer_row *rows)
{
    static const char past[] = "what a frame leaves for the next one";
    const size_t kept = b->places ? 1 : 0;
    const hada_buffer_row list[ROWS] = {
        {offsetof(hada_refiner, planes), b->planes, "the refined planes", b->shown ? HADA_OWN_STEPS : HADA_RESULT},
        {offsetof(hada_refiner, shown), b->shown, "the refined planes", HADA_RESULT},
        {offsetof(hada_refiner, kept), b->kept, "the planes of a step before", HADA_OWN_STEPS},
        {offsetof(hada_refiner, now_u), b->spectra + b->split, "the spectra of the refined planes", HADA_OWN_STEPS},
        {offsetof(hada_refiner, now_w), b->spectra + b->split, "the spectra of the refinement's duals", HADA_OWN_STEPS},
        {offsetof(hada_refiner, partial), b->partial, "the refinement's residuals", HADA_OWN_STEPS},
        {offsetof(hada_refiner, dual), b->dual, "the refinement's split at the frame", HADA_OWN_STEPS},
        {offsetof(hada_refiner, residual), b->residual, "the refinement's residuals", HADA_OWN_STEPS},
        {offsetof(hada_refiner, residual_frame), b->dual, "the refinement's residuals", HADA_OWN_STEPS},
        {offsetof(hada_refiner, tv[0]), b->tv, "the refinement's total variation", HADA_OWN_STEPS},
        {offsetof(hada_refiner, tv[1]), b->tv, "the refinement's total variation", HADA_OWN_STEPS},
        {offsetof(hada_refiner, past.planes), kept * b->planes, past, HADA_LASTING},
        {offsetof(hada_refiner, past.now_w), kept * (b->spectra + b->split), past, HADA_LASTING},
        {offsetof(hada_refiner, past.dual), kept * b->dual, past, HADA_LASTING},
        {offsetof(hada_refiner, past.tv), kept * b->tv, past, HADA_LASTING}};
    memcpy(rows, list, sizeof list);
}

static hada_status make_buffers(hada_refiner *refiner, const sizes *b, hada_error *err)
{
    hada_buffer_row rows[ROWS];
    list_buffers(b, rows);
    HADA_TRY(hada_buffer_rows_take(refiner, refiner->slot, rows, ROWS, err));
    return hada_buffer_clear(&refiner->planes, refiner->slot, 0, b->planes, err);
}

hada_status hada_refine_prepare(hada_refiner *refiner, hada_error *err)
{
    /* vectors need whole ones of eight frequencies in a row of the layout */
    refiner->program = HADA_PROGRAM_VARIANT(REFINE, refiner->slot->context, refiner->layout.block % 8 == 0);
    refiner->group = (size_t)hada_macros_of_refine(refiner->program)->refine_group;
    return hada_prepare_refine(refiner->slot, refiner->program, err);
}

hada_status hada_refiner_create(hada_refiner **out, hada_slot *slot, const hada_refine_shape *shape, hada_error *err)
{
    static const char what[] = "the refinement's residuals";
    hada_refiner *refiner = NULL;
    sizes b;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(check_shape(shape, err));
    HADA_TRY_OR_DONE(HADA_NEW(refiner, 1, "a refiner", err));
    b = sizes_of(slot->context, shape);
    refiner->slot = slot;
    refiner->mu = 1.0;
    refiner->shape = *shape;
    refiner->layout = hada_fft_layout(slot->context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    refiner->partials = b.partials;
    refiner->cells = b.cells;
    refiner->split = (size_t)shape->max_planes * (size_t)shape->channels * refiner->layout.count;
    refiner->window_area = hada_rect_area(&shape->window);
    refiner->frame_area = hada_rect_area(&shape->frame);
    HADA_TRY_OR_DONE(HADA_NEW(refiner->energy, ((size_t)shape->max_steps + 1) * (size_t)shape->max_sets, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(refiner->host_partial, b.partial / sizeof(float), what, err));
    HADA_TRY_OR_DONE(HADA_NEW(refiner->host_list, (size_t)shape->max_planes, what, err));
    if (shape->past)
        HADA_TRY_OR_DONE(HADA_NEW(refiner->past.list, (size_t)shape->max_planes, what, err));
    HADA_TRY_OR_DONE(make_transforms(&refiner->fft, refiner, &shape->window, shape->max_planes, err));
    if (shape->boundary == HADA_BOUNDARY_PADDED)
        HADA_TRY_OR_DONE(make_transforms(&refiner->frame_fft, refiner, &shape->frame, shape->max_sets, err));
    HADA_TRY_OR_DONE(make_buffers(refiner, &b, err));
    HADA_TRY_OR_DONE(hada_refine_prepare(refiner, err));
    HADA_TRY_OR_DONE(hada_refine_fused_make(refiner, err));
    if (shape->past)
        HADA_TRY_OR_DONE(hada_prepare_refine_move(slot, hada_program_refine_move_of(slot), err));
    if (shape->tv)
        HADA_TRY_OR_DONE(hada_variation_prepare(&refiner->variation, slot, shape->channels, shape->window.rows,
                                                shape->window.cols, err));
    if (shape->tv && shape->ridge)
        HADA_TRY_OR_DONE(
            hada_ridge_prepare(&refiner->ridge, slot, shape->channels, shape->window.rows, shape->window.cols, err));
    if (shape->crosstalk)
        HADA_TRY_OR_DONE(hada_crosstalk_prepare(&refiner->crosstalk, slot, shape->channels, shape->window.rows,
                                                shape->window.cols, err));
    *out = refiner;
done:
    if (status)
        hada_refiner_destroy(&refiner);
    return status;
}

void hada_refiner_destroy(hada_refiner **pointer)
{
    hada_refiner *refiner = hada_taken(pointer);
    hada_buffer_row rows[ROWS];
    if (!refiner)
        return;
    hada_slot_finish(refiner->slot, NULL);
    hada_fft_pair_destroy(&refiner->fft);
    hada_fft_pair_destroy(&refiner->frame_fft);
    hada_fft_fused_free(&refiner->fused);
    hada_buffer_destroy(&refiner->list);
    list_buffers(&(sizes){0}, rows);
    hada_buffer_rows_destroy(refiner, rows, ROWS);
    HADA_FREE(refiner->energy, refiner->host_partial, refiner->host_list, refiner->past.list, refiner);
}

hada_status hada_refiner_fade(hada_refiner *refiner, int depths, double share, hada_error *err)
{
    refiner->half_there = 0;
    /* the next run begins anew: room enough, for every plane has a spectrum of the grid there */
    return hada_crosstalk_fade(&refiner->crosstalk, refiner->slot, refiner->planes.mem, refiner->now_w.mem, depths,
                               share, err);
}

hada_status hada_refiner_crop(hada_refiner *refiner, int depths, hada_error *err)
{
    const hada_rectangle *window = &refiner->shape.window, *shown = &refiner->shape.shown;
    const size_t images = (size_t)depths * (size_t)refiner->shape.channels;
    if (!refiner->shown.mem)
        return HADA_OK;
    const hada_range range = hada_range_of((size_t)shown->cols, 64, (size_t)shown->rows, images);
    hada_slot_cost(refiner->slot, 8.0 * (double)(hada_rect_area(shown) * images), 0.0);
    return hada_launch_refine_part(refiner->slot, refiner->program, &range, err, .in = refiner->planes.mem,
                                   .out = refiner->shown.mem, .rows = window->rows, .cols = window->cols,
                                   .row0 = shown->row0 - window->row0, .col0 = shown->col0 - window->col0,
                                   .to_cols = shown->cols);
}

cl_mem hada_refiner_planes(const hada_refiner *refiner)
{
    return refiner->shown.mem ? refiner->shown.mem : refiner->planes.mem;
}

double hada_refiner_tv(const hada_refiner *refiner)
{
    return refiner->last_tv;
}

size_t hada_refiner_transforms(const hada_refiner *refiner)
{
    return refiner->transforms;
}
