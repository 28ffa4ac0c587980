/* The library's own transforms: a pass along rows and a pass along columns, by kernels that serve every size. Batches
 * of small images go through both passes in one launch (fft_image.c).
 *
 * Forward: rows of the rectangle to half spectra in place in the caller's buffer, then its columns in place. Inverse:
 * columns to scratch, only the wanted rows of them and only within the band, times a filter where one is given; then
 * these rows to the image. */
#include <stdlib.h>

#include "core/alloc.h"
#include "fft/fft_cost.h"
#include "fft/fft_image.h"
#include "fft/fft_internal.h"
#include "fft/fft_own.h"

/* Bytes between the two passes at a time. Lanes: what the caches of a few cores keep, larger measured slower. Groups:
 * work enough for a GPU. */
#define BETWEEN_BYTES_LANES  ((size_t)2 << 20)
#define BETWEEN_BYTES_GROUPS ((size_t)64 << 20)

typedef struct own_state {
    hada_own_pass rows, columns;
    hada_buffer between; /* inverse: rows of half spectra */
    int images;          /* that both passes take at a time */
    hada_own_image image;
} own_state;

static size_t between_count(const hada_fft_desc *desc)
{
    return (size_t)(desc->band_cols / HADA_OWN_BLOCK + 1) * (size_t)desc->real_rows * HADA_OWN_BLOCK;
}

static int images_at_once(const hada_context *context, const hada_fft_desc *desc)
{
    const size_t most = context->shape == HADA_SHAPE_GROUPS ? BETWEEN_BYTES_GROUPS : BETWEEN_BYTES_LANES;
    size_t images = most / (between_count(desc) * 2 * sizeof(float));
    if (images < 1)
        images = 1;
    return images < (size_t)desc->batch ? (int)images : desc->batch;
}

static size_t image_bytes(const hada_context *context, const hada_fft_desc *desc)
{
    const size_t blocks = (size_t)(desc->cols / 2 / HADA_OWN_BLOCK + 1), whole = blocks * (size_t)desc->rows;
    return hada_own_image_bytes(context, desc,
                                desc->direction == HADA_FFT_INVERSE ? between_count(desc) : whole * HADA_OWN_BLOCK);
}

static size_t own_scratch(const hada_context *context, const hada_fft_desc *desc)
{
    const int between = desc->direction == HADA_FFT_INVERSE && !image_bytes(context, desc);
    return between ? between_count(desc) * (size_t)images_at_once(context, desc) * 2 * sizeof(float) : 0;
}

static size_t own_bytes(const hada_context *context, const hada_fft_desc *desc)
{
    const size_t bytes = hada_own_pass_bytes(context, desc->cols, 0) + hada_own_pass_bytes(context, desc->rows, 1);
    return bytes + own_scratch(context, desc);
}

static int own_block(const hada_context *context, int rows, int cols)
{
    (void)context;
    (void)rows;
    (void)cols;
    return HADA_OWN_BLOCK;
}

static void own_destroy(hada_fft *plan)
{
    own_state *state = plan->state;
    if (!state)
        return;
    hada_slot_finish(plan->slot, NULL);
    hada_own_pass_free(&state->rows);
    hada_own_pass_free(&state->columns);
    hada_buffer_destroy(&state->between);
    free(state);
    plan->state = NULL;
}

static hada_status own_create(hada_fft *plan, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    const int inverse = desc->direction == HADA_FFT_INVERSE;
    hada_status status = hada_alloc(&plan->state, 1, sizeof(own_state), "a transform's plan", err);
    if (status)
        return status;
    own_state *state = plan->state;

    hada_fft_pass_desc rows = {
        .kind = inverse ? HADA_PASS_ROWS_INVERSE : HADA_PASS_ROWS, .n = desc->cols, .inverse = inverse};
    const hada_fft_pass_desc columns = {.kind = HADA_PASS_COLUMNS, .n = desc->rows, .inverse = inverse};
    status = hada_own_pass_make(&state->rows, plan->slot, &rows, err);
    if (!status)
        status = hada_own_pass_make(&state->columns, plan->slot, &columns, err);
    state->images = images_at_once(plan->slot->context, desc);
    state->image = (hada_own_image){&state->rows, &state->columns, image_bytes(plan->slot->context, desc)};
    if (!status && inverse && !state->image.local_bytes) {
        status = hada_scratch_create(&state->between, plan->slot,
                                     between_count(desc) * (size_t)state->images * 2 * sizeof(float),
                                     "a transform's scratch", err);
    }
    return status;
}

/* A task of a row pass takes `width` pairs of rows. */
static int row_tasks(const own_state *state, const hada_fft_desc *desc)
{
    const int pairs = state->rows.width;
    return (desc->real_rows + 2 * pairs - 1) / (2 * pairs);
}

typedef struct columns_io {
    cl_mem in, out, filter;
    size_t in_offset, out_offset, filter_offset;
    size_t in_distance, out_distance, filter_distance;
    int first_row, rows_in, last_row; /* the rows that are read: see kernels/inc_fft_cols.h */
    int in_count, first, row0, rows_out, blocks, images;
    const char *options;
} columns_io;

static hada_status run_columns(hada_fft *plan, const columns_io *io, hada_error *err)
{
    own_state *state = plan->state;
    const cl_ulong in_offset = io->in_offset, in_distance = io->in_distance, filter_offset = io->filter_offset,
                   filter_distance = io->filter_distance, out_offset = io->out_offset, out_distance = io->out_distance;
    const cl_int in_count = io->in_count, first = io->first, first_row = io->first_row, rows_in = io->rows_in,
                 last_row = io->last_row, row0 = io->row0, rows_out = io->rows_out, images = io->images,
                 tasks = io->blocks * io->images * (HADA_OWN_BLOCK / state->columns.width);
    hada_arg args[] = {HADA_ARG(io->in),
                       HADA_ARG(in_offset),
                       HADA_ARG(in_distance),
                       HADA_ARG(in_count),
                       HADA_ARG(first),
                       HADA_ARG(io->filter),
                       HADA_ARG(filter_offset),
                       HADA_ARG(filter_distance),
                       HADA_ARG(first_row),
                       HADA_ARG(rows_in),
                       HADA_ARG(last_row),
                       HADA_ARG(io->out),
                       HADA_ARG(out_offset),
                       HADA_ARG(out_distance),
                       HADA_ARG(row0),
                       HADA_ARG(rows_out),
                       HADA_ARG(images),
                       HADA_ARG(tasks),
                       HADA_ARG(state->columns.ints.mem),
                       HADA_ARG(state->columns.floats.mem),
                       HADA_OWN_LAST_ARGS};
    return hada_own_pass_launch(&state->columns, plan->slot, "cols", io->options, tasks, args, HADA_COUNT(args), err);
}

/* The images first..first+images-1 of a batch. */
static hada_status forward_part(hada_fft *plan, int first, int images, cl_mem real, size_t real_offset, cl_mem spectrum,
                                size_t spectrum_offset, hada_error *err)
{
    own_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    const size_t at = spectrum_offset + (size_t)first * plan->layout.count;
    const cl_ulong in_offset = real_offset + (size_t)first * desc->real_distance, in_distance = desc->real_distance,
                   in_pitch = desc->real_pitch, out_offset = at, out_distance = plan->layout.count;
    const cl_int col0 = desc->col0, cols_in = desc->real_cols, rows_in = desc->real_rows, row0 = desc->row0,
                 rows = desc->rows, blocks = desc->band_cols / HADA_OWN_BLOCK + 1,
                 tasks = row_tasks(state, desc) * images;
    hada_arg args[] = {HADA_ARG(real),
                       HADA_ARG(in_offset),
                       HADA_ARG(in_distance),
                       HADA_ARG(in_pitch),
                       HADA_ARG(col0),
                       HADA_ARG(cols_in),
                       HADA_ARG(rows_in),
                       HADA_ARG(spectrum),
                       HADA_ARG(out_offset),
                       HADA_ARG(out_distance),
                       HADA_ARG(row0),
                       HADA_ARG(rows),
                       HADA_ARG(blocks),
                       HADA_ARG(tasks),
                       HADA_ARG(state->rows.ints.mem),
                       HADA_ARG(state->rows.floats.mem),
                       HADA_OWN_LAST_ARGS};
    hada_fft_cost_rows(plan->slot, desc, images, NULL);
    hada_status status =
        hada_own_pass_launch(&state->rows, plan->slot, "rows_forward", "", tasks, args, HADA_COUNT(args), err);
    if (status)
        return status;
    const columns_io io = {.in = spectrum,
                           .out = spectrum,
                           .in_offset = at,
                           .out_offset = at,
                           .in_distance = plan->layout.count,
                           .out_distance = plan->layout.count,
                           .first_row = desc->row0,
                           .rows_in = desc->real_rows,
                           .last_row = desc->rows,
                           .in_count = images,
                           .rows_out = desc->rows,
                           .blocks = blocks,
                           .images = images,
                           .options = ""};
    hada_fft_cost_columns(plan->slot, desc, images, NULL);
    return run_columns(plan, &io, err);
}

static hada_status own_forward(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                               size_t spectrum_offset, hada_error *err)
{
    const own_state *state = plan->state;
    if (state->image.local_bytes) {
        const hada_own_io io = {.in = real,
                                .out = spectrum,
                                .in_offset = real_offset,
                                .out_offset = spectrum_offset,
                                .spectrum_distance = plan->layout.count,
                                .images = batch};
        hada_fft_cost_image(plan->slot, &plan->desc, batch, NULL);
        return hada_own_image_forward(&state->image, plan->slot, &plan->desc, &io, err);
    }
    hada_status status = HADA_OK;
    for (int first = 0; first < batch && !status; first += state->images) {
        const int left = batch - first, images = left < state->images ? left : state->images;
        status = forward_part(plan, first, images, real, real_offset, spectrum, spectrum_offset, err);
    }
    return status;
}

static const char *product_options(const hada_fft_filter *filter)
{
    if (!filter)
        return "";
    if (filter->product == HADA_FFT_COMPLEX)
        return filter->half ? "-DFFT_PRODUCT=1 -DFFT_HALF=1" : "-DFFT_PRODUCT=1";
    return filter->half ? "-DFFT_PRODUCT=2 -DFFT_HALF=1" : "-DFFT_PRODUCT=2";
}

/* The images first..first+images-1 of a batch. */
static hada_status inverse_part(hada_fft *plan, int first, int images, cl_mem spectrum, size_t spectrum_offset,
                                cl_mem real, size_t real_offset, const hada_fft_filter *filter, hada_error *err)
{
    own_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    const hada_fft_filter use = hada_fft_resolve(plan, filter);
    const size_t distance = between_count(desc), out_step = desc->real_distance * (size_t)use.stride;
    columns_io io = {.in = spectrum,
                     .out = state->between.mem,
                     .in_offset = spectrum_offset,
                     .in_distance = plan->layout.count,
                     .out_distance = distance,
                     .filter_distance = plan->layout.count * (size_t)use.stride,
                     .rows_in = use.band_rows + 1,
                     .last_row = desc->rows - use.band_rows,
                     .in_count = filter ? filter->spectrum_count : desc->batch,
                     .first = first,
                     .row0 = desc->row0,
                     .rows_out = desc->real_rows,
                     .blocks = use.band_cols / HADA_OWN_BLOCK + 1,
                     .images = images,
                     .options = product_options(filter)};
    if (filter) {
        io.filter = filter->filter;
        io.filter_offset = (size_t)(filter->filter_first + first * use.stride) * plan->layout.count;
    }
    hada_fft_cost_columns(plan->slot, desc, images, &use);
    hada_status status = run_columns(plan, &io, err);
    if (status)
        return status;

    const cl_ulong in_offset = 0, in_distance = distance, out_offset = real_offset + (size_t)first * out_step,
                   out_distance = out_step, out_pitch = desc->real_pitch;
    const cl_int rows_in = desc->real_rows, band = use.band_cols, col0 = desc->col0, cols_out = desc->real_cols,
                 tasks = row_tasks(state, desc) * images;
    const cl_float scale = hada_own_scale(desc);
    hada_arg args[] = {HADA_ARG(state->between.mem),
                       HADA_ARG(in_offset),
                       HADA_ARG(in_distance),
                       HADA_ARG(rows_in),
                       HADA_ARG(band),
                       HADA_ARG(real),
                       HADA_ARG(out_offset),
                       HADA_ARG(out_distance),
                       HADA_ARG(out_pitch),
                       HADA_ARG(col0),
                       HADA_ARG(cols_out),
                       HADA_ARG(scale),
                       HADA_ARG(tasks),
                       HADA_ARG(state->rows.ints.mem),
                       HADA_ARG(state->rows.floats.mem),
                       HADA_OWN_LAST_ARGS};
    hada_fft_cost_rows(plan->slot, desc, images, &use);
    return hada_own_pass_launch(&state->rows, plan->slot, "rows_inverse", "", tasks, args, HADA_COUNT(args), err);
}

static hada_status own_inverse(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                               size_t real_offset, const hada_fft_filter *filter, hada_error *err)
{
    const own_state *state = plan->state;
    const hada_fft_filter use = hada_fft_resolve(plan, filter);
    if (state->image.local_bytes) {
        const hada_own_io io = {.in = spectrum,
                                .out = real,
                                .filter = filter ? filter->filter : NULL,
                                .in_offset = spectrum_offset,
                                .out_offset = real_offset,
                                .filter_offset = filter ? (size_t)filter->filter_first * plan->layout.count : 0,
                                .spectrum_distance = plan->layout.count,
                                .in_count = filter ? filter->spectrum_count : plan->desc.batch,
                                .images = batch,
                                .stride = use.stride,
                                .band_rows = use.band_rows,
                                .band_cols = use.band_cols,
                                .options = product_options(filter)};
        hada_fft_cost_image(plan->slot, &plan->desc, batch, &use);
        return hada_own_image_inverse(&state->image, plan->slot, &plan->desc, &io, err);
    }
    hada_status status = HADA_OK;
    for (int first = 0; first < batch && !status; first += state->images) {
        const int left = batch - first, images = left < state->images ? left : state->images;
        status = inverse_part(plan, first, images, spectrum, spectrum_offset, real, real_offset, filter, err);
    }
    return status;
}

const hada_fft_engine hada_fft_own_engine = {
    own_create, own_destroy, own_forward, own_inverse, own_bytes, own_block, own_scratch,
};
