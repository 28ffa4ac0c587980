/* The library's own transforms: a pass along rows and a pass along columns, by kernels that serve every size. Batches
 * of small images go through both passes in one launch.
 *
 * Forward: rows of the rectangle to half spectra in place in the caller's buffer, then its columns in place. Inverse:
 * columns to scratch, only the wanted rows of them and only within the band, times a filter where one is given; then
 * these rows to the image. */
#include "fft/fft_own.h"

#include "fft/fft_internal.h"
#include "launch/fft_group_cols.h"
#include "launch/fft_group_rows.h"
#include "launch/fft_image_forward.h"
#include "launch/fft_image_inverse.h"
#include "launch/fft_rows_cols.h"
#include "launch/fft_sized_cols.h"
#include "launch/fft_sized_rows.h"

/* The library's own transforms, an image at a time: one launch takes a batch of small images through both passes, each
 * image in one work-item that keeps what lies between the passes in local memory. On CPUs that is the nearest caches,
 * and nothing is handed over from launch to launch. */
typedef struct own_image {
    const hada_own_pass *rows, *columns;
    size_t local_bytes;
} own_image;

/* Shared out by whole images, units may idle in the last round: for a quarter of the time at most, which is what this
 * way gains. */
static int enough_images(const hada_context *context, int batch)
{
    const uint64_t units = context->info.compute_units ? context->info.compute_units : 1, images = (uint64_t)batch;
    const uint64_t rounds = (images + units - 1) / units;
    return 3 * rounds * units <= 4 * images;
}

static size_t image_local_bytes(const hada_context *context, const hada_fft_desc *desc, size_t between)
{
    const size_t rows = hada_own_pass_local(context, desc->cols, 0),
                 columns = hada_own_pass_local(context, desc->rows, 1);
    const uint64_t bytes = (rows > columns ? rows : columns) + (uint64_t)between * 2 * sizeof(float);
    if (context->shape == HADA_SHAPE_GROUPS || !rows || !columns || !enough_images(context, desc->batch))
        return 0;
    return bytes <= HADA_OWN_LOCAL_BYTES && bytes <= context->info.local_memory_bytes ? (size_t)bytes : 0;
}

static hada_status run_image_forward(const own_image *image, hada_slot *slot, cl_mem in, const hada_fft_real *real,
                                     cl_mem out, const hada_fft_spectra *spectra, hada_error *err)
{
    const hada_range range = hada_range_of((size_t)real->images, 1, 1, 1);
    const hada_local local_memory = {image->local_bytes};
    return hada_launch_fft_image_forward(slot, HADA_PROGRAM_FFT_IMAGE_FORWARD_DEFAULT, &range, err, .in = in,
                                         .real = *real, .out = out, .spectra = *spectra,
                                         .row_table = image->rows->table.ints,
                                         .column_table = image->columns->table.ints, .local_memory = local_memory);
}

static hada_status run_image_inverse(const own_image *image, hada_slot *slot, cl_mem in,
                                     const hada_fft_columns_in *from, const hada_fft_filter *use, cl_mem out,
                                     const hada_fft_real *real, hada_error *err)
{
    const hada_range range = hada_range_of((size_t)real->images, 1, 1, 1);
    const hada_local local_memory = {image->local_bytes};
    return hada_launch_fft_image_inverse(
        slot, hada_find_fft_image_inverse(.fft_product = (int)use->product, .fft_half = use->half), &range, err,
        .in = in, .from = *from, .filter = use->filter, .out = out, .real = *real, .row_table = image->rows->table.ints,
        .column_table = image->columns->table.ints, .local_memory = local_memory);
}

/* What a pass needs at least, for profiles: hada_slot_cost() of the launch that follows. Operations: 5 n log2 n for a
 * complex transform of n points, half of that for a real one (the usual count: M. Frigo, S. G. Johnson, Proceedings of
 * the IEEE 93(2), 216 (2005)), whatever the radices. Traffic: each value within the rectangle and the band is read once
 * and written once; a spectrum that several filters share is read once. `use`: an inverse's filter with its band filled
 * in; NULL: forward. */
typedef struct cost {
    double bytes, flops;
} cost;

static double points(double n)
{
    return n > 1 ? 5.0 * n * log2(n) : 0.0;
}

static double spectrum_columns(const hada_fft_desc *desc, const hada_fft_filter *use)
{
    return (use ? use->band_cols : desc->band_cols) + 1.0;
}

/* Rows of the whole spectrum that are read or written. */
static double spectrum_rows(const hada_fft_desc *desc, const hada_fft_filter *use)
{
    const int within = use ? 2 * use->band_rows + 1 : desc->rows;
    return within < desc->rows ? within : desc->rows;
}

/* Bytes of the half spectra between the passes. */
static double between(const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    return 8.0 * images * desc->real_rows * spectrum_columns(desc, use);
}

static cost cost_rows(const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    const double rows = (double)images * desc->real_rows;
    return (cost){4.0 * rows * desc->real_cols + between(desc, images, use), 0.5 * rows * points(desc->cols)};
}

static cost cost_columns(const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    const double image = spectrum_columns(desc, use) * spectrum_rows(desc, use);
    const int filtered = use && use->product != HADA_FFT_PLAIN;
    const int spectra = filtered && use->spectrum_count < images ? use->spectrum_count : images;
    cost c = {8.0 * spectra * image + between(desc, images, use),
              images * spectrum_columns(desc, use) * points(desc->rows)};
    if (filtered) {
        c.bytes += (use->half ? 4.0 : 8.0) * images * image;
        c.flops += (use->product == HADA_FFT_SPLIT ? 2.0 : 6.0) * images * image;
    }
    return c;
}

/* Both passes in one launch that writes nothing between them. */
static cost cost_image(const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    const cost rows = cost_rows(desc, images, use), columns = cost_columns(desc, images, use);
    return (cost){rows.bytes + columns.bytes - 2.0 * between(desc, images, use), rows.flops + columns.flops};
}

static void expect(hada_slot *slot, cost c)
{
    hada_slot_cost(slot, c.bytes, c.flops);
}

/* Bytes between the two passes at a time. Lanes: what the caches of a few cores keep, larger measured slower. Groups:
 * work enough for a GPU. */
#define BETWEEN_BYTES_LANES  ((size_t)2 << 20)
#define BETWEEN_BYTES_GROUPS ((size_t)64 << 20)

typedef struct own_state {
    hada_own_pass rows, columns;
    hada_buffer between; /* inverse: rows of half spectra */
    int images;          /* that both passes take at a time */
    own_image image;
} own_state;

static size_t between_count(const hada_fft_desc *desc)
{
    return (size_t)(desc->band_cols / HADA_FFT_BLOCK + 1) * (size_t)desc->real_rows * HADA_FFT_BLOCK;
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
    const size_t blocks = (size_t)(desc->cols / 2 / HADA_FFT_BLOCK + 1), whole = blocks * (size_t)desc->rows;
    return image_local_bytes(context, desc,
                             desc->direction == HADA_FFT_INVERSE ? between_count(desc) : whole * HADA_FFT_BLOCK);
}

static int own_block(int cols)
{
    (void)cols;
    return HADA_FFT_BLOCK;
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
    HADA_TRY(hada_allocated(plan->state = hada_alloc(1, sizeof(own_state), "a transform's plan", err)));
    own_state *state = plan->state;
    const hada_fft_pass_desc rows = {
        .kind = inverse ? HADA_PASS_ROWS_INVERSE : HADA_PASS_ROWS, .n = desc->cols, .inverse = inverse};
    const hada_fft_pass_desc columns = {.kind = HADA_PASS_COLUMNS, .n = desc->rows, .inverse = inverse};
    HADA_TRY(hada_own_pass_make(&state->rows, plan->slot, &rows, err));
    HADA_TRY(hada_own_pass_make(&state->columns, plan->slot, &columns, err));
    state->images = images_at_once(plan->slot->context, desc);
    state->image = (own_image){&state->rows, &state->columns, image_bytes(plan->slot->context, desc)};
    if (inverse && !state->image.local_bytes)
        HADA_TRY(hada_buffer_take(&state->between, plan->slot, HADA_OWN_STEPS,
                                  between_count(desc) * (size_t)state->images * 2 * sizeof(float),
                                  "a transform's scratch", err));
    return HADA_OK;
}

/* A task of a row pass takes `width` pairs of rows. */
static int row_tasks(const own_state *state, const hada_fft_desc *desc)
{
    const int pairs = state->rows.width;
    return (desc->real_rows + 2 * pairs - 1) / (2 * pairs);
}

static hada_status launch_sized_columns(hada_fft *plan, cl_mem in, const hada_fft_columns_in *from,
                                        const hada_fft_filter *use, cl_mem out, const hada_fft_columns_out *to,
                                        hada_error *err)
{
    const hada_own_pass *pass = &((const own_state *)plan->state)->columns;
    const int blocks = from->band / HADA_FFT_BLOCK + 1, groups = blocks * to->images * pass->size.parts;
    const hada_range range = hada_range_groups((size_t)groups, (size_t)pass->size.group, 1, 1);
    const int program =
        hada_find_fft_sized_cols(.fft_points = plan->desc.rows, .fft_inverse = plan->desc.direction == HADA_FFT_INVERSE,
                                 .fft_product = (int)use->product, .fft_half = use->half);
    return hada_launch_fft_sized_cols(plan->slot, program, &range, err, .in = in, .from = *from, .filter = use->filter,
                                      .out = out, .to = *to, .twiddles = pass->table.mem);
}

static hada_status launch_columns(hada_fft *plan, cl_mem in, const hada_fft_columns_in *from,
                                  const hada_fft_filter *use, cl_mem out, const hada_fft_columns_out *to,
                                  hada_error *err)
{
    const own_state *state = plan->state;
    const hada_own_pass *pass = &state->columns;
    if (pass->sized)
        return launch_sized_columns(plan, in, from, use, out, to, err);
    const int blocks = from->band / HADA_FFT_BLOCK + 1, global = !pass->local_bytes;
    const hada_range range =
        hada_own_pass_range(pass, plan->slot, blocks * to->images * (HADA_FFT_BLOCK / pass->width));
    if (plan->slot->context->shape == HADA_SHAPE_GROUPS)
        return hada_launch_fft_group_cols(plan->slot,
                                          hada_find_fft_group_cols(.fft_product = (int)use->product,
                                                                   .fft_half = use->half, .fft_scratch_global = global),
                                          &range, err, .in = in, .from = *from, .filter = use->filter, .out = out,
                                          .to = *to, .table = pass->table.ints, .width = pass->width,
                                          .scratches = hada_own_pass_scratch(pass));
    return hada_launch_fft_cols(
        plan->slot,
        hada_find_fft_rows_cols(.fft_product = (int)use->product, .fft_half = use->half, .fft_scratch_global = global),
        &range, err, .in = in, .from = *from, .filter = use->filter, .out = out, .to = *to, .table = pass->table.ints,
        .scratches = hada_own_pass_scratch(pass));
}

/* The groups of a pass along rows of a length that has a program of its own. */
static hada_range sized_rows(const hada_own_pass *pass, const hada_fft_desc *desc, int images)
{
    const int rows = 2 * pass->size.pairs, groups = (desc->real_rows + rows - 1) / rows * images;
    return hada_range_groups((size_t)groups, (size_t)pass->size.group, 1, 1);
}

static hada_status launch_rows_forward(hada_fft *plan, cl_mem in, const hada_fft_real *real, cl_mem out,
                                       const hada_fft_spectra *spectra, hada_error *err)
{
    const own_state *state = plan->state;
    const hada_own_pass *pass = &state->rows;
    if (pass->sized) {
        const hada_range groups = sized_rows(pass, &plan->desc, real->images);
        return hada_launch_fft_sized_rows_forward(plan->slot, hada_find_fft_sized_rows(.fft_points = plan->desc.cols),
                                                  &groups, err, .in = in, .real = *real, .out = out,
                                                  .spectra = *spectra, .twiddles = pass->table.mem);
    }
    const hada_range range = hada_own_pass_range(pass, plan->slot, row_tasks(state, &plan->desc) * real->images);
    if (plan->slot->context->shape == HADA_SHAPE_GROUPS)
        return hada_launch_fft_group_rows_forward(
            plan->slot, pass->local_bytes ? HADA_PROGRAM_FFT_GROUP_ROWS_DEFAULT : HADA_PROGRAM_FFT_GROUP_ROWS_GLOBAL,
            &range, err, .in = in, .real = *real, .out = out, .spectra = *spectra, .table = pass->table.ints,
            .width = pass->width, .scratches = hada_own_pass_scratch(pass));
    return hada_launch_fft_rows_forward(
        plan->slot, pass->local_bytes ? HADA_PROGRAM_FFT_ROWS_COLS_DEFAULT : HADA_PROGRAM_FFT_ROWS_COLS_GLOBAL, &range,
        err, .in = in, .real = *real, .out = out, .spectra = *spectra, .table = pass->table.ints,
        .scratches = hada_own_pass_scratch(pass));
}

static hada_status launch_rows_inverse(hada_fft *plan, cl_mem in, const hada_fft_spectra *spectra, cl_mem out,
                                       const hada_fft_real *real, hada_error *err)
{
    const own_state *state = plan->state;
    const hada_own_pass *pass = &state->rows;
    if (pass->sized) {
        const hada_range groups = sized_rows(pass, &plan->desc, real->images);
        return hada_launch_fft_sized_rows_inverse(plan->slot, hada_find_fft_sized_rows(.fft_points = plan->desc.cols),
                                                  &groups, err, .in = in, .spectra = *spectra, .out = out,
                                                  .real = *real, .twiddles = pass->table.mem);
    }
    const hada_range range = hada_own_pass_range(pass, plan->slot, row_tasks(state, &plan->desc) * real->images);
    if (plan->slot->context->shape == HADA_SHAPE_GROUPS)
        return hada_launch_fft_group_rows_inverse(
            plan->slot, pass->local_bytes ? HADA_PROGRAM_FFT_GROUP_ROWS_DEFAULT : HADA_PROGRAM_FFT_GROUP_ROWS_GLOBAL,
            &range, err, .in = in, .spectra = *spectra, .out = out, .real = *real, .table = pass->table.ints,
            .width = pass->width, .scratches = hada_own_pass_scratch(pass));
    return hada_launch_fft_rows_inverse(
        plan->slot, pass->local_bytes ? HADA_PROGRAM_FFT_ROWS_COLS_DEFAULT : HADA_PROGRAM_FFT_ROWS_COLS_GLOBAL, &range,
        err, .in = in, .spectra = *spectra, .out = out, .real = *real, .table = pass->table.ints,
        .scratches = hada_own_pass_scratch(pass));
}

/* The images first..first+images-1 of a batch. */
static hada_status forward_part(hada_fft *plan, int first, int images, cl_mem real, size_t real_offset, cl_mem spectrum,
                                size_t spectrum_offset, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    const size_t count = plan->layout.count, at = spectrum_offset + (size_t)first * count;
    const hada_fft_filter none = {.product = HADA_FFT_PLAIN};
    const hada_fft_real images_in =
        hada_fft_real_of(desc, real_offset + (size_t)first * desc->real_distance, 1, images);
    const hada_fft_spectra spectra = {at, count, desc->rows, desc->band_cols};
    const hada_fft_columns_in from = {.offset = at,
                                      .distance = count,
                                      .count = images,
                                      .first_row = desc->row0,
                                      .rows = desc->real_rows,
                                      .last_row = desc->rows,
                                      .band = desc->band_cols};
    const hada_fft_columns_out to = {.offset = at, .distance = count, .rows = desc->rows, .images = images};
    expect(plan->slot, cost_rows(desc, images, NULL));
    HADA_TRY(launch_rows_forward(plan, real, &images_in, spectrum, &spectra, err));
    expect(plan->slot, cost_columns(desc, images, NULL));
    return launch_columns(plan, spectrum, &from, &none, spectrum, &to, err);
}

static hada_status own_forward(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                               size_t spectrum_offset, hada_error *err)
{
    const own_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    if (state->image.local_bytes) {
        const hada_fft_real images = hada_fft_real_of(desc, real_offset, 1, batch);
        const hada_fft_spectra spectra = {spectrum_offset, plan->layout.count, desc->rows, desc->band_cols};
        expect(plan->slot, cost_image(desc, batch, NULL));
        return run_image_forward(&state->image, plan->slot, real, &images, spectrum, &spectra, err);
    }
    for (int first = 0; first < batch; first += state->images) {
        const int left = batch - first, images = left < state->images ? left : state->images;
        HADA_TRY(forward_part(plan, first, images, real, real_offset, spectrum, spectrum_offset, err));
    }
    return HADA_OK;
}

/* What columns of the images first... of a batch are made of: spectra, times filters where there are. */
static hada_fft_columns_in columns_of(const hada_fft *plan, int first, size_t spectrum_offset,
                                      const hada_fft_filter *use)
{
    const size_t count = plan->layout.count;
    return (hada_fft_columns_in){.offset = spectrum_offset,
                                 .distance = count,
                                 .filter_offset = (size_t)(use->filter_first + first * use->stride) * count,
                                 .filter_distance = count * (size_t)use->stride,
                                 .count = use->spectrum_count,
                                 .first = first,
                                 .rows = use->band_rows + 1,
                                 .last_row = plan->desc.rows - use->band_rows,
                                 .band = use->band_cols};
}

/* The images first..first+images-1 of a batch. */
static hada_status inverse_part(hada_fft *plan, int first, int images, cl_mem spectrum, size_t spectrum_offset,
                                cl_mem real, size_t real_offset, const hada_fft_filter *use, hada_error *err)
{
    const own_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    const size_t distance = between_count(desc), step = desc->real_distance * (size_t)use->stride;
    const hada_fft_columns_in from = columns_of(plan, first, spectrum_offset, use);
    const hada_fft_columns_out to = {
        .distance = distance, .row0 = desc->row0, .rows = desc->real_rows, .images = images};
    const hada_fft_spectra spectra = {.distance = distance, .rows = desc->real_rows, .band = use->band_cols};
    const hada_fft_real images_out = hada_fft_real_of(desc, real_offset + (size_t)first * step, use->stride, images);
    expect(plan->slot, cost_columns(desc, images, use));
    HADA_TRY(launch_columns(plan, spectrum, &from, use, state->between.mem, &to, err));
    expect(plan->slot, cost_rows(desc, images, use));
    return launch_rows_inverse(plan, state->between.mem, &spectra, real, &images_out, err);
}

static hada_status own_inverse(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                               size_t real_offset, const hada_fft_filter *use, hada_error *err)
{
    const own_state *state = plan->state;
    if (state->image.local_bytes) {
        const hada_fft_columns_in from = columns_of(plan, 0, spectrum_offset, use);
        const hada_fft_real images = hada_fft_real_of(&plan->desc, real_offset, use->stride, batch);
        expect(plan->slot, cost_image(&plan->desc, batch, use));
        return run_image_inverse(&state->image, plan->slot, spectrum, &from, use, real, &images, err);
    }
    for (int first = 0; first < batch; first += state->images) {
        const int left = batch - first, images = left < state->images ? left : state->images;
        HADA_TRY(inverse_part(plan, first, images, spectrum, spectrum_offset, real, real_offset, use, err));
    }
    return HADA_OK;
}

const hada_fft_engine hada_fft_own_engine = {
    own_create, own_destroy, own_forward, own_inverse, own_block,
};
