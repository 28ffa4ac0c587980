/* The library's own transforms: a pass along rows and a pass along columns, by kernels that serve every size.
 *
 * Forward: rows of the rectangle to half spectra in place in the caller's buffer, then its columns in place. Inverse:
 * columns to scratch, only the wanted rows of them and only within the band, times a filter where one is given; then
 * these rows to the image. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "fft/fft_internal.h"
#include "fft/fft_own.h"
#include "fft/fft_pass.h"
#include "program/kernel.h"

#define ROWS_AT_ONCE 16 /* of the lanes' row kernels: eight pairs */

/* Bytes between the two passes at a time: what the caches of a few cores keep. Larger measured slower. */
#define BETWEEN_BYTES ((size_t)4 << 20)

typedef struct own_pass {
    hada_buffer ints, floats, scratch;
    int points;
    size_t local_bytes; /* of local memory, 0 where scratch lies in global memory */
    size_t groups;      /* at most in flight, where scratch lies in global memory */
} own_pass;

typedef struct own_state {
    own_pass rows, columns;
    hada_buffer between; /* inverse: rows of half spectra */
    int images;          /* that both passes take at a time */
} own_state;

static size_t scratch_bytes(int points)
{
    return (size_t)points * 16 * sizeof(float);
}

/* Local memory is used up to a half MiB: PoCL reports more and aborts. */
static int fits_local(const hada_context *context, int points)
{
    const uint64_t most = (uint64_t)384 << 10;
    uint64_t limit = context->info.local_memory_bytes;
    return scratch_bytes(points) <= (limit < most ? limit : most);
}

static size_t global_groups(const hada_context *context)
{
    return context->info.compute_units ? 4 * (size_t)context->info.compute_units : 4;
}

static size_t between_count(const hada_fft_desc *desc)
{
    return (size_t)(desc->band_cols / HADA_OWN_BLOCK + 1) * (size_t)desc->real_rows * HADA_OWN_BLOCK;
}

static int images_at_once(const hada_fft_desc *desc)
{
    size_t images = BETWEEN_BYTES / (between_count(desc) * 2 * sizeof(float));
    if (images < 1)
        images = 1;
    return images < (size_t)desc->batch ? (int)images : desc->batch;
}

static hada_status make_pass(own_pass *pass, hada_slot *slot, const hada_fft_pass_desc *desc, hada_error *err)
{
    hada_fft_pass table;
    hada_status status = hada_fft_pass_make(&table, desc, err);
    if (status)
        return status;
    pass->points = table.points;
    status = hada_buffer_create_from(&pass->ints, slot, table.ints, table.int_count * sizeof *table.ints,
                                     "a transform's tables", err);
    if (!status)
        status = hada_buffer_create_from(&pass->floats, slot, table.floats, table.float_count * sizeof *table.floats,
                                         "a transform's tables", err);
    if (fits_local(slot->context, table.points)) {
        pass->local_bytes = scratch_bytes(table.points);
    } else {
        pass->groups = global_groups(slot->context);
        if (!status)
            status = hada_buffer_create(&pass->scratch, slot->context, pass->groups * scratch_bytes(table.points),
                                        "a transform's scratch", err);
    }
    hada_fft_pass_free(&table);
    return status;
}

static size_t pass_bytes(const hada_context *context, int n, hada_fft_pass_kind kind)
{
    int points;
    size_t ints, floats;
    hada_fft_pass_sizes(n, kind, &points, &ints, &floats);
    size_t bytes = ints * sizeof(int32_t) + floats * sizeof(float);
    return bytes + (fits_local(context, points) ? 0 : global_groups(context) * scratch_bytes(points));
}

static size_t own_bytes(const hada_context *context, const hada_fft_desc *desc)
{
    size_t bytes = pass_bytes(context, desc->cols, HADA_PASS_ROWS) + pass_bytes(context, desc->rows, HADA_PASS_COLUMNS);
    if (desc->direction == HADA_FFT_INVERSE)
        bytes += between_count(desc) * (size_t)images_at_once(desc) * 2 * sizeof(float);
    return bytes;
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
    own_pass *passes[] = {&state->rows, &state->columns};
    for (int i = 0; i < 2; i++) {
        hada_buffer_destroy(&passes[i]->ints);
        hada_buffer_destroy(&passes[i]->floats);
        hada_buffer_destroy(&passes[i]->scratch);
    }
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
    hada_fft_pass_desc columns = {.kind = HADA_PASS_COLUMNS, .n = desc->rows, .inverse = inverse};
    columns.first = inverse ? 0 : desc->row0;
    columns.count = inverse ? desc->band_rows + 1 : desc->real_rows;
    columns.last = inverse ? desc->rows - desc->band_rows : desc->rows;
    status = make_pass(&state->rows, plan->slot, &rows, err);
    if (!status)
        status = make_pass(&state->columns, plan->slot, &columns, err);
    state->images = images_at_once(desc);
    if (!status && inverse) {
        status = hada_buffer_create(&state->between, plan->slot->context,
                                    between_count(desc) * (size_t)state->images * 2 * sizeof(float),
                                    "a transform's scratch", err);
    }
    return status;
}

/* Enqueues `tasks` work-items of a pass: one work-group each, or, where scratch lies in global memory, as many groups
 * as there is scratch for. The last argument, scratch, is set here. */
static hada_status launch(hada_fft *plan, own_pass *pass, const char *file, const char *options, int tasks,
                          hada_arg *args, size_t count, hada_error *err)
{
    char all[128];
    const size_t local = 1;
    size_t global = (size_t)tasks;
    cl_kernel kernel;
    snprintf(all, sizeof all, "%s%s%s", options, *options && !pass->local_bytes ? " " : "",
             pass->local_bytes ? "" : "-DFFT_SCRATCH_GLOBAL=1");
    hada_status status = hada_slot_kernel(plan->slot, file, file, all, &kernel, err);
    if (status)
        return status;
    if (pass->local_bytes) {
        args[count - 1] = (hada_arg)HADA_ARG_LOCAL(pass->local_bytes);
    } else {
        args[count - 1] = (hada_arg)HADA_ARG(pass->scratch.mem);
        global = global < pass->groups ? global : pass->groups;
    }
    return hada_slot_launch(plan->slot, kernel, file, 1, &global, &local, args, count, err);
}

typedef struct columns_io {
    cl_mem in, out, filter;
    size_t in_offset, out_offset, filter_offset;
    size_t in_distance, out_distance;
    int in_count, first, row0, rows_out, blocks, images;
    const char *options;
} columns_io;

static hada_status run_columns(hada_fft *plan, const columns_io *io, hada_error *err)
{
    own_state *state = plan->state;
    const cl_ulong in_offset = io->in_offset, in_distance = io->in_distance, filter_offset = io->filter_offset,
                   filter_distance = plan->layout.count, out_offset = io->out_offset, out_distance = io->out_distance;
    const cl_int in_count = io->in_count, first = io->first, row0 = io->row0, rows_out = io->rows_out,
                 images = io->images, tasks = io->blocks * io->images;
    hada_arg args[] = {HADA_ARG(io->in),
                       HADA_ARG(in_offset),
                       HADA_ARG(in_distance),
                       HADA_ARG(in_count),
                       HADA_ARG(first),
                       HADA_ARG(io->filter),
                       HADA_ARG(filter_offset),
                       HADA_ARG(filter_distance),
                       HADA_ARG(io->out),
                       HADA_ARG(out_offset),
                       HADA_ARG(out_distance),
                       HADA_ARG(row0),
                       HADA_ARG(rows_out),
                       HADA_ARG(images),
                       HADA_ARG(tasks),
                       HADA_ARG(state->columns.ints.mem),
                       HADA_ARG(state->columns.floats.mem),
                       HADA_ARG_LOCAL(0)};
    return launch(plan, &state->columns, "fft_cols", io->options, tasks, args, HADA_COUNT(args), err);
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
                 rows = desc->rows, tasks = (desc->real_rows + ROWS_AT_ONCE - 1) / ROWS_AT_ONCE * images;
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
                       HADA_ARG(tasks),
                       HADA_ARG(state->rows.ints.mem),
                       HADA_ARG(state->rows.floats.mem),
                       HADA_ARG_LOCAL(0)};
    hada_status status = launch(plan, &state->rows, "fft_rows_forward", "", tasks, args, HADA_COUNT(args), err);
    if (status)
        return status;
    const columns_io io = {.in = spectrum,
                           .out = spectrum,
                           .in_offset = at,
                           .out_offset = at,
                           .in_distance = plan->layout.count,
                           .out_distance = plan->layout.count,
                           .in_count = images,
                           .rows_out = desc->rows,
                           .blocks = plan->layout.blocks,
                           .images = images,
                           .options = ""};
    return run_columns(plan, &io, err);
}

static hada_status own_forward(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                               size_t spectrum_offset, hada_error *err)
{
    const own_state *state = plan->state;
    hada_status status = HADA_OK;
    for (int first = 0; first < batch && !status; first += state->images) {
        const int left = batch - first, images = left < state->images ? left : state->images;
        status = forward_part(plan, first, images, real, real_offset, spectrum, spectrum_offset, err);
    }
    return status;
}

/* The images first..first+images-1 of a batch. */
static hada_status inverse_part(hada_fft *plan, int first, int images, cl_mem spectrum, size_t spectrum_offset,
                                cl_mem real, size_t real_offset, const hada_fft_filter *filter, hada_error *err)
{
    own_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    const size_t distance = between_count(desc);
    columns_io io = {.in = spectrum,
                     .out = state->between.mem,
                     .in_offset = spectrum_offset,
                     .in_distance = plan->layout.count,
                     .out_distance = distance,
                     .in_count = filter ? filter->spectrum_count : desc->batch,
                     .first = first,
                     .row0 = desc->row0,
                     .rows_out = desc->real_rows,
                     .blocks = desc->band_cols / HADA_OWN_BLOCK + 1,
                     .images = images,
                     .options = ""};
    if (filter) {
        io.filter = filter->filter;
        io.filter_offset = (size_t)(filter->filter_first + first) * plan->layout.count;
        if (filter->product == HADA_FFT_COMPLEX)
            io.options = filter->half ? "-DFFT_PRODUCT=1 -DFFT_HALF=1" : "-DFFT_PRODUCT=1";
        else
            io.options = filter->half ? "-DFFT_PRODUCT=2 -DFFT_HALF=1" : "-DFFT_PRODUCT=2";
    }
    hada_status status = run_columns(plan, &io, err);
    if (status)
        return status;

    const cl_ulong in_offset = 0, in_distance = distance,
                   out_offset = real_offset + (size_t)first * desc->real_distance, out_distance = desc->real_distance,
                   out_pitch = desc->real_pitch;
    const cl_int rows_in = desc->real_rows, band = desc->band_cols, col0 = desc->col0, cols_out = desc->real_cols,
                 tasks = (desc->real_rows + ROWS_AT_ONCE - 1) / ROWS_AT_ONCE * images;
    const cl_float scale = (cl_float)(1.0 / ((double)desc->rows * (double)desc->cols));
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
                       HADA_ARG_LOCAL(0)};
    return launch(plan, &state->rows, "fft_rows_inverse", "", tasks, args, HADA_COUNT(args), err);
}

static hada_status own_inverse(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                               size_t real_offset, const hada_fft_filter *filter, hada_error *err)
{
    const own_state *state = plan->state;
    hada_status status = HADA_OK;
    for (int first = 0; first < batch && !status; first += state->images) {
        const int left = batch - first, images = left < state->images ? left : state->images;
        status = inverse_part(plan, first, images, spectrum, spectrum_offset, real, real_offset, filter, err);
    }
    return status;
}

const hada_fft_engine hada_fft_own_engine = {
    own_create, own_destroy, own_forward, own_inverse, own_bytes, own_block,
};
