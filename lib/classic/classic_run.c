/* Runs of the classic methods: an iteration of each, until a rule stops them; the weight of a method's prior and the
 * width of sieves, found from the frame alone. */
#include <math.h>
#include <stdlib.h>

#include "classic/classic_steps.h"
#include "core/base.h"
#include "core/clock.h"
#include "launch/classic_frame.h"
#include "launch/classic_haar.h"
#include "launch/classic_lucy.h"
#include "launch/classic_split.h"
#include "launch/classic_step.h"
#include "launch/classic_tv.h"
#include "planes/weight_search.h"

/* Richardson-Lucy, with total variation and acceleration. */

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
    HADA_TRY(hada_classic_frame_forward(classic, HADA_CLASSIC_PROJECTION, err));
    HADA_TRY(transpose(classic, HADA_CLASSIC_NORM, err));
    return hada_classic_clear(classic, HADA_CLASSIC_PREDICTION, err);
}

/* Flat planes to start from. The first step takes the scale of the start away, but the extrapolation sees it: it goes
 * with the frame's brightness. */
static hada_status rl_begin(hada_classic *classic, hada_error *err)
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

/* Goes on from PRIMAL, with Gaussians of another width and other weights of the frame's values. */
static hada_status rl_anew(hada_classic *classic, double width, hada_error *err)
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
static hada_status rl_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
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

/* FISTA: a gradient step, the prior's proximal step, non-negativity, momentum. */

/* Nesterov's sequence; returns the factor of the momentum. */
static double nesterov(double *t)
{
    const double next = (1.0 + sqrt(1.0 + 4.0 * *t * *t)) / 2.0, beta = (*t - 1.0) / next;
    *t = next;
    return beta;
}

/* The first start is 0, and so are its half spectra. */
static hada_status fista_begin(hada_classic *classic, hada_error *err)
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

static hada_status fista_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
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

/* ADMM: splits of planes, gradients and data, then the joint least-squares step. */

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

static hada_status admm_begin(hada_classic *classic, hada_error *err)
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

static hada_status admm_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
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

/* Runs. */

/* Each method: what comes before the first iteration; one iteration, which leaves the sums of changes in *sums (squared
 * change, squared size) where `wanted`. ADMM's are those of the iteration before. */
typedef struct method {
    hada_status (*begin)(hada_classic *classic, hada_error *err);
    hada_status (*step)(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err);
} method;
static const method methods[] = {[HADA_METHOD_RL] = {rl_begin, rl_step},
                                 [HADA_METHOD_FISTA] = {fista_begin, fista_step},
                                 [HADA_METHOD_ADMM] = {admm_begin, admm_step}};

/* Memory that other parts of a slot used meanwhile is cleared; some buffers are written anyway before they are read. */
static hada_status clear(hada_classic *classic, hada_error *err)
{
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        if (i != HADA_CLASSIC_LIST && i != HADA_CLASSIC_WINDOW && i != HADA_CLASSIC_TABLE &&
            i != HADA_CLASSIC_SPECTRA && i != HADA_CLASSIC_FRAME && i != HADA_CLASSIC_WEIGHTS)
            HADA_TRY(hada_classic_clear(classic, (hada_classic_part)i, err));
    return HADA_OK;
}

/* Weights of the frame's values; NULL: none. */
static hada_status weigh(hada_classic *classic, cl_mem weights, hada_error *err)
{
    classic->weighted = weights && classic->bytes[HADA_CLASSIC_WEIGHTS];
    return classic->weighted ? hada_classic_load(classic, HADA_CLASSIC_WEIGHTS, weights, 0, err) : HADA_OK;
}

/* The depths of the job; with components, all of each. */
static hada_status write_list(hada_classic *classic, const hada_classic_job *job, hada_error *err)
{
    hada_buffer *list = &classic->part[HADA_CLASSIC_LIST];
    const int components = classic->shape.components, terms = job->depths * components;
    cl_int *terms_of = NULL;
    hada_status status = HADA_OK;
    if (components == 1)
        return hada_buffer_write(list, classic->slot, 0, job->list, (size_t)job->depths * sizeof(cl_int), err);
    HADA_TRY_OR_DONE(HADA_NEW(terms_of, (size_t)terms, "a list of components", err));
    for (int i = 0; i < terms; i++)
        terms_of[i] = job->list[i / components] * components + i % components;
    HADA_TRY_OR_DONE(hada_buffer_write(list, classic->slot, 0, terms_of, (size_t)terms * sizeof(cl_int), err));
done:
    free(terms_of);
    return status;
}

hada_status hada_classic_ready(hada_classic *classic, const hada_classic_job *job, hada_error *err)
{
    classic->job = job;
    classic->planes = job->depths * classic->shape.place.channels;
    classic->momentum = 1.0;
    classic->weighted = 0;
    classic->weight = job->weight;
    classic->sieve = classic->shape.sieve ? job->sieve : 0.0;
    classic->taps = 0.0;
    HADA_TRY(clear(classic, err));
    HADA_TRY(write_list(classic, job, err));
    if (classic->bytes[HADA_CLASSIC_FRAME])
        HADA_TRY(hada_classic_load(classic, HADA_CLASSIC_FRAME, job->data->frame, job->data->frame_offset, err));
    return weigh(classic, job->data->weights, err);
}

/* `number` iterations after `first` others, from where they left everything. */
static hada_status iterations(hada_classic *classic, int first, int number, hada_error *err)
{
    const method *m = &methods[classic->shape.options.method];
    double sums[2];
    for (int k = 0; k < number; k++) {
        if (!k)
            HADA_TRY(m->begin(classic, err));
        HADA_TRY(m->step(classic, first + k, 0, sums, err));
    }
    return HADA_OK;
}

/* Iterations that may be in the queue, so that a run can be cancelled between them. */
enum { QUEUED = 8 };

static hada_status wiener(hada_classic *classic, hada_error *err)
{
    const double noise = classic->shape.options.lambda * classic->job->camera->mean_square;
    hada_classic_gradient_power(classic, 1);
    HADA_TRY(hada_classic_write_table(classic, err));
    HADA_TRY(hada_classic_solve(classic, 1, 1.0, 0.0, noise, err));
    return hada_classic_inverse(classic, HADA_CLASSIC_PRIMAL, err);
}

/* Until the relative change was small twice running, or a limit is reached. */
static hada_status iterate(hada_classic *classic, int *count, hada_error *err)
{
    const hada_classic_options *o = &classic->shape.options;
    const method *m = &methods[o->method];
    const hada_classic_job *job = classic->job;
    const double start = hada_seconds();
    const int most = job->iterations ? job->iterations : o->iterations;
    int settled = 0;
    if (!job->before)
        HADA_TRY(m->begin(classic, err));
    while (*count < most && settled < 2) {
        double sums[2] = {1.0, 1.0};
        HADA_TRY(m->step(classic, *count, o->stop > 0.0, sums, err));
        ++*count;
        settled = o->stop > 0.0 && sqrt(sums[0]) <= o->stop * sqrt(sums[1]) ? settled + 1 : 0;
        if (o->seconds > 0.0 || *count % QUEUED == 0)
            HADA_TRY(hada_slot_finish(classic->slot, err));
        if (o->seconds > 0.0 && hada_seconds() - start >= o->seconds)
            break;
        if (job->progress && *count % QUEUED == 0)
            job->progress(job->user, *count);
    }
    return HADA_OK;
}

hada_status hada_classic_run(hada_classic *classic, const hada_classic_job *job, hada_classic_result *result,
                             hada_error *err)
{
    *result = (hada_classic_result){.iterations = job->before};
    if (!job->before)
        HADA_TRY(hada_classic_ready(classic, job, err));
    classic->job = job;
    if (job->before && job->anew) {
        HADA_TRY(weigh(classic, job->data->weights, err));
        HADA_TRY(rl_anew(classic, job->sieve, err));
    }
    HADA_TRY(classic->shape.options.method == HADA_METHOD_WIENER ? wiener(classic, err)
                                                                 : iterate(classic, &result->iterations, err));
    HADA_TRY(hada_classic_crop(classic, err));
    return hada_classic_energy(classic, &result->energy, err);
}

/* The weight of a method's prior. */

enum {
    PART = 6,    /* iterations with a weight: this part of those that the frame takes */
    LARGE = 100, /* but no more */
    FIRST = 2,   /* times as many with the first one, which begins from nothing */
    WEIGHTS = 14 /* all in all as if with so many weights, at most */
};
#define MOST_OF_OWN 2.5

/* Slow methods go on converging, whatever the weight: what is gained by less than this is not the weight's. */
#define LEAST 0.005

typedef struct search {
    hada_classic *classic;
    const hada_classic_job *job;
    cl_mem held;
    int each, most;
} search;

static hada_status solve(void *user, double weight, int *steps, double *left, hada_error *err)
{
    const search *s = user;
    const int wanted = *steps ? s->each : FIRST * s->each,
              number = wanted < s->most - *steps ? wanted : s->most - *steps;
    s->classic->weight = weight;
    HADA_TRY(iterations(s->classic, *steps, number, err));
    *steps += number;
    if (s->job->progress)
        s->job->progress(s->job->user, *steps);
    HADA_TRY(weigh(s->classic, s->held, err));
    HADA_TRY(hada_classic_energy(s->classic, left, err));
    return weigh(s->classic, s->job->data->weights, err);
}

/* With a weight. */
static int each_of(const hada_classic_shape *shape)
{
    const int part = shape->options.iterations / PART;
    return part < 1 ? 1 : part > LARGE ? LARGE : part;
}

int hada_classic_search_most(const hada_classic_shape *shape)
{
    return shape->choose ? (int)fmin(MOST_OF_OWN * shape->options.iterations, WEIGHTS * each_of(shape)) : 0;
}

hada_status hada_classic_choose(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                                const hada_frame_exposure *exposure, hada_maker_choice *choice, hada_error *err)
{
    search s = {classic, job, held, each_of(&classic->shape), hada_classic_search_most(&classic->shape)};
    HADA_TRY(hada_classic_ready(classic, job, err));
    return hada_weight_find(
        &(hada_weight_search){.solve = solve, .user = &s, .most_steps = s.most, .least = LEAST, .factor = 1.0},
        exposure, choice, err);
}

/* Richardson-Lucy whose planes are sums of Gaussians with non-negative weights, the method of sieves (D. Snyder and M.
 * Miller, IEEE Trans. Nuclear Science 32(5), 1985): what is narrower than the Gaussian is noise. The iteration is that
 * of a camera whose point spread functions are blurred. From wide to narrow Gaussians the planes go on as they are, for
 * a wide Gaussian is a narrower one of a third. */

enum { EACH = 70 };
#define WIDEST    2.8284271247461903 /* pixels; each next one has half of its square, and after the narrowest comes 0 */
#define NARROWEST 0.8

/* The search ends where this much more is left of held-out values. */
#define WORSE 1.01

/* PRIMAL, to or from where the result will be: the support is the window. */
static hada_status keep(hada_classic *classic, int back, hada_error *err)
{
    const hada_classic_image *plane = &classic->plane;
    const hada_range range = hada_range_of((size_t)plane->pitch, 8, (size_t)plane->rows, (size_t)classic->planes);
    const cl_mem window = classic->part[HADA_CLASSIC_WINDOW].mem, planes = classic->part[HADA_CLASSIC_PRIMAL].mem;
    hada_slot_cost(classic->slot, 8.0 * (double)plane->pixels * classic->planes, 0.0);
    if (back)
        return hada_launch_classic_pad(classic->slot, hada_program_classic_frame_of(classic->slot), &range, err,
                                       .frame = window, .offset = 0, .images = planes, .cols = plane->cols);
    return hada_launch_classic_crop(classic->slot, hada_program_classic_frame_of(classic->slot), &range, err,
                                    .planes = planes, .window = window, .pitch = plane->pitch, .row0 = 0, .col0 = 0,
                                    .rows = plane->rows, .cols = plane->cols);
}

/* Iterations with one width, and what they leave of held-out values. */
static hada_status try_width(hada_classic *classic, const hada_classic_job *job, cl_mem held, int *iterations,
                             double *left, hada_error *err)
{
    double sums[2];
    for (int k = 0; k < EACH; k++, ++*iterations) {
        HADA_TRY(rl_step(classic, k, 0, sums, err));
        if (job->progress && k % 8 == 7)
            job->progress(job->user, *iterations + 1);
    }
    HADA_TRY(weigh(classic, held, err));
    HADA_TRY(hada_classic_energy(classic, left, err));
    return weigh(classic, job->data->weights, err);
}

/* 0 after the last one. */
static double narrower(double width)
{
    return width > NARROWEST ? width * sqrt(0.5) : 0.0;
}

hada_status hada_classic_sieve(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                               hada_classic_sieved *found, hada_error *err)
{
    double now = WIDEST, left = 0.0;
    int last = 0;
    *found = (hada_classic_sieved){.left = INFINITY};
    HADA_TRY(hada_classic_ready(classic, job, err));
    classic->sieve = now;
    HADA_TRY(rl_begin(classic, err));
    for (;;) {
        HADA_TRY(try_width(classic, job, held, &found->iterations, &left, err));
        last = left < found->left;
        if (last) {
            found->left = left;
            found->width = now;
            HADA_TRY(keep(classic, 0, err));
        }
        if (!(now > 0.0) || left > WORSE * found->left)
            break;
        now = narrower(now);
        HADA_TRY(rl_anew(classic, now, err));
    }
    classic->sieve = found->width;
    return last ? HADA_OK : keep(classic, 1, err);
}

hada_status hada_classic_sieve_within(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                                      const hada_classic_sieved *found, const float *start, double *left,
                                      hada_error *err)
{
    double other;
    int iterations = found->iterations;
    classic->job = job;
    HADA_TRY(hada_buffer_write(&classic->part[HADA_CLASSIC_PRIMAL], classic->slot, 0, start,
                               (size_t)classic->planes * classic->plane.pixels * sizeof *start, err));
    HADA_TRY(rl_anew(classic, classic->sieve, err));
    HADA_TRY(try_width(classic, job, held, &iterations, left, err));
    if (found->width > 0.0) {
        HADA_TRY(rl_anew(classic, narrower(found->width), err));
        HADA_TRY(try_width(classic, job, held, &iterations, &other, err));
        *left = fmin(*left, other);
    }
    classic->sieve = found->width;
    return keep(classic, 1, err);
}
