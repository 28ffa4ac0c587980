#include "classic/classic_steps.h"

#include <math.h>

#include "runtime/kernel.h"

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

/* In calls of the plan's batch. */
static hada_status transform(hada_classic *classic, hada_fft *plan, int forward, int images, hada_classic_part real,
                             size_t distance, hada_classic_part spectrum, hada_error *err)
{
    hada_status status = HADA_OK;
    const cl_mem image = classic->part[real].mem, spectra = classic->part[spectrum].mem;
    for (int done = 0; !status && done < images; done += HADA_CLASSIC_BATCH) {
        const int batch = images - done < HADA_CLASSIC_BATCH ? images - done : HADA_CLASSIC_BATCH;
        const size_t at = (size_t)done * classic->layout.count, real_at = (size_t)done * distance;
        status = forward ? hada_fft_forward(plan, batch, image, real_at, spectra, at, err)
                         : hada_fft_inverse(plan, batch, spectra, at, image, real_at, NULL, err);
    }
    return status;
}

hada_status hada_classic_forward(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    return transform(classic, classic->forward, 1, classic->planes, planes, classic->plane.pixels, HADA_CLASSIC_SPECTRA,
                     err);
}

hada_status hada_classic_inverse(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    return transform(classic, classic->inverse, 0, classic->planes, planes, classic->plane.pixels, HADA_CLASSIC_SPECTRA,
                     err);
}

hada_status hada_classic_frame_forward(hada_classic *classic, hada_classic_part spectrum, hada_error *err)
{
    return transform(classic, classic->frame_forward, 1, classic->shape.place.channels, HADA_CLASSIC_MADE,
                     classic->frame.pixels, spectrum, err);
}

hada_status hada_classic_frame_inverse(hada_classic *classic, hada_error *err)
{
    return transform(classic, classic->frame_inverse, 0, classic->shape.place.channels, HADA_CLASSIC_MADE,
                     classic->frame.pixels, HADA_CLASSIC_SUM, err);
}

static size_t groups(size_t count, size_t each)
{
    return (count + each - 1) / each;
}

/* Over slices of `count` values and `images` images. */
static hada_status launch(hada_classic *classic, const char *file, const char *name, const char *options, size_t slices,
                          int images, const hada_arg *args, size_t arg_count, hada_error *err)
{
    cl_kernel kernel;
    const size_t local[2] = {(size_t)classic->group, 1}, global[2] = {slices * local[0], (size_t)images};
    hada_status status = hada_slot_kernel(classic->slot, file, name, options, &kernel, err);
    return status ? status : hada_slot_launch(classic->slot, kernel, name, 2, global, local, args, arg_count, err);
}

static hada_status over_spectra(hada_classic *classic, const char *name, const hada_arg *args, size_t count,
                                hada_error *err)
{
    return launch(classic, "classic_spectrum", name, classic->spectrum_options,
                  groups(classic->layout.count, HADA_CLASSIC_SLICE), classic->shape.place.channels, args, count, err);
}

static double frequencies(const hada_classic *classic)
{
    return (double)classic->layout.rows * (classic->layout.cols / 2 + 1.0) * classic->shape.place.channels;
}

hada_status hada_classic_project(hada_classic *classic, int rest, hada_error *err)
{
    const hada_refine_data *data = classic->job->data;
    const hada_spectrum_layout *layout = &classic->layout;
    cl_ulong otf_offset = data->otf_offset, data_offset = data->spectrum_offset;
    cl_int depths = classic->job->depths, has_data = rest;
    cl_uint count = (cl_uint)layout->count, slice = HADA_CLASSIC_SLICE, rows = (cl_uint)layout->rows;
    cl_uint block = (cl_uint)layout->block, cols = (cl_uint)layout->cols;
    hada_arg args[] = {HADA_ARG(data->otf),
                       HADA_ARG(otf_offset),
                       HADA_ARG(classic->part[HADA_CLASSIC_LIST].mem),
                       HADA_ARG(depths),
                       HADA_ARG(data->spectrum),
                       HADA_ARG(data_offset),
                       HADA_ARG(has_data),
                       HADA_ARG(classic->part[HADA_CLASSIC_SPECTRA].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_SUM].mem),
                       HADA_ARG(count),
                       HADA_ARG(slice),
                       HADA_ARG(rows),
                       HADA_ARG(block),
                       HADA_ARG(cols),
                       HADA_ARG(classic->part[HADA_CLASSIC_PARTIAL].mem)};
    hada_slot_cost(classic->slot, frequencies(classic) * (16.0 * depths + (rest ? 16.0 : 8.0)),
                   frequencies(classic) * 8.0 * depths);
    return over_spectra(classic, "classic_project", args, HADA_COUNT(args), err);
}

hada_status hada_classic_back(hada_classic *classic, hada_error *err)
{
    const hada_refine_data *data = classic->job->data;
    cl_ulong otf_offset = data->otf_offset;
    cl_int depths = classic->job->depths;
    cl_uint count = (cl_uint)classic->layout.count, slice = HADA_CLASSIC_SLICE;
    hada_arg args[] = {HADA_ARG(data->otf),
                       HADA_ARG(otf_offset),
                       HADA_ARG(classic->part[HADA_CLASSIC_LIST].mem),
                       HADA_ARG(depths),
                       HADA_ARG(classic->part[HADA_CLASSIC_SUM].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_SPECTRA].mem),
                       HADA_ARG(count),
                       HADA_ARG(slice)};
    hada_slot_cost(classic->slot, frequencies(classic) * (16.0 * depths + 8.0), frequencies(classic) * 6.0 * depths);
    return over_spectra(classic, "classic_back", args, HADA_COUNT(args), err);
}

hada_status hada_classic_solve(hada_classic *classic, int first, double m, double mu2, double mu3, hada_error *err)
{
    const hada_refine_data *data = classic->job->data;
    const hada_spectrum_layout *layout = &classic->layout;
    cl_int depths = classic->job->depths, none = first, cropped = classic->bytes[HADA_CLASSIC_SPLIT] != 0;
    cl_mem given = cropped ? classic->part[HADA_CLASSIC_SPLIT].mem : data->spectrum;
    cl_ulong otf_offset = data->otf_offset, data_offset = cropped ? 0 : data->spectrum_offset;
    cl_float weight = (float)m, slopes = (float)mu2, planes = (float)mu3;
    cl_uint count = (cl_uint)layout->count, slice = HADA_CLASSIC_SLICE, rows = (cl_uint)layout->rows;
    cl_uint block = (cl_uint)layout->block;
    hada_arg args[] = {HADA_ARG(data->otf),
                       HADA_ARG(otf_offset),
                       HADA_ARG(classic->part[HADA_CLASSIC_LIST].mem),
                       HADA_ARG(depths),
                       HADA_ARG(given),
                       HADA_ARG(data_offset),
                       HADA_ARG(classic->part[HADA_CLASSIC_SUM].mem),
                       HADA_ARG(cropped),
                       HADA_ARG(classic->part[HADA_CLASSIC_SPECTRA].mem),
                       HADA_ARG(none),
                       HADA_ARG(classic->part[HADA_CLASSIC_TABLE].mem),
                       HADA_ARG(weight),
                       HADA_ARG(slopes),
                       HADA_ARG(planes),
                       HADA_ARG(count),
                       HADA_ARG(slice),
                       HADA_ARG(rows),
                       HADA_ARG(block)};
    hada_slot_cost(classic->slot, frequencies(classic) * ((first ? 16.0 : 24.0) * depths + (cropped ? 24.0 : 8.0)),
                   frequencies(classic) * (30.0 * depths + 20.0));
    return over_spectra(classic, "classic_solve", args, HADA_COUNT(args), err);
}

static size_t frame_slices(const hada_classic *classic)
{
    return groups(classic->frame.pixels, HADA_CLASSIC_SLICE);
}

hada_status hada_classic_meet(hada_classic *classic, hada_classic_meeting mode, double number, hada_error *err)
{
    const int admm = mode == HADA_CLASSIC_ADMM;
    cl_mem state = classic->part[admm ? HADA_CLASSIC_STATE : HADA_CLASSIC_MADE].mem;
    cl_int how = (cl_int)mode;
    cl_float factor = (float)number;
    cl_uint pixels = (cl_uint)classic->frame.pixels, slice = HADA_CLASSIC_SLICE;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_MADE].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_SEEN].mem),
                       HADA_ARG(state),
                       HADA_ARG(how),
                       HADA_ARG(factor),
                       HADA_ARG(pixels),
                       HADA_ARG(slice)};
    const double all = (double)pixels * classic->shape.place.channels;
    hada_slot_cost(classic->slot, (admm ? 20.0 : 12.0) * all, 6.0 * all);
    return launch(classic, "classic_frame", "classic_frame", classic->image_options, frame_slices(classic),
                  classic->shape.place.channels, args, HADA_COUNT(args), err);
}

hada_status hada_classic_predict(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    hada_status status = classic->fuses ? hada_classic_fused_planes(classic, planes, 1, err)
                                        : hada_classic_forward(classic, planes, err);
    if (status)
        return status;
    return classic->fuses ? hada_classic_fused_columns(classic, 0, err) : hada_classic_project(classic, 0, err);
}

hada_status hada_classic_judge(hada_classic *classic, hada_classic_meeting mode, double number, int on, hada_error *err)
{
    if (classic->fuses)
        return hada_classic_fused_frame(classic, 1, on, (int)mode, number, err);
    hada_status status = hada_classic_frame_inverse(classic, err);
    if (!status)
        status = hada_classic_meet(classic, mode, number, err);
    return !status && on ? hada_classic_frame_forward(classic, HADA_CLASSIC_SUM, err) : status;
}

hada_status hada_classic_transpose(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    hada_status status = classic->fuses ? hada_classic_fused_columns(classic, 1, err) : hada_classic_back(classic, err);
    if (status)
        return status;
    return classic->fuses ? hada_classic_fused_planes(classic, planes, 0, err)
                          : hada_classic_inverse(classic, planes, err);
}

hada_status hada_classic_see(hada_classic *classic, hada_error *err)
{
    cl_kernel kernel;
    const hada_refine_data *data = classic->job->data;
    const hada_classic_image *frame = &classic->frame;
    const size_t local[3] = {8, 1, 1};
    const size_t global[3] = {(size_t)frame->pitch, (size_t)frame->rows, (size_t)classic->shape.place.channels};
    cl_ulong offset = data->frame_offset;
    cl_int cols = frame->cols;
    hada_arg args[] = {HADA_ARG(data->frame), HADA_ARG(offset), HADA_ARG(classic->part[HADA_CLASSIC_SEEN].mem),
                       HADA_ARG(cols)};
    hada_status status =
        hada_slot_kernel(classic->slot, "classic_frame", "classic_seen", classic->image_options, &kernel, err);
    hada_slot_cost(classic->slot, 8.0 * (double)frame->pixels * (double)global[2], 0.0);
    return status
               ? status
               : hada_slot_launch(classic->slot, kernel, "classic_seen", 3, global, local, args, HADA_COUNT(args), err);
}

size_t hada_classic_bands(const hada_classic *classic)
{
    return groups((size_t)classic->plane.rows, (size_t)classic->plane.band);
}

size_t hada_classic_slices(const hada_classic *classic)
{
    return groups(classic->plane.pixels, HADA_CLASSIC_SLICE);
}

size_t hada_classic_tasks(const hada_classic *classic)
{
    return groups((size_t)classic->plane.rows, HADA_CLASSIC_ROWS);
}

hada_status hada_classic_rows(hada_classic *classic, const char *file, const char *name, const hada_arg *args,
                              size_t count, hada_error *err)
{
    return launch(classic, file, name, classic->image_options, hada_classic_bands(classic), classic->planes, args,
                  count, err);
}

hada_status hada_classic_pixels(hada_classic *classic, const char *file, const char *name, const hada_arg *args,
                                size_t count, hada_error *err)
{
    return launch(classic, file, name, classic->image_options, hada_classic_slices(classic), classic->planes, args,
                  count, err);
}

/* Each sum over `each` partial ones, in order and in double. */
static hada_status add_up(hada_classic *classic, size_t each, int count, double *sums, hada_error *err)
{
    hada_status status = hada_buffer_read(&classic->part[HADA_CLASSIC_PARTIAL], classic->slot, 0, classic->sums,
                                          each * (size_t)count * sizeof(float), err);
    for (int k = 0; !status && k < count; k++) {
        sums[k] = 0.0;
        for (size_t i = 0; i < each; i++)
            sums[k] += classic->sums[(size_t)k * each + i];
    }
    return status;
}

hada_status hada_classic_sums(hada_classic *classic, size_t each, int count, double *sums, hada_error *err)
{
    return add_up(classic, each * (size_t)classic->planes, count, sums, err);
}

hada_status hada_classic_crop(hada_classic *classic, hada_error *err)
{
    cl_kernel kernel;
    const hada_refine_rect *window = &classic->shape.place.window, *support = &classic->shape.support;
    const int whole = classic->plane.rows != support->rows || classic->plane.cols != support->cols;
    cl_int pitch = classic->plane.pitch, row0 = window->row0 - (whole ? 0 : support->row0),
           col0 = window->col0 - (whole ? 0 : support->col0), rows = window->rows, cols = window->cols;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_X].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_WINDOW].mem),
                       HADA_ARG(pitch),
                       HADA_ARG(row0),
                       HADA_ARG(col0),
                       HADA_ARG(rows),
                       HADA_ARG(cols)};
    const size_t local[3] = {8, 1, 1};
    const size_t global[3] = {(size_t)pitch, (size_t)classic->plane.rows, (size_t)classic->planes};
    hada_status status =
        hada_slot_kernel(classic->slot, "classic_frame", "classic_crop", classic->image_options, &kernel, err);
    hada_slot_cost(classic->slot, 12.0 * (double)classic->plane.pixels * classic->planes, 0.0);
    return status
               ? status
               : hada_slot_launch(classic->slot, kernel, "classic_crop", 3, global, local, args, HADA_COUNT(args), err);
}

hada_status hada_classic_energy(hada_classic *classic, double *energy, hada_error *err)
{
    const size_t channels = (size_t)classic->shape.place.channels;
    hada_status status;
    if (!classic->met) { /* Parseval */
        status = hada_classic_forward(classic, HADA_CLASSIC_X, err);
        if (!status)
            status = hada_classic_project(classic, 1, err);
        if (!status)
            status = add_up(classic, channels * groups(classic->layout.count, HADA_CLASSIC_SLICE), 1, energy, err);
        *energy /= (double)classic->layout.rows * classic->layout.cols;
        return status;
    }
    cl_uint pixels = (cl_uint)classic->frame.pixels, slice = HADA_CLASSIC_SLICE;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_MADE].mem), HADA_ARG(pixels), HADA_ARG(slice),
                       HADA_ARG(classic->part[HADA_CLASSIC_PARTIAL].mem)};
    status = hada_classic_predict(classic, HADA_CLASSIC_X, err);
    if (!status)
        status = hada_classic_judge(classic, HADA_CLASSIC_REST, 0.0, 0, err);
    if (!status)
        status = launch(classic, "classic_frame", "classic_energy", classic->image_options, frame_slices(classic),
                        (int)channels, args, HADA_COUNT(args), err);
    return status ? status : add_up(classic, channels * frame_slices(classic), 1, energy, err);
}

void hada_classic_wave(hada_classic *classic, int zero)
{
    const hada_spectrum_layout *layout = &classic->layout;
    const double turn = 2.0 * acos(-1.0);
    const int columns = layout->blocks * layout->block;
    for (int k = 0; k < layout->rows + columns; k++) {
        const double angle = k < layout->rows ? turn * k / layout->rows : turn * (k - layout->rows) / layout->cols;
        classic->table[k] = zero ? 0.0f : (float)(2.0 - 2.0 * cos(angle));
    }
}
