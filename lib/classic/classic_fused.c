/* An iteration in fused passes: along columns both transforms with the product between them, along rows both with the
 * step on the pixels between them (kernels/classic_columns.cl, classic_rows.cl). Whole spectra stand nowhere. */
#include <math.h>

#include "classic/classic_steps.h"
#include "launch/classic_columns.h"
#include "launch/classic_rows.h"

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

hada_status hada_classic_fused_frame(hada_classic *classic, int inverse, int forward, hada_classic_pixel_step step,
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

hada_status hada_classic_fused_planes(hada_classic *classic, hada_classic_part planes, int forward, hada_error *err)
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
