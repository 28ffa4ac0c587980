#include "fit/fit_grid.h"

#include <hadalens/response.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/callers.h"
#include "filter/bank.h"

/* Work-items of a group: of kernels by groups of eight frequencies, and of those by chunks where the device works in
 * groups (docs/reference/devices.md). */
enum { GROUP = 64 };

/* Kernels write whole vectors of complex numbers, so up to that many bytes beyond the last frequency. */
enum { VECTOR_BYTES = HADA_FIT_VECTOR * 2 * sizeof(float) };

static hada_status copy_distances(hada_fit_grid *grid, const double *distances_mm, hada_error *err)
{
    const size_t depths = (size_t)grid->info.depths;
    hada_status status = hada_allocated(grid->distances = hada_alloc(depths, sizeof(double), "the distances", err));
    if (status)
        return status;
    memcpy(grid->distances, distances_mm, depths * sizeof(double));
    grid->info.distances_mm = grid->distances;
    return HADA_OK;
}

hada_status hada_fit_info(hada_model_info *info, const hada_fit_options *options, hada_error *err)
{
    *info = (hada_model_info){.depths = options->depths,
                              .channels = options->channels,
                              .form = options->form,
                              .boundary = options->boundary,
                              .dark = options->dark,
                              .distances_mm = options->distances_mm,
                              .scene_response = options->scene_response == HADA_AUTO ? HADA_RESPONSE_LINEAR
                                                                                     : options->scene_response};
    HADA_TRY(hada_model_set_sizes(info, options->raw_rows, options->raw_cols, options->window_rows,
                                  options->window_cols, err));
    if (options->boundary == HADA_BOUNDARY_PADDED && options->grid_rows && options->grid_cols) {
        info->grid_rows = options->grid_rows;
        info->grid_cols = options->grid_cols;
    }
    return hada_model_info_check(info, err);
}

hada_status hada_fit_grid_create(hada_fit_grid *grid, hada_context *context, const hada_fit_options *options,
                                 hada_error *err)
{
    hada_model_info *info = &grid->info;
    hada_status status = HADA_OK;
    *grid = (hada_fit_grid){0};
    hada_communicator_init(&grid->communicator);
    HADA_TRY_OR_DONE(hada_communicator_check(options->communicator, err));
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&grid->communicator, options->communicator, hada_communicator, err));
    HADA_TRY_OR_DONE(hada_fit_info(info, options, err));
    info->has_otf = 1;
    HADA_TRY_OR_DONE(hada_geometry_of(info, &grid->geometry, err));
    HADA_TRY_OR_DONE(copy_distances(grid, options->distances_mm, err));
    HADA_TRY_OR_DONE(hada_slot_create(&grid->slot, context, err));
    grid->layout = hada_fft_layout(context, info->grid_rows, info->grid_cols, HADA_FFT_AUTO);
    grid->vectors = hada_divide_up(grid->layout.count, HADA_FIT_VECTOR);
    grid->stride = hada_round_up(grid->vectors, GROUP) * HADA_FIT_VECTOR;
    grid->chunks = hada_divide_up(grid->vectors, HADA_FIT_CHUNK);
    grid->sum_count = hada_fit_is_split(grid) ? HADA_FIT_SUMS_SPLIT : HADA_FIT_SUMS;
done:
    if (status)
        hada_fit_grid_destroy(grid);
    return status;
}

void hada_fit_grid_destroy(hada_fit_grid *grid)
{
    hada_slot_destroy(&grid->slot);
    free(grid->distances);
    *grid = (hada_fit_grid){0};
}

size_t hada_fit_raw_floats(const hada_fit_grid *grid)
{
    const hada_model_info *info = &grid->info;
    return (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
}

size_t hada_fit_window_floats(const hada_fit_grid *grid)
{
    const hada_model_info *info = &grid->info;
    return (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols;
}

size_t hada_fit_spectra_bytes(const hada_fit_grid *grid, size_t images)
{
    return images * grid->layout.count * 2 * sizeof(float) + VECTOR_BYTES;
}

hada_fft_desc hada_fit_transform_desc(const hada_fit_grid *grid, hada_fft_direction direction, int window)
{
    const hada_model_info *info = &grid->info;
    const hada_geometry *at = &grid->geometry;
    const int rows = window ? info->window_rows : info->raw_rows, cols = window ? info->window_cols : info->raw_cols;
    return (hada_fft_desc){.direction = direction,
                           .rows = info->grid_rows,
                           .cols = info->grid_cols,
                           .batch = info->channels,
                           .row0 = window ? at->window_row : at->raw_row,
                           .col0 = window ? at->window_col : at->raw_col,
                           .real_rows = rows,
                           .real_cols = cols,
                           .real_pitch = (size_t)cols,
                           .real_distance = (size_t)rows * (size_t)cols};
}

hada_fft_filter hada_fit_product(const hada_fit_grid *grid, cl_mem filters, int first)
{
    return (hada_fft_filter){.product = hada_fit_is_split(grid) ? HADA_FFT_SPLIT : HADA_FFT_COMPLEX,
                             .filter = filters,
                             .spectrum_count = grid->info.channels,
                             .filter_first = first};
}

hada_status hada_fit_read_plane(const hada_fit_grid *grid, const hada_buffer *from, size_t at, float *blocks, float *to,
                                const char *what, hada_error *err)
{
    const size_t plane = hada_model_info_plane(&grid->info), bytes = grid->layout.count * 2 * sizeof(float);
    hada_status status = hada_buffer_read(from, grid->slot, at * 2 * sizeof(float), blocks, bytes, err);
    if (status)
        return status;
    hada_layout_unpack(&grid->layout, blocks, to);
    float sum = 0.0f; /* x - x is 0 for finite x alone */
    for (size_t i = 0; i < 2 * plane; i++)
        sum += to[i] - to[i];
    return sum == 0.0f ? HADA_OK
                       : hada_fail(err, HADA_ERROR_NUMERIC,
                                   "%s came out not finite; the raw frames are nearly dark at some frequencies: give a "
                                   "lambda above 0",
                                   what);
}

hada_fit_image hada_fit_image_of(const hada_fit_grid *grid, size_t n)
{
    return (hada_fit_image){.first = n * grid->layout.count,
                            .count = grid->layout.count,
                            .vectors = grid->vectors,
                            .stride = grid->stride,
                            .chunks = grid->chunks,
                            .partial = n * grid->chunks};
}

hada_range hada_fit_vectors(const hada_fit_grid *grid)
{
    return hada_range_of(grid->vectors, GROUP, 1, 1);
}

hada_range hada_fit_chunks(const hada_fit_grid *grid)
{
    if (grid->slot->context->shape == HADA_SHAPE_LANES)
        return hada_range_of(grid->chunks, 1, 1, 1);
    return hada_range_of(grid->chunks * HADA_FIT_CHUNK, HADA_FIT_GROUP, 1, 1);
}
