/* An iteration of ADMM: splits of planes, gradients and data, then the joint least-squares step. */
#include "classic/classic_steps.h"
#include "launch/classic_split.h"

static int has_tv(const hada_classic *classic)
{
    return classic->bytes[HADA_CLASSIC_TV_DUAL] != 0;
}

/* Of the data: 1 where nothing crops it, since it needs no split. */
static double mu1(const hada_classic *classic)
{
    return classic->bytes[HADA_CLASSIC_DATA_SPLIT] ? classic->shape.options.mu1 : 1.0;
}

static double mu2(const hada_classic *classic)
{
    return has_tv(classic) ? classic->shape.options.mu2 * mu1(classic) * classic->job->camera->gain : 0.0;
}

static double mu3(const hada_classic *classic)
{
    return classic->shape.options.mu3 * mu1(classic) * classic->job->camera->gain;
}

hada_status hada_classic_admm_begin(hada_classic *classic, hada_error *err)
{
    hada_classic_gradient_power(classic, !has_tv(classic));
    return hada_classic_write_table(classic, err);
}

/* The splits of the planes: non-negativity and total variation. Without the latter its buffers are any others. */
static hada_status split(hada_classic *classic, hada_error *err)
{
    const hada_rectangle *support = &classic->shape.support;
    const int tv = has_tv(classic);
    const hada_classic_splits splits = {.row0 = support->row0,
                                        .col0 = support->col0,
                                        .row1 = support->row0 + support->rows,
                                        .col1 = support->col0 + support->cols,
                                        .has_tv = tv,
                                        .gradient = (float)mu2(classic),
                                        .planes = (float)mu3(classic),
                                        .threshold =
                                            tv ? (float)(hada_classic_prior_weight(classic) / mu2(classic)) : 0.0f};
    const hada_range range = hada_classic_band_range(classic);
    const double all = (double)classic->plane.pixels * classic->planes;
    hada_slot_cost(classic->slot, (tv ? 36.0 : 20.0) * all, (tv ? 40.0 : 12.0) * all);
    HADA_TRY(hada_launch_classic_split(
        classic->slot, hada_program_classic_split_of(classic->slot), &range, err,
        .planes = classic->part[HADA_CLASSIC_PRIMAL].mem, .old = classic->part[HADA_CLASSIC_PREVIOUS].mem,
        .t_old = classic->part[tv ? HADA_CLASSIC_TV_DUAL : HADA_CLASSIC_PRIMAL].mem,
        .t_new = classic->part[tv ? HADA_CLASSIC_TV_DUAL_NEXT : HADA_CLASSIC_PLANE_DUAL].mem,
        .duals = classic->part[HADA_CLASSIC_PLANE_DUAL].mem, .image = hada_classic_plane_bands(classic),
        .splits = splits, .partial = classic->part[HADA_CLASSIC_PARTIAL].mem));
    if (tv)
        hada_classic_swap(classic, HADA_CLASSIC_TV_DUAL, HADA_CLASSIC_TV_DUAL_NEXT);
    return HADA_OK;
}

hada_status hada_classic_admm_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
{
    HADA_TRY(split(classic, err));
    if (wanted && number)
        HADA_TRY(hada_classic_sums(classic, hada_classic_band_count(classic), 2, sums, err));
    if (classic->bytes[HADA_CLASSIC_DATA_SPLIT]) {
        if (number) /* at first PROJECTION is 0, and so is what it makes of the frame */
            HADA_TRY(hada_classic_frame_inverse(classic, err));
        HADA_TRY(hada_classic_step_pixels(classic, HADA_CLASSIC_SPLIT,
                                          classic->weighted ? mu1(classic) : 1.0 / (1.0 + mu1(classic)), err));
        HADA_TRY(hada_classic_frame_forward(classic, HADA_CLASSIC_DATA_SPLIT, err));
    }
    if (number)
        HADA_TRY(hada_classic_forward(classic, HADA_CLASSIC_PREVIOUS, err));
    HADA_TRY(hada_classic_solve(classic, number == 0, mu1(classic), mu2(classic), mu3(classic), err));
    HADA_TRY(hada_classic_inverse(classic, HADA_CLASSIC_PREVIOUS, err));
    hada_classic_swap(classic, HADA_CLASSIC_PRIMAL, HADA_CLASSIC_PREVIOUS);
    return HADA_OK;
}
