/* An iteration of Richardson-Lucy, with total variation and acceleration. */
#include <math.h>

#include "classic/classic_steps.h"
#include "launch/classic_lucy.h"
#include "launch/classic_step.h"

/* Predictions of a pixel below this share of the frame's brightness count as that much, and pixels whose light reaches
 * the sensor to less than this share as if that much did: far below what noise leaves to be seen
 * (docs/explanation/mathematics.md). */
static const double least_prediction = 1e-5, least_norm = 1e-3;

/* What components leave of point spread functions is of both signs, and so are predictions of dark pixels: their ratios
 * were huge, and planes came out black. This share of the frame's brightness is added to the frame and to its
 * prediction (perf/results/field-varying.md). */
static const double least_beside = 0.1; /* with Gaussians it makes noise count more alike: 0.1 to 0.2 dB */

/* So far at most goes the extrapolation (Biggs and Andrews: below 1). */
static const double most_momentum = 0.999;

static hada_status fill(hada_classic *classic, hada_classic_part part, double number, hada_error *err)
{
    return hada_buffer_fill(classic->slot, classic->part[part].mem, 0, (float)number,
                            classic->bytes[part] / sizeof(cl_float), err);
}

/* planes = transpose of PROJECTION, and of their Gaussians. */
static hada_status transpose(hada_classic *classic, hada_classic_part planes, hada_error *err)
{
    if (!(classic->sieve > 0.0))
        return hada_classic_transpose(classic, planes, err);
    HADA_TRY(hada_classic_transpose(classic, HADA_CLASSIC_BLURRED, err));
    return hada_classic_blur(classic, classic->sieve, HADA_CLASSIC_BLURRED, planes, err);
}

/* The transpose of the sensor's frame, or of the weights of its values. */
static hada_status rl_norm(hada_classic *classic, hada_error *err)
{
    HADA_TRY(fill(classic, HADA_CLASSIC_PREDICTION, 1.0, err));
    if (classic->weighted)
        HADA_TRY(hada_classic_step_pixels(classic, HADA_CLASSIC_WEIGH, 0.0, err));
    HADA_TRY(classic->fuses ? hada_classic_fused_frame(classic, 0, 1, HADA_CLASSIC_NO_STEP, 0.0, err)
                            : hada_classic_frame_forward(classic, HADA_CLASSIC_PROJECTION, err));
    HADA_TRY(transpose(classic, HADA_CLASSIC_NORM, err));
    return hada_classic_clear(classic, HADA_CLASSIC_PREDICTION, err);
}

/* Flat planes to start from. The first step takes the scale of the start away, but the extrapolation sees it: it goes
 * with the frame's brightness. */
hada_status hada_classic_rl_begin(hada_classic *classic, hada_error *err)
{
    const double flat = classic->job->brightness / sqrt(classic->job->camera->gain);
    HADA_TRY(rl_norm(classic, err));
    HADA_TRY(fill(classic, HADA_CLASSIC_EXTRAPOLATED, flat, err));
    return fill(classic, HADA_CLASSIC_PREVIOUS, flat, err);
}

static hada_status copy(hada_classic *classic, hada_classic_part from, hada_classic_part to, hada_error *err)
{
    return hada_buffer_copy(classic->slot, classic->part[from].mem, 0, classic->part[to].mem, 0, classic->bytes[from],
                            err);
}

hada_status hada_classic_rl_anew(hada_classic *classic, double width, hada_error *err)
{
    const double less = classic->sieve * classic->sieve - width * width;
    if (less > 0.0) {
        HADA_TRY(hada_classic_blur(classic, sqrt(less), HADA_CLASSIC_PRIMAL, HADA_CLASSIC_BLURRED, err));
        HADA_TRY(copy(classic, HADA_CLASSIC_BLURRED, HADA_CLASSIC_PRIMAL, err));
    }
    classic->sieve = width;
    HADA_TRY(copy(classic, HADA_CLASSIC_PRIMAL, HADA_CLASSIC_EXTRAPOLATED, err));
    HADA_TRY(copy(classic, HADA_CLASSIC_PRIMAL, HADA_CLASSIC_PREVIOUS, err));
    HADA_TRY(hada_classic_clear(classic, HADA_CLASSIC_DIRECTION, err));
    return rl_norm(classic, err);
}

static hada_status multiplicative_step(hada_classic *classic, hada_error *err)
{
    const hada_classic_options *o = &classic->shape.options;
    const int tv = o->prior == HADA_PRIOR_TV;
    const hada_range range = hada_classic_band_range(classic);
    const double all = (double)classic->plane.pixels * classic->planes;
    hada_slot_cost(classic->slot, 28.0 * all, (tv ? 50.0 : 12.0) * all);
    return hada_launch_classic_lucy(
        classic->slot, hada_program_classic_lucy_of(classic->slot), &range, err,
        .start = classic->part[HADA_CLASSIC_EXTRAPOLATED].mem, .corrected = classic->part[HADA_CLASSIC_PRIMAL].mem,
        .norms = classic->part[HADA_CLASSIC_NORM].mem, .before = classic->part[HADA_CLASSIC_PREVIOUS].mem,
        .direction = classic->part[HADA_CLASSIC_DIRECTION].mem, .image = hada_classic_plane_bands(classic),
        .weight = tv ? (float)classic->weight : 0.0f, .least = (float)(least_norm * sqrt(classic->job->camera->gain)),
        .partial = classic->part[HADA_CLASSIC_PARTIAL].mem);
}

static hada_status extrapolate(hada_classic *classic, double momentum, hada_error *err)
{
    const hada_range range = hada_classic_slice_range(classic);
    const double all = (double)classic->plane.pixels * classic->planes;
    hada_slot_cost(classic->slot, 12.0 * all, 3.0 * all);
    return hada_launch_classic_extrapolate(classic->slot, hada_program_classic_step_of(classic->slot), &range, err,
                                           .planes = classic->part[HADA_CLASSIC_PRIMAL].mem,
                                           .before = classic->part[HADA_CLASSIC_PREVIOUS].mem,
                                           .next = classic->part[HADA_CLASSIC_EXTRAPOLATED].mem,
                                           .factor = (float)momentum, .slices = hada_classic_plane_slices(classic));
}

/* The correction is computed where the planes before the last ones stood, and becomes the new planes. */
hada_status hada_classic_rl_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
{
    const int accelerate = classic->shape.options.accelerate;
    const double varying = -fmax(least_beside * classic->job->brightness, 1e-30);
    const int sieved = classic->sieve > 0.0;
    const double least =
        classic->shape.components > 1 || sieved ? varying : fmax(least_prediction * classic->job->brightness, 1e-30);
    double all[4] = {0}, factor = 0.0;
    if (number)
        hada_classic_swap(classic, HADA_CLASSIC_PRIMAL, HADA_CLASSIC_PREVIOUS);
    if (sieved)
        HADA_TRY(hada_classic_blur(classic, classic->sieve, HADA_CLASSIC_EXTRAPOLATED, HADA_CLASSIC_BLURRED, err));
    HADA_TRY(hada_classic_predict(classic, sieved ? HADA_CLASSIC_BLURRED : HADA_CLASSIC_EXTRAPOLATED, err));
    HADA_TRY(hada_classic_data_step(classic, HADA_CLASSIC_RATIO, least, 1, err));
    HADA_TRY(transpose(classic, HADA_CLASSIC_PRIMAL, err));
    HADA_TRY(multiplicative_step(classic, err));
    if (accelerate || wanted)
        HADA_TRY(hada_classic_sums(classic, hada_classic_band_count(classic), 4, all, err));
    if (accelerate && all[1] > 0.0)
        factor = fmax(0.0, fmin(all[0] / all[1], most_momentum));
    if (wanted) {
        sums[0] = all[2];
        sums[1] = all[3];
    }
    return extrapolate(classic, factor, err);
}
