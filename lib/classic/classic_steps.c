#include "classic/classic_steps.h"

#include <math.h>

#include "launch/classic_field.h"
#include "launch/classic_frame.h"
#include "launch/classic_step.h"

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
        HADA_TRY(hada_classic_fused_planes(classic, planes, 1, err));
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
        return hada_classic_fused_frame(classic, 1, forward, step, number, err);
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
        HADA_TRY(hada_classic_fused_planes(classic, to, 0, err));
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
