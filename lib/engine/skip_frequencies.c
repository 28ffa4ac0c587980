/* Frequencies that a frame does not need, and a second look without bounded kinds. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "engine/pipeline.h"

/* Two runs that add up other frequencies round differently, each by at most this (relative L2, see docs/fft.md). */
static const double transform_rounding = 3e-7;

/* The planes' norm is known only afterwards; the choice of a band takes it for this share of what the filters put on
 * the grid. Light that spread evenly over the grid would leave the window the root of its share; scenes stand in the
 * window, and a little less than halfway between that and all of it was kept by all frames tried (docs/skipping.md). */
static double expected_share(const hada_model_info *info)
{
    const double area = (double)info->window_rows * info->window_cols / ((double)info->grid_rows * info->grid_cols);
    return 0.7 * sqrt(sqrt(area));
}

uint64_t hada_lane_skip_bytes(const hada_context *context, const hada_model_info *info, const hada_plan_shape *shape,
                              int batch)
{
    const hada_spectrum_layout layout = hada_hadamard_layout(context, info);
    return (shape->pruned ? 0 : hada_hadamard_unpruned_bytes(context, info, batch)) +
           (shape->measured ? hada_meter_bytes(&layout, info->channels) : 0) +
           (shape->half_by_error ? hada_bank_bytes(info, &layout, 1, HADA_BANK_FILTERS, 0) : 0);
}

hada_status hada_lane_skip_make(hada_lane *lane, hada_error *err)
{
    const hada_plan_shape *shape = &lane->plan->shape;
    hada_status status = shape->pruned ? HADA_OK : hada_hadamard_unprune(lane->stage, err);
    if (!status && shape->measured)
        status = hada_meter_create(&lane->meter, lane->slot, &lane->stage->layout, lane->stage->channels, err);
    return status;
}

void hada_lane_skip_apply(hada_lane *lane, const hada_task *task)
{
    const hada_task_skip *skip = &task->skip;
    lane->stage->part = (hada_hadamard_part){
        .band_rows = skip->band_rows, .band_cols = skip->band_cols, .spectra = skip->spectra, .planes = skip->planes};
}

/* What lies outside the caller's band does not count: the dense run leaves it out as well. */
static void leave_out(const hada_tiles *tiles, int channels, int band_rows, int band_cols, float *energy)
{
    const size_t count = hada_tiles_count(tiles), groups = (size_t)tiles->groups;
    for (size_t t = 0; t < count; t++) {
        const int above = t / groups ? tiles->row_last[t / groups - 1] + 1 : 0,
                  left = (int)(t % groups) * HADA_TILE_COLS;
        for (int c = 0; c < channels && (above > band_rows || left > band_cols); c++)
            energy[(size_t)c * count + t] = 0.0f;
    }
}

static int smaller(int a, int b)
{
    return a < b ? a : b;
}

/* The smallest band whose change, together with those of half filters and of rounding, stays within max_error of the
 * expected planes. */
static void choose_band(const hada_plan *plan, const float *energy, hada_task_skip *skip)
{
    const hada_plan_shape *shape = &plan->shape;
    const hada_gains *gains = plan->skip.gains;
    const double light = sqrt(hada_gains_light(gains, energy)), rounding = 2.0 * transform_rounding * light,
                 half = shape->half_by_error ? sqrt(gains->halved) * light : 0.0;
    const double most = expected_share(hada_model_get_info(plan->model)) * light * plan->options.max_error /
                        (1.0 + plan->options.max_error);
    double dropped[HADA_BANDS];
    int band = HADA_BANDS - 1;
    hada_gains_dropped(gains, energy, dropped);
    while (plan->options.skip & HADA_SKIP_FREQUENCIES && band > 0 && half + rounding + sqrt(dropped[band - 1]) <= most)
        band--;
    skip->limited = band < HADA_BANDS - 1;
    skip->change = half + sqrt(dropped[band]) + (skip->limited || shape->half_by_error ? rounding : 0.0);
    if (!skip->limited)
        return;
    const int rows = gains->tiles.row_last[band], cols = gains->tiles.col_last[band];
    const int banded = shape->band_rows || shape->band_cols;
    skip->band_rows = banded ? smaller(rows, shape->band_rows) : rows;
    skip->band_cols = banded ? smaller(cols, shape->band_cols) : cols;
}

hada_status hada_lane_skip_frequencies(hada_lane *lane, hada_task *task, hada_error *err)
{
    const hada_plan *plan = lane->plan;
    const hada_plan_shape *shape = &plan->shape;
    const hada_gains *gains = plan->skip.gains;
    hada_task_skip *skip = &task->skip;
    float *energy;
    skip->change = skip->band_change = 0.0;
    skip->again = skip->limited = 0;
    skip->band_rows = shape->band_rows;
    skip->band_cols = shape->band_cols;
    if (!gains)
        return HADA_OK;
    hada_status status = hada_alloc_raw((void **)&energy, lane->meter->energy.bytes, 1, "the measure of spectra", err);
    if (status)
        return status;
    status = hada_meter_run(lane->meter, lane->stage->spectrum.mem, lane->share->gains.mem, err);
    if (!status)
        status = hada_buffer_read(&lane->meter->energy, lane->slot, 0, energy, lane->meter->energy.bytes, err);
    if (!status && (shape->band_rows || shape->band_cols)) {
        skip->band_change = sqrt(hada_gains_outside(gains, energy, shape->band_rows, shape->band_cols));
        leave_out(&gains->tiles, gains->channels, shape->band_rows, shape->band_cols, energy);
    }
    if (!status && shape->bounded)
        choose_band(plan, energy, skip);
    free(energy);
    return status;
}

int hada_task_skip_dense(const hada_task *task)
{
    return task->skip.again && task->plan->shape.half_by_error;
}

hada_status hada_lane_skip_dense(hada_lane *lane, int first, int count, hada_error *err)
{
    const hada_plan *plan = lane->plan;
    const size_t plane = hada_plane_values(hada_model_get_info(plan->model));
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < count; i++) {
        hada_bank *bank;
        status = hada_bank_create(&bank, lane->slot, plan->model, &lane->stage->layout, &plan->depths[first + i], 1,
                                  HADA_BANK_FILTERS, 0, err);
        if (status)
            return status;
        status = hada_hadamard_run(lane->stage, bank, 0, 1, lane->planes.mem, (size_t)i * plane, err);
        if (!status)
            status = hada_slot_finish(lane->slot, err);
        hada_bank_destroy(&bank);
    }
    return status;
}
