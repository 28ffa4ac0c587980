/* An iteration of FISTA: a gradient step, the prior's proximal step, non-negativity, momentum. */
#include <math.h>

#include "classic/classic_steps.h"
#include "launch/classic_haar.h"
#include "launch/classic_step.h"
#include "launch/classic_tv.h"

/* Nesterov's sequence; returns the factor of the momentum. */
static double nesterov(double *t)
{
    const double next = (1.0 + sqrt(1.0 + 4.0 * *t * *t)) / 2.0, beta = (*t - 1.0) / next;
    *t = next;
    return beta;
}

/* The first start is 0, and so are its half spectra. */
hada_status hada_classic_fista_begin(hada_classic *classic, hada_error *err)
{
    HADA_TRY(hada_classic_clear(classic, HADA_CLASSIC_SPECTRA, err));
    for (int c = 0; c < classic->shape.place.channels; c++)
        classic->table[c] = (float)(classic->shape.options.step / classic->job->camera->largest[c]);
    return hada_classic_write_table(classic, err);
}

static double pixels_of(const hada_classic *classic)
{
    return (double)classic->plane.pixels * classic->planes;
}

/* HADA_CLASSIC_GRADIENT = transpose of what EXTRAPOLATED leaves of the frame. */
static hada_status gradient(hada_classic *classic, hada_error *err)
{
    if (classic->has_frame) {
        HADA_TRY(hada_classic_predict(classic, HADA_CLASSIC_EXTRAPOLATED, err));
        HADA_TRY(hada_classic_data_step(classic, HADA_CLASSIC_RESIDUAL, 0.0, 1, err));
    } else {
        HADA_TRY(hada_classic_forward(classic, HADA_CLASSIC_EXTRAPOLATED, err));
        HADA_TRY(hada_classic_project(classic, 1, err));
    }
    return hada_classic_transpose(classic, HADA_CLASSIC_GRADIENT, err);
}

static hada_status descend(hada_classic *classic, hada_error *err)
{
    const hada_range range = hada_classic_slice_range(classic);
    hada_slot_cost(classic->slot, 12.0 * pixels_of(classic), 2.0 * pixels_of(classic));
    return hada_launch_classic_descend(
        classic->slot, hada_program_classic_step_of(classic->slot), &range, err,
        .momentum = classic->part[HADA_CLASSIC_EXTRAPOLATED].mem, .gradient = classic->part[HADA_CLASSIC_GRADIENT].mem,
        .alpha = classic->part[HADA_CLASSIC_TABLE].mem, .slices = hada_classic_plane_slices(classic));
}

/* From the proximal step's result, or (direct) with the gradient step. */
static hada_status momentum(hada_classic *classic, hada_classic_part from, int direct, double beta, hada_error *err)
{
    const hada_range range = hada_classic_slice_range(classic);
    hada_slot_cost(classic->slot, (direct ? 20.0 : 16.0) * pixels_of(classic), 10.0 * pixels_of(classic));
    return hada_launch_classic_momentum(
        classic->slot, hada_program_classic_step_of(classic->slot), &range, err,
        .planes = classic->part[HADA_CLASSIC_PRIMAL].mem, .momentum = classic->part[HADA_CLASSIC_EXTRAPOLATED].mem,
        .gradient = classic->part[from].mem, .direct = direct, .alpha = classic->part[HADA_CLASSIC_TABLE].mem,
        .beta = (float)beta, .slices = hada_classic_plane_slices(classic),
        .partial = classic->part[HADA_CLASSIC_PARTIAL].mem);
}

/* HADA_CLASSIC_PROXIMAL = max(0, GRADIENT - gradient^T dual) */
static hada_status tv_planes(hada_classic *classic, hada_classic_part dual, hada_error *err)
{
    const hada_range range = hada_classic_band_range(classic);
    hada_slot_cost(classic->slot, 16.0 * pixels_of(classic), 5.0 * pixels_of(classic));
    return hada_launch_classic_tv_planes(
        classic->slot, hada_program_classic_tv_of(classic->slot), &range, err,
        .given = classic->part[HADA_CLASSIC_GRADIENT].mem, .duals = classic->part[dual].mem,
        .planes = classic->part[HADA_CLASSIC_PROXIMAL].mem, .image = hada_classic_plane_bands(classic));
}

static hada_status tv_duals(hada_classic *classic, double beta, hada_error *err)
{
    const hada_range range = hada_classic_band_range(classic);
    hada_slot_cost(classic->slot, 36.0 * pixels_of(classic), 14.0 * pixels_of(classic));
    return hada_launch_classic_tv_duals(
        classic->slot, hada_program_classic_tv_of(classic->slot), &range, err,
        .planes = classic->part[HADA_CLASSIC_PROXIMAL].mem, .duals = classic->part[HADA_CLASSIC_TV_DUAL].mem,
        .momentum = classic->part[HADA_CLASSIC_TV_DUAL_NEXT].mem, .alpha = classic->part[HADA_CLASSIC_TABLE].mem,
        .weight = (float)hada_classic_prior_weight(classic), .beta = (float)beta,
        .channels = (cl_uint)classic->shape.place.channels, .image = hada_classic_plane_bands(classic));
}

/* The duals go on from where the last iteration left them, without its momentum. */
static hada_status total_variation(hada_classic *classic, hada_error *err)
{
    double t = 1.0;
    HADA_TRY(hada_buffer_copy(classic->slot, classic->part[HADA_CLASSIC_TV_DUAL].mem, 0,
                              classic->part[HADA_CLASSIC_TV_DUAL_NEXT].mem, 0, classic->bytes[HADA_CLASSIC_TV_DUAL],
                              err));
    for (int k = 0; k < classic->shape.options.inner; k++) {
        HADA_TRY(tv_planes(classic, HADA_CLASSIC_TV_DUAL_NEXT, err));
        HADA_TRY(tv_duals(classic, nesterov(&t), err));
    }
    return tv_planes(classic, HADA_CLASSIC_TV_DUAL, err);
}

/* Where level `number` of the pyramid stands: 0 is the image itself. */
static cl_mem level_of(const hada_classic *classic, int number, hada_ulong *offset)
{
    const size_t each = classic->bytes[HADA_CLASSIC_PYRAMID] / (size_t)classic->shape.options.levels / sizeof(float);
    *offset = number ? (hada_ulong)(number - 1) * each : 0;
    return classic->part[number ? HADA_CLASSIC_PYRAMID : HADA_CLASSIC_GRADIENT].mem;
}

static hada_status haar_down(hada_classic *classic, int number, hada_error *err)
{
    const hada_range range = hada_classic_band_range(classic);
    hada_classic_level level = {.spacing = 1 << number, .decimated = classic->shape.options.prior == HADA_PRIOR_HAAR};
    const cl_mem fine = level_of(classic, number, &level.fine), result = level_of(classic, number + 1, &level.result);
    hada_slot_cost(classic->slot, 8.0 * pixels_of(classic), 4.0 * pixels_of(classic));
    return hada_launch_classic_haar_down(classic->slot, hada_program_classic_haar_of(classic->slot), &range, err,
                                         .fine = fine, .result = result, .level = level,
                                         .image = hada_classic_plane_bands(classic));
}

/* The changes of a level stand where the means of the next one stood. */
static hada_status haar_up(hada_classic *classic, int number, hada_error *err)
{
    const hada_range range = hada_classic_band_range(classic);
    const int more = number + 1 < classic->shape.options.levels;
    hada_classic_level level = {.spacing = 1 << hada_least(number, 7) /* there are at most 8 */,
                                .decimated = classic->shape.options.prior == HADA_PRIOR_HAAR,
                                .more = more,
                                .image = number == 0};
    const cl_mem fine = level_of(classic, number, &level.fine), result = level_of(classic, number + 1, &level.result);
    const cl_mem coarser = level_of(classic, number + 1 + more, &level.coarse);
    hada_slot_cost(classic->slot, (more ? 12.0 : 8.0) * pixels_of(classic), 60.0 * pixels_of(classic));
    return hada_launch_classic_haar_up(
        classic->slot, hada_program_classic_haar_of(classic->slot), &range, err, .fine = fine, .coarser = coarser,
        .result = result, .level = level, .alpha = classic->part[HADA_CLASSIC_TABLE].mem,
        .weight = (float)hada_classic_prior_weight(classic), .channels = (cl_uint)classic->shape.place.channels,
        .image = hada_classic_plane_bands(classic));
}

/* The result stands in level 1 of the pyramid. */
static hada_status wavelets(hada_classic *classic, hada_error *err)
{
    const int levels = classic->shape.options.levels;
    for (int level = 0; level + 1 < levels; level++)
        HADA_TRY(haar_down(classic, level, err));
    for (int level = levels - 1; level >= 0; level--)
        HADA_TRY(haar_up(classic, level, err));
    return HADA_OK;
}

/* Without a prior every part of a step is fused, and leaves the half spectra of the next start. */
static hada_status fused_step(hada_classic *classic, double beta, int wanted, double sums[2], hada_error *err)
{
    HADA_TRY(hada_classic_fused_columns(classic, 0, err));
    HADA_TRY(hada_classic_data_step(classic, HADA_CLASSIC_RESIDUAL, 0.0, 1, err));
    HADA_TRY(hada_classic_fused_columns(classic, 1, err));
    HADA_TRY(hada_classic_fused_momentum(classic, beta, err));
    if (wanted)
        HADA_TRY(hada_classic_sums(classic, hada_classic_task_count(classic), 2, sums, err));
    return HADA_OK;
}

hada_status hada_classic_fista_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
{
    const hada_prior prior = classic->shape.options.prior;
    const hada_classic_part from = prior == HADA_PRIOR_NONE ? HADA_CLASSIC_GRADIENT
                                   : prior == HADA_PRIOR_TV ? HADA_CLASSIC_PROXIMAL
                                                            : HADA_CLASSIC_PYRAMID;
    const double beta = nesterov(&classic->momentum);
    (void)number;
    if (classic->fuses && prior == HADA_PRIOR_NONE && classic->shape.components == 1)
        return fused_step(classic, beta, wanted, sums, err);
    HADA_TRY(gradient(classic, err));
    if (prior != HADA_PRIOR_NONE) {
        HADA_TRY(descend(classic, err));
        HADA_TRY(prior == HADA_PRIOR_TV ? total_variation(classic, err) : wavelets(classic, err));
    }
    HADA_TRY(momentum(classic, from, prior == HADA_PRIOR_NONE, beta, err));
    if (wanted)
        HADA_TRY(hada_classic_sums(classic, hada_classic_slice_count(classic), 2, sums, err));
    return HADA_OK;
}
