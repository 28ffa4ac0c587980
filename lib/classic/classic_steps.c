#include "classic/classic_steps.h"

#include <math.h>

#include "launch/classic_columns.h"
#include "launch/classic_field.h"
#include "launch/classic_frame.h"
#include "launch/classic_rows.h"
#include "launch/classic_step.h"

static hada_rectangle at_top_left(const hada_rectangle *rect)
{
    return (hada_rectangle){0, 0, rect->rows, rect->cols};
}

/* ADMM has its gradients on the whole grid. */
hada_rectangle hada_classic_plane_rect(const hada_classic_shape *shape)
{
    const hada_rectangle grid = {0, 0, shape->grid_rows, shape->grid_cols};
    if (shape->reach.rows)
        return at_top_left(&shape->support);
    return shape->options.method == HADA_METHOD_ADMM ? grid : shape->support;
}

hada_rectangle hada_classic_frame_rect(const hada_classic_shape *shape)
{
    const hada_rectangle grid = {0, 0, shape->grid_rows, shape->grid_cols};
    if (shape->reach.rows)
        return at_top_left(&shape->place.frame);
    return shape->place.boundary == HADA_BOUNDARY_PADDED ? shape->place.frame : grid;
}

void hada_classic_swap(hada_classic *classic, hada_classic_part a, hada_classic_part b)
{
    const hada_buffer kept = classic->part[a];
    classic->part[a] = classic->part[b];
    classic->part[b] = kept;
}

hada_status hada_classic_clear(hada_classic *classic, hada_classic_part part, hada_error *err)
{
    return classic->bytes[part] ? hada_buffer_clear(&classic->part[part], classic->slot, 0, classic->bytes[part], err)
                                : HADA_OK;
}

hada_status hada_classic_write_table(hada_classic *classic, hada_error *err)
{
    return hada_buffer_write(&classic->part[HADA_CLASSIC_TABLE], classic->slot, 0, classic->table,
                             classic->bytes[HADA_CLASSIC_TABLE], err);
}

/* An iteration in fused passes: along columns both transforms with the product between them, along rows both with the
 * step on the pixels between them (kernels/classic_columns.cl, classic_rows.cl). Whole spectra stand nowhere. */

/* The usual count of a transform of n points, in operations. */
static double transform(double n)
{
    return 5.0 * n * log2(n > 2.0 ? n : 2.0);
}

hada_status hada_classic_fused_columns(hada_classic *classic, int transpose, hada_error *err)
{
    const hada_refine_data *data = classic->job->data;
    const hada_spectrum_layout *layout = &classic->layout;
    const hada_own_pass *pass = &classic->fused.columns;
    const hada_rectangle plane = hada_classic_plane_rect(&classic->shape);
    const hada_rectangle frame = hada_classic_frame_rect(&classic->shape);
    const int depths = hada_classic_terms(classic), channels = classic->shape.place.channels;
    const hada_classic_columns job = {.otf_offset = data->otf_offset,
                                      .plane_row0 = plane.row0,
                                      .plane_rows = plane.rows,
                                      .frame_row0 = frame.row0,
                                      .frame_rows = frame.rows,
                                      .depths = depths,
                                      .channels = channels,
                                      .blocks = layout->blocks,
                                      .transpose = transpose};
    const hada_local scratch = {pass->local_bytes * (depths > 1 ? 2 : 1)};
    const hada_range range = hada_range_of((size_t)(layout->blocks * channels), 1, 1, 1);
    const double columns = (layout->cols / 2 + 1.0) * channels, rows = layout->rows;
    hada_slot_cost(classic->slot, 8.0 * columns * (depths * (rows + plane.rows) + frame.rows),
                   columns * ((depths + 1.0) * transform(rows) + 8.0 * depths * rows));
    return hada_launch_classic_columns(classic->slot, HADA_PROGRAM_CLASSIC_COLUMNS_DEFAULT, &range, err,
                                       .planes = classic->part[HADA_CLASSIC_SPECTRA].mem,
                                       .frames = classic->part[HADA_CLASSIC_PROJECTION].mem, .otf = data->otf,
                                       .list = classic->part[HADA_CLASSIC_LIST].ints, .job = job,
                                       .table = pass->table.ints, .scratch = scratch);
}

/* A pass along rows: which buffers, where their images stand on the grid, and how many there are. */
typedef struct rows_pass {
    hada_classic_part spectra, images, first, work;
    const hada_classic_image *image;
    hada_rectangle rect;
    int count, inverse, forward;
    hada_classic_pixel_step step;
    double number, traffic; /* bytes of a pixel */
} rows_pass;

static hada_status run_rows(hada_classic *classic, const rows_pass *pass, hada_error *err)
{
    const hada_spectrum_layout *layout = &classic->layout;
    const hada_fft_fused *fused = &classic->fused;
    const int rows = pass->image->rows, cols = pass->rect.cols;
    const hada_classic_rows job = {.back_table = fused->back_table,
                                   .blocks = layout->blocks,
                                   .inverse = pass->inverse,
                                   .forward = pass->forward,
                                   .step = (int)pass->step,
                                   .channels = classic->shape.place.channels,
                                   .rows = rows,
                                   .pitch = pass->image->pitch,
                                   .weighted = classic->weighted && pass->step != HADA_CLASSIC_MOMENTUM,
                                   .col0 = pass->rect.col0,
                                   .cols = cols,
                                   .number = (float)pass->number,
                                   .scale = (float)(1.0 / ((double)layout->rows * layout->cols))};
    const hada_local scratch = {fused->rows.local_bytes};
    const hada_range range =
        hada_range_of((size_t)pass->count * hada_divide_up((size_t)rows, HADA_CLASSIC_ROWS), 1, 1, 1);
    const double all = (double)pass->count * rows, times = pass->inverse + pass->forward;
    hada_slot_cost(classic->slot, all * (8.0 * times * (layout->cols / 2 + 1.0) + pass->traffic * cols),
                   all * (0.5 * times * transform(layout->cols) + (pass->step ? 8.0 : 0.0) * cols));
    /* steps per channel, or weights of the frame's values */
    const hada_classic_part factors = pass->step == HADA_CLASSIC_MOMENTUM ? HADA_CLASSIC_TABLE : HADA_CLASSIC_WEIGHTS;
    return hada_launch_classic_rows(
        classic->slot, HADA_PROGRAM_CLASSIC_ROWS_DEFAULT, &range, err, .spectra = classic->part[pass->spectra].mem,
        .images = classic->part[pass->images].mem, .first = classic->part[pass->first].mem,
        .work = classic->part[pass->work].mem, .factors = classic->part[factors].mem, .job = job,
        .tables = fused->row_tables.ints, .partial = classic->part[HADA_CLASSIC_PARTIAL].mem, .scratch = scratch);
}

/* PROJECTION -> PREDICTION where `inverse`, the step where there is one, PREDICTION -> PROJECTION where `forward`. */
static hada_status fused_frame(hada_classic *classic, int inverse, int forward, hada_classic_pixel_step step,
                               double number, hada_error *err)
{
    const rows_pass pass = {.spectra = HADA_CLASSIC_PROJECTION,
                            .images = HADA_CLASSIC_PREDICTION,
                            .first = HADA_CLASSIC_FRAME,
                            .work = HADA_CLASSIC_PREDICTION,
                            .image = &classic->frame,
                            .rect = hada_classic_frame_rect(&classic->shape),
                            .count = classic->shape.place.channels,
                            .inverse = inverse,
                            .forward = forward,
                            .step = step,
                            .number = number,
                            .traffic = (step ? 8.0 : 4.0) + (step && classic->weighted ? 4.0 : 0.0)};
    return run_rows(classic, &pass, err);
}

static rows_pass of_planes(const hada_classic *classic, hada_classic_part planes)
{
    return (rows_pass){.spectra = HADA_CLASSIC_SPECTRA,
                       .images = planes,
                       .first = planes,
                       .work = planes,
                       .image = &classic->plane,
                       .rect = hada_classic_plane_rect(&classic->shape),
                       .count = hada_classic_images(classic),
                       .traffic = 4.0};
}

/* SPECTRA -> a part, or back. */
static hada_status fused_planes(hada_classic *classic, hada_classic_part planes, int forward, hada_error *err)
{
    rows_pass pass = of_planes(classic, planes);
    pass.forward = forward;
    pass.inverse = !forward;
    return run_rows(classic, &pass, err);
}

hada_status hada_classic_fused_momentum(hada_classic *classic, double beta, hada_error *err)
{
    rows_pass pass = of_planes(classic, HADA_CLASSIC_EXTRAPOLATED);
    pass.first = HADA_CLASSIC_PRIMAL;
    pass.work = HADA_CLASSIC_GRADIENT;
    pass.inverse = pass.forward = 1;
    pass.step = HADA_CLASSIC_MOMENTUM;
    pass.number = beta;
    pass.traffic = 16.0;
    return run_rows(classic, &pass, err);
}

hada_status hada_classic_forward(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    return hada_fft_all(classic->fft.forward, hada_classic_images(classic), classic->part[planes].mem,
                        classic->part[HADA_CLASSIC_SPECTRA].mem, 0, err);
}

hada_status hada_classic_inverse(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    return hada_fft_all(classic->fft.inverse, hada_classic_images(classic), classic->part[planes].mem,
                        classic->part[HADA_CLASSIC_SPECTRA].mem, 0, err);
}

hada_status hada_classic_frame_forward(hada_classic *classic, hada_classic_part spectrum, hada_error *err)
{
    if (classic->fuses)
        return fused_frame(classic, 0, 1, HADA_CLASSIC_NO_STEP, 0.0, err);
    return hada_fft_all(classic->frame_fft.forward, classic->shape.place.channels,
                        classic->part[HADA_CLASSIC_PREDICTION].mem, classic->part[spectrum].mem, 0, err);
}

hada_status hada_classic_frame_inverse(hada_classic *classic, hada_error *err)
{
    return hada_fft_all(classic->frame_fft.inverse, classic->shape.place.channels,
                        classic->part[HADA_CLASSIC_PREDICTION].mem, classic->part[HADA_CLASSIC_PROJECTION].mem, 0, err);
}

static size_t spectrum_slices(const hada_classic *classic)
{
    return hada_divide_up(classic->layout.count, HADA_CLASSIC_SLICE);
}

/* Slices of frequencies of all channels. */
static hada_range spectrum_range(const hada_classic *classic)
{
    return hada_range_groups(spectrum_slices(classic), classic->group, (size_t)classic->shape.place.channels, 1);
}

static double frequencies(const hada_classic *classic)
{
    return (double)classic->layout.rows * (classic->layout.cols / 2 + 1.0) * classic->shape.place.channels;
}

static hada_classic_problem problem_of(const hada_classic *classic)
{
    const hada_refine_data *data = classic->job->data;
    return (hada_classic_problem){.otf_offset = data->otf_offset,
                                  .frame_offset = data->spectrum_offset,
                                  .spectrum = hada_spectrum_shape_of(&classic->layout),
                                  .depths = hada_classic_terms(classic),
                                  .slice = HADA_CLASSIC_SLICE};
}

hada_status hada_classic_project(hada_classic *classic, int residual, hada_error *err)
{
    const hada_refine_data *data = classic->job->data;
    const int depths = hada_classic_terms(classic);
    const hada_range range = spectrum_range(classic);
    hada_slot_cost(classic->slot, frequencies(classic) * (16.0 * depths + (residual ? 16.0 : 8.0)),
                   frequencies(classic) * 8.0 * depths);
    return hada_launch_classic_project(
        classic->slot, classic->spectrum_program, &range, err, .otf = data->otf,
        .list = classic->part[HADA_CLASSIC_LIST].ints, .data = data->spectrum, .has_data = residual,
        .planes = classic->part[HADA_CLASSIC_SPECTRA].mem, .out = classic->part[HADA_CLASSIC_PROJECTION].mem,
        .problem = problem_of(classic), .partial = classic->part[HADA_CLASSIC_PARTIAL].mem);
}

/* HADA_CLASSIC_SPECTRA = conj(H) HADA_CLASSIC_PROJECTION. */
static hada_status project_transpose(hada_classic *classic, hada_error *err)
{
    const int depths = hada_classic_terms(classic);
    const hada_range range = spectrum_range(classic);
    hada_slot_cost(classic->slot, frequencies(classic) * (16.0 * depths + 8.0), frequencies(classic) * 6.0 * depths);
    return hada_launch_classic_transpose(
        classic->slot, classic->spectrum_program, &range, err, .otf = classic->job->data->otf,
        .list = classic->part[HADA_CLASSIC_LIST].ints, .in = classic->part[HADA_CLASSIC_PROJECTION].mem,
        .planes = classic->part[HADA_CLASSIC_SPECTRA].mem, .problem = problem_of(classic));
}

hada_status hada_classic_solve(hada_classic *classic, int first, double mu1, double mu2, double mu3, hada_error *err)
{
    const hada_refine_data *data = classic->job->data;
    const int depths = classic->job->depths, cropped = classic->bytes[HADA_CLASSIC_DATA_SPLIT] != 0;
    const hada_classic_weights weights = {(float)mu1, (float)mu2, (float)mu3, cropped, first};
    const hada_range range = spectrum_range(classic);
    hada_classic_problem problem = problem_of(classic);
    if (cropped)
        problem.frame_offset = 0;
    hada_slot_cost(classic->slot, frequencies(classic) * ((first ? 16.0 : 24.0) * depths + (cropped ? 24.0 : 8.0)),
                   frequencies(classic) * (30.0 * depths + 20.0));
    return hada_launch_classic_solve(
        classic->slot, classic->spectrum_program, &range, err, .otf = data->otf,
        .list = classic->part[HADA_CLASSIC_LIST].ints,
        .data = cropped ? classic->part[HADA_CLASSIC_DATA_SPLIT].mem : data->spectrum,
        .split_y = classic->part[HADA_CLASSIC_PROJECTION].mem, .planes = classic->part[HADA_CLASSIC_SPECTRA].mem,
        .gradient = classic->part[HADA_CLASSIC_TABLE].mem, .problem = problem, .weights = weights);
}

static size_t frame_slice_count(const hada_classic *classic)
{
    return hada_divide_up(classic->frame.pixels, HADA_CLASSIC_SLICE);
}

static hada_range frame_range(const hada_classic *classic)
{
    return hada_range_groups(frame_slice_count(classic), classic->group, (size_t)classic->shape.place.channels, 1);
}

static hada_classic_slices frame_slices(const hada_classic *classic)
{
    return (hada_classic_slices){(unsigned)classic->shape.place.channels, (unsigned)classic->frame.pixels,
                                 HADA_CLASSIC_SLICE};
}

hada_status hada_classic_step_pixels(hada_classic *classic, hada_classic_pixel_step step, double number,
                                     hada_error *err)
{
    const int split = step == HADA_CLASSIC_SPLIT;
    const hada_range range = frame_range(classic);
    const double all = (double)classic->frame.pixels * classic->shape.place.channels;
    hada_slot_cost(classic->slot, ((split ? 20.0 : 12.0) + (classic->weighted ? 4.0 : 0.0)) * all, 6.0 * all);
    return hada_launch_classic_frame(
        classic->slot, hada_program_classic_frame_of(classic->slot), &range, err,
        .images = classic->part[HADA_CLASSIC_PREDICTION].mem, .frame = classic->part[HADA_CLASSIC_FRAME].mem,
        .weights = classic->part[HADA_CLASSIC_WEIGHTS].mem, .weighted = classic->weighted,
        .dual = classic->part[split ? HADA_CLASSIC_DATA_DUAL : HADA_CLASSIC_PREDICTION].mem, .step = (cl_int)step,
        .number = (float)number, .slices = frame_slices(classic));
}

/* Where the weights of components begin, behind the transfer functions, in floats. */
static size_t maps_at(const hada_classic *classic)
{
    const hada_classic_shape *shape = &classic->shape;
    const size_t terms = (size_t)classic->job->data->otf_depths * (size_t)shape->components;
    return 2 * (classic->job->data->otf_offset + terms * (size_t)shape->place.channels * classic->layout.count);
}

static hada_range images_range(const hada_classic *classic, int images)
{
    return hada_range_groups(hada_classic_slice_count(classic), classic->group, (size_t)images, 1);
}

/* HADA_CLASSIC_COMPONENTS = planes times the weights of each component. */
static hada_status part_planes(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    const hada_range range = images_range(classic, hada_classic_images(classic));
    const double all = (double)classic->plane.pixels * hada_classic_images(classic);
    hada_slot_cost(classic->slot, 12.0 * all, all);
    return hada_launch_classic_part(
        classic->slot, hada_program_classic_field_of(classic->slot), &range, err, .planes = classic->part[planes].mem,
        .parts = classic->part[HADA_CLASSIC_COMPONENTS].mem, .list = classic->part[HADA_CLASSIC_LIST].ints,
        .maps = classic->job->data->otf, .offset = maps_at(classic), .components = classic->shape.components,
        .slices = hada_classic_plane_slices(classic));
}

/* planes = the sum over components of HADA_CLASSIC_COMPONENTS times their weights. */
static hada_status unite_planes(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    const hada_range range = images_range(classic, classic->planes);
    const double all = (double)classic->plane.pixels * hada_classic_images(classic);
    hada_slot_cost(classic->slot, 12.0 * all, 2.0 * all);
    return hada_launch_classic_unite(
        classic->slot, hada_program_classic_field_of(classic->slot), &range, err,
        .parts = classic->part[HADA_CLASSIC_COMPONENTS].mem, .planes = classic->part[planes].mem,
        .list = classic->part[HADA_CLASSIC_LIST].ints, .maps = classic->job->data->otf, .offset = maps_at(classic),
        .components = classic->shape.components, .slices = hada_classic_plane_slices(classic));
}

hada_status hada_classic_predict(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    if (classic->shape.components > 1) {
        HADA_TRY(part_planes(classic, planes, err));
        planes = HADA_CLASSIC_COMPONENTS;
    }
    if (classic->fuses) {
        HADA_TRY(fused_planes(classic, planes, 1, err));
        HADA_TRY(hada_classic_fused_columns(classic, 0, err));
    } else {
        HADA_TRY(hada_classic_forward(classic, planes, err));
        HADA_TRY(hada_classic_project(classic, 0, err));
    }
    return HADA_OK;
}

hada_status hada_classic_data_step(hada_classic *classic, hada_classic_pixel_step step, double number, int forward,
                                   hada_error *err)
{
    if (classic->fuses)
        return fused_frame(classic, 1, forward, step, number, err);
    HADA_TRY(hada_classic_frame_inverse(classic, err));
    HADA_TRY(hada_classic_step_pixels(classic, step, number, err));
    if (forward)
        HADA_TRY(hada_classic_frame_forward(classic, HADA_CLASSIC_PROJECTION, err));
    return HADA_OK;
}

hada_status hada_classic_transpose(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    const int varies = classic->shape.components > 1;
    const hada_classic_part to = varies ? HADA_CLASSIC_COMPONENTS : planes;
    if (classic->fuses) {
        HADA_TRY(hada_classic_fused_columns(classic, 1, err));
        HADA_TRY(fused_planes(classic, to, 0, err));
    } else {
        HADA_TRY(project_transpose(classic, err));
        HADA_TRY(hada_classic_inverse(classic, to, err));
    }
    return varies ? unite_planes(classic, planes, err) : HADA_OK;
}

hada_status hada_classic_load(hada_classic *classic, hada_classic_part part, cl_mem image, size_t offset,
                              hada_error *err)
{
    const hada_classic_image *frame = &classic->frame;
    const size_t channels = (size_t)classic->shape.place.channels;
    const hada_range range = hada_range_of((size_t)frame->pitch, 8, (size_t)frame->rows, channels);
    hada_slot_cost(classic->slot, 8.0 * (double)frame->pixels * (double)channels, 0.0);
    return hada_launch_classic_pad(classic->slot, hada_program_classic_frame_of(classic->slot), &range, err,
                                   .frame = image, .offset = offset, .images = classic->part[part].mem,
                                   .cols = frame->cols);
}

size_t hada_classic_band_count(const hada_classic *classic)
{
    return hada_divide_up((size_t)classic->plane.rows, (size_t)classic->plane.band);
}

size_t hada_classic_slice_count(const hada_classic *classic)
{
    return hada_divide_up(classic->plane.pixels, HADA_CLASSIC_SLICE);
}

size_t hada_classic_task_count(const hada_classic *classic)
{
    return hada_divide_up((size_t)classic->plane.rows, HADA_CLASSIC_ROWS);
}

hada_classic_bands hada_classic_plane_bands(const hada_classic *classic)
{
    const hada_classic_image *image = &classic->plane;
    return (hada_classic_bands){image->rows, image->cols, image->pitch, image->band};
}

hada_classic_slices hada_classic_plane_slices(const hada_classic *classic)
{
    return (hada_classic_slices){(unsigned)classic->shape.place.channels, (unsigned)classic->plane.pixels,
                                 HADA_CLASSIC_SLICE};
}

hada_range hada_classic_band_range(const hada_classic *classic)
{
    return hada_range_groups(hada_classic_band_count(classic), classic->group, (size_t)classic->planes, 1);
}

hada_range hada_classic_slice_range(const hada_classic *classic)
{
    return hada_range_groups(hada_classic_slice_count(classic), classic->group, (size_t)classic->planes, 1);
}

/* Each sum over `each` partial ones, in order and in double. */
static hada_status add_up(hada_classic *classic, size_t each, int count, double *sums, hada_error *err)
{
    HADA_TRY(hada_buffer_read(&classic->part[HADA_CLASSIC_PARTIAL], classic->slot, 0, classic->sums,
                              each * (size_t)count * sizeof(float), err));
    for (int k = 0; k < count; k++) {
        sums[k] = 0.0;
        for (size_t i = 0; i < each; i++)
            sums[k] += classic->sums[(size_t)k * each + i];
    }
    return HADA_OK;
}

hada_status hada_classic_sums(hada_classic *classic, size_t each, int count, double *sums, hada_error *err)
{
    return add_up(classic, each * (size_t)classic->planes, count, sums, err);
}

#define REACH 3.5 /* of a Gaussian, in standard deviations */

static hada_status write_taps(hada_classic *classic, double width, hada_error *err)
{
    double taps[HADA_CLASSIC_REACH + 1], sum = 0.0;
    const int reach = (int)ceil(REACH * width);
    if (classic->taps == width)
        return HADA_OK;
    classic->taps = width;
    classic->reach = reach < HADA_CLASSIC_REACH ? reach : HADA_CLASSIC_REACH;
    for (int i = 0; i <= classic->reach; i++) {
        taps[i] = exp(-0.5 * i * i / (width * width));
        sum += i ? 2.0 * taps[i] : taps[i];
    }
    for (int i = 0; i <= classic->reach; i++)
        classic->table[i] = (float)(taps[i] / sum);
    return hada_classic_write_table(classic, err);
}

hada_status hada_classic_blur(hada_classic *classic, double width, hada_classic_part from, hada_classic_part to,
                              hada_error *err)
{
    const hada_range range = hada_classic_band_range(classic);
    const double all = (double)classic->plane.pixels * classic->planes;
    HADA_TRY(write_taps(classic, width, err));
    const size_t margin = hada_divide_up((size_t)classic->reach, 8) * 8;
    hada_slot_cost(classic->slot, 8.0 * all, 4.0 * (2.0 * classic->reach + 1.0) * all);
    return hada_launch_classic_blur(classic->slot, hada_program_classic_step_of(classic->slot), &range, err,
                                    .planes = classic->part[from].mem, .blurred = classic->part[to].mem,
                                    .taps = classic->part[HADA_CLASSIC_TABLE].mem, .reach = classic->reach,
                                    .image = hada_classic_plane_bands(classic),
                                    .line = {((size_t)classic->plane.pitch + 2 * margin) * sizeof(float)});
}

/* What the planes show: PRIMAL, or BLURRED, which takes G PRIMAL. */
static hada_status show(hada_classic *classic, hada_classic_part *shown, hada_error *err)
{
    *shown = classic->sieve > 0.0 ? HADA_CLASSIC_BLURRED : HADA_CLASSIC_PRIMAL;
    return classic->sieve > 0.0
               ? hada_classic_blur(classic, classic->sieve, HADA_CLASSIC_PRIMAL, HADA_CLASSIC_BLURRED, err)
               : HADA_OK;
}

hada_status hada_classic_crop(hada_classic *classic, hada_error *err)
{
    const hada_rectangle *window = &classic->shape.place.window, *support = &classic->shape.support;
    const hada_classic_image *plane = &classic->plane;
    const int whole = plane->rows != support->rows || plane->cols != support->cols;
    const hada_range range = hada_range_of((size_t)plane->pitch, 8, (size_t)plane->rows, (size_t)classic->planes);
    hada_classic_part shown;
    HADA_TRY(show(classic, &shown, err));
    hada_slot_cost(classic->slot, 12.0 * (double)plane->pixels * classic->planes, 0.0);
    return hada_launch_classic_crop(
        classic->slot, hada_program_classic_frame_of(classic->slot), &range, err, .planes = classic->part[shown].mem,
        .window = classic->part[HADA_CLASSIC_WINDOW].mem, .pitch = plane->pitch,
        .row0 = window->row0 - (whole ? 0 : support->row0), .col0 = window->col0 - (whole ? 0 : support->col0),
        .rows = window->rows, .cols = window->cols);
}

/* By Parseval, where the frame's pixels are not used. */
static hada_status spectral_energy(hada_classic *classic, double *energy, hada_error *err)
{
    const size_t channels = (size_t)classic->shape.place.channels;
    HADA_TRY(hada_classic_forward(classic, HADA_CLASSIC_PRIMAL, err));
    HADA_TRY(hada_classic_project(classic, 1, err));
    HADA_TRY(add_up(classic, channels * spectrum_slices(classic), 1, energy, err));
    *energy /= (double)classic->layout.rows * classic->layout.cols;
    return HADA_OK;
}

hada_status hada_classic_energy(hada_classic *classic, double *energy, hada_error *err)
{
    const hada_range range = frame_range(classic);
    hada_classic_part shown;
    if (!classic->has_frame)
        return spectral_energy(classic, energy, err);
    HADA_TRY(show(classic, &shown, err));
    HADA_TRY(hada_classic_predict(classic, shown, err));
    if (classic->shape.components > 1 || classic->sieve > 0.0) /* ratios are 1 between a row's pixels and its pitch */
        HADA_TRY(hada_classic_clear(classic, HADA_CLASSIC_PREDICTION, err));
    HADA_TRY(hada_classic_data_step(classic, HADA_CLASSIC_LEFT, 0.0, 0, err));
    HADA_TRY(hada_launch_classic_energy(classic->slot, hada_program_classic_frame_of(classic->slot), &range, err,
                                        .images = classic->part[HADA_CLASSIC_PREDICTION].mem,
                                        .slices = frame_slices(classic),
                                        .partial = classic->part[HADA_CLASSIC_PARTIAL].mem));
    return add_up(classic, (size_t)classic->shape.place.channels * frame_slice_count(classic), 1, energy, err);
}

void hada_classic_gradient_power(hada_classic *classic, int zero)
{
    const hada_spectrum_layout *layout = &classic->layout;
    const double turn = 2.0 * acos(-1.0);
    const int columns = layout->blocks * layout->block;
    for (int k = 0; k < layout->rows + columns; k++) {
        const double angle = k < layout->rows ? turn * k / layout->rows : turn * (k - layout->rows) / layout->cols;
        classic->table[k] = zero ? 0.0f : (float)(2.0 - 2.0 * cos(angle));
    }
}

double hada_classic_prior_weight(const hada_classic *classic)
{
    return classic->weight * sqrt(classic->job->camera->gain) * classic->job->brightness;
}
