#include "refine/admm_fused.h"

#include <math.h>

#include "launch/refine_columns.h"
#include "launch/refine_rows.h"

enum { GROUP_ROWS = 16 }; /* that a work-item of refine_rows takes */

int hada_refine_fused_grid(const hada_context *context, const hada_refine_shape *shape)
{
    return shape->boundary == HADA_BOUNDARY_CIRCULAR && hada_fft_fuses(context, shape->grid_rows, shape->grid_cols, 1);
}

size_t hada_refine_fused_bytes(const hada_context *context, const hada_refine_shape *shape)
{
    return hada_refine_fused_grid(context, shape) ? hada_fft_fused_bytes(context, shape->grid_rows, shape->grid_cols)
                                                  : 0;
}

hada_status hada_refine_fused_make(hada_refiner *refiner, hada_error *err)
{
    const hada_refine_shape *shape = &refiner->shape;
    hada_slot *slot = refiner->slot;
    hada_status status = HADA_OK;
    if (!hada_refine_fused_grid(slot->context, shape))
        goto done;
    HADA_TRY(hada_fft_fused_make(&refiner->fused, slot, shape->grid_rows, shape->grid_cols, err));
    HADA_TRY(hada_prepare_refine_columns(slot, HADA_PROGRAM_REFINE_COLUMNS_DEFAULT, err));
    HADA_TRY(hada_prepare_refine_rows(slot, HADA_PROGRAM_REFINE_ROWS_DEFAULT, err));
done:
    return status;
}

int hada_refine_fused_takes(const hada_refiner *refiner, int depths)
{
    const hada_refine_shape *shape = &refiner->shape;
    return refiner->fused.columns.table.mem &&
           hada_fft_fuses(refiner->slot->context, shape->grid_rows, shape->grid_cols, depths);
}

/* The usual count of a transform of n points, in operations. */
static double transform(double n)
{
    return 5.0 * n * log2(n > 2.0 ? n : 2.0);
}

static hada_refine_rows rows_of(const hada_refiner *refiner, const hada_refine_fused_part *part)
{
    const hada_refine_rect *window = &refiner->shape.window;
    return (hada_refine_rows){.row0 = window->row0,
                              .rows = window->rows,
                              .col0 = window->col0,
                              .cols = window->cols,
                              .inverse = part->inverse,
                              .clip = part->clip,
                              .forward = part->forward,
                              .scale = (float)hada_refine_per_pixel(refiner),
                              .back_table = refiner->fused.back_table};
}

hada_status hada_refine_fused_columns(const hada_refine_run *run, const hada_refine_rule *rule, int start, int step,
                                      int place, hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const hada_refine_data *data = run->data;
    const hada_own_pass *pass = &refiner->fused.columns;
    const hada_refine_step now = hada_refine_step_of(run, rule, start, step, place);
    const hada_refine_rows rows = rows_of(refiner, &(hada_refine_fused_part){0});
    const int channels = refiner->shape.channels, all = run->sets * run->depths;
    const hada_local scratch = {pass->local_bytes * (size_t)run->depths};
    const hada_range range = hada_range_groups((size_t)refiner->layout.blocks, 1, (size_t)channels, (size_t)run->sets);
    const double columns = (refiner->layout.cols / 2 + 1.0) * channels, grid = refiner->layout.rows;
    const int cold = start == HADA_REFINE_COLD, ways = cold ? 1 : 2;
    const int once = all < data->otf_depths ? all : data->otf_depths; /* one that several sets share is read once */
    hada_slot_cost(refiner->slot,
                   columns * (8.0 * grid * (once + 1.0 + (start == HADA_REFINE_CONTINUE ? 2.0 : 1.0) * all) +
                              (now.has_prior ? 4.0 * grid : 0) + 8.0 * ways * all * rows.rows),
                   columns * (ways * all * transform(grid) + grid * ((cold ? 20.0 : 44.0) * all + 16.0 * run->sets)));
    refiner->transforms += (size_t)(all * channels);
    return hada_launch_refine_columns(refiner->slot, HADA_PROGRAM_REFINE_COLUMNS_DEFAULT, &range, err,
                                      .planes = refiner->now_u.mem, .otf = data->otf, .list = refiner->list.mem,
                                      .frame = data->spectrum, .prior = now.has_prior ? data->prior : data->spectrum,
                                      .now_w = refiner->now_w.mem, .partial = refiner->partial.mem, .now = now,
                                      .rows = rows, .table = pass->table.mem, .scratch = scratch);
}

hada_status hada_refine_fused_rows(const hada_refine_run *run, const hada_refine_fused_part *part, hada_error *err)
{
    hada_refiner *refiner = run->refiner;
    const hada_fft_fused *fused = &refiner->fused;
    const hada_refine_rows rows = rows_of(refiner, part);
    const int images = run->sets * run->depths * refiner->shape.channels, ways = part->inverse + part->forward;
    const hada_local scratch = {fused->rows.local_bytes};
    const hada_range range = hada_range_groups((size_t)images * hada_divide_up((size_t)rows.rows, GROUP_ROWS), 1, 1, 1);
    const double all = (double)images * rows.rows;
    hada_slot_cost(refiner->slot, all * (8.0 * ways * (refiner->layout.cols / 2 + 1.0) + 4.0 * ways * rows.cols),
                   all * (0.5 * ways * transform(refiner->layout.cols) + (part->clip ? 1.0 : 0) * rows.cols));
    refiner->transforms += part->forward ? (size_t)images : 0;
    return hada_launch_refine_rows(refiner->slot, HADA_PROGRAM_REFINE_ROWS_DEFAULT, &range, err,
                                   .spectra = refiner->now_u.mem, .planes = refiner->planes.mem, .rows = rows,
                                   .tables = fused->row_tables.mem, .scratch = scratch);
}
